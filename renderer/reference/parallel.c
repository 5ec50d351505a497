/* Loops on threads of their own: the reference shares no pool with what it judges. */
#include <pthread.h>
#include <unistd.h>

#include "renderer/reference/internal.h"

typedef struct loop {
  const tc_ref_loop *of;
  atomic_int next;
} loop;

static void *work(void *data) {
  loop *l = data;
  const tc_ref_loop *of = l->of;
  for (int i; (i = atomic_fetch_add(&l->next, 1)) < of->count && !tc_ref_is_set(of->cancel);) of->task(of->context, i);
  return NULL;
}

bool tc_ref_parallel(const tc_ref_loop *of, int threads) {
  loop l = {.of = of};
  pthread_t helpers[TC_REF_THREADS];
  int started = 0;
  if (threads == 0) threads = (int)CLAMP(sysconf(_SC_NPROCESSORS_ONLN), 1, TC_REF_THREADS);
  atomic_init(&l.next, 0);
  /* The calling thread works too, so a thread that cannot be created only costs time. */
  while (started < MIN(threads, of->count) - 1 && pthread_create(&helpers[started], NULL, work, &l) == 0) started++;
  work(&l);
  for (int i = 0; i < started; i++) pthread_join(helpers[i], NULL);
  return !tc_ref_is_set(of->cancel);
}
