#include "server/bench/parallel.h"

#include <glib.h>
#include <stdatomic.h>

typedef struct loop {
  void (*task)(void *context, int index);
  void *context;
  int count;
  atomic_int next;
} loop;

static void *run(void *user) {
  loop *l = user;
  for (int i; (i = atomic_fetch_add(&l->next, 1)) < l->count;) l->task(l->context, i);
  return NULL;
}

void tcs_parallel(int threads, int count, void (*task)(void *context, int index), void *context) {
  loop l = {.task = task, .context = context, .count = count};
  GPtrArray *helpers = g_ptr_array_new();
  while ((int)helpers->len < MIN(threads, count) - 1) {
    GThread *helper = g_thread_try_new("parallel", run, &l, NULL);
    if (!helper) break; /* the other threads do its share */
    g_ptr_array_add(helpers, helper);
  }
  run(&l);
  for (guint i = 0; i < helpers->len; i++) g_thread_join(g_ptr_array_index(helpers, i));
  g_ptr_array_free(helpers, TRUE);
}
