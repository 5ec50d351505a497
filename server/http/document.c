/* Bodies and scenes as JSON: short ones immediately, long ones on the text worker. */
#include <limits.h>
#include <string.h>

#include "server/http/work.h"
#include "server/session/session_scene.h"

/* Limit on bodies waiting to be parsed. */
#define MOST_BODIES 64

typedef struct body_work {
  tcs_work work;
  GByteArray *bytes; /* a reference, since the request may end */
  const char *scene;
  tcs_body_use use;
  cJSON *json;
  tcp_lists lists;
} body_work;

static const cJSON *scene_of(const cJSON *json, const char *member) {
  return *member ? cJSON_GetObjectItemCaseSensitive(json, member) : json;
}

static void run_body(tcs_work *work) {
  body_work *b = (body_work *)work;
  b->json = tcp_json_parse((const char *)b->bytes->data, b->bytes->len, &work->error);
  if (!b->json || !b->scene || tcp_lists_read(scene_of(b->json, b->scene), &b->lists, &work->error)) return;
  cJSON_Delete(g_steal_pointer(&b->json)); /* the error points into the scene */
}

static void reply_body(tcs_work *work) {
  body_work *b = (body_work *)work;
  char *prefix = b->scene && *b->scene ? g_strconcat("/", b->scene, NULL) : NULL;
  if (b->json)
    b->use(work->request, b->json, &b->lists);
  else
    tcs_reply_error_in(work->request, work->error, prefix ? prefix : "");
  g_free(prefix);
}

/* Freeing a tree of a million nodes also takes long. */
typedef struct tree_task {
  tcs_task task;
  cJSON *json;
} tree_task;

static void run_tree(tcs_task *task) { cJSON_Delete(((tree_task *)task)->json); }
static void done_tree(tcs_task *task) { g_free(task); }

static void free_body(tcs_work *work) {
  body_work *b = (body_work *)work;
  g_byte_array_unref(b->bytes);
  tcp_lists_clear(&b->lists);
  if (!b->json) return;
  if (!work->request) { /* the worker may have been freed */
    cJSON_Delete(b->json);
    return;
  }
  tree_task *tree = g_new0(tree_task, 1);
  *tree = (tree_task){{.run = run_tree, .done = done_tree}, b->json};
  tcs_worker_submit(work->worker, &tree->task);
}

void tcs_read_body(tcs_request *request, const char *scene, tcs_body_use use) {
  if (request->body->len <= TCS_LONG_JSON) {
    cJSON *json = tcs_body_json(request);
    if (json) use(request, json, NULL);
    cJSON_Delete(json);
    return;
  }
  body_work *b = g_new0(body_work, 1);
  b->work = (tcs_work){.run = run_body, .reply = reply_body, .free = free_body};
  b->bytes = g_byte_array_ref(request->body);
  b->scene = scene;
  b->use = use;
  tcs_work_start(request, request->server->text_worker, &b->work, MOST_BODIES);
}

/* --- scenes ---------------------------------------------------------------------------------------- */

typedef struct scene_work {
  tcs_work work;
  tc_scene scene;
  cJSON *around;
  int status;
  char *etag, *location;
} scene_work;

static void run_scene(tcs_work *work) {
  scene_work *s = (scene_work *)work;
  cJSON *json = tcp_scene_write(&s->scene);
  if (s->around) {
    cJSON_ReplaceItemInObjectCaseSensitive(s->around, "scene", json);
    json = g_steal_pointer(&s->around);
  }
  work->text = tcs_json_text(json);
}

static void reply_scene(tcs_work *work) {
  scene_work *s = (scene_work *)work;
  tcs_reply_text(work->request, s->status, "application/json", g_steal_pointer(&work->text));
  if (s->etag) tcs_reply_header(work->request, "ETag", s->etag);
  if (s->location) tcs_reply_header(work->request, "Location", s->location);
}

static void free_scene(tcs_work *work) {
  scene_work *s = (scene_work *)work;
  tc_scene_clear(&s->scene);
  cJSON_Delete(s->around);
  g_free(s->etag);
  g_free(s->location);
}

void tcs_reply_scene(tcs_request *request, int status, cJSON *around, const tc_scene *scene, const char *etag,
                     const char *location) {
  scene_work *s = g_new0(scene_work, 1);
  s->work = (tcs_work){.run = run_scene, .reply = reply_scene, .free = free_scene};
  tc_scene_copy(&s->scene, scene);
  s->around = around;
  s->status = status;
  s->etag = g_strdup(etag);
  s->location = g_strdup(location);
  if (tcs_scene_is_long(scene)) /* the change is made already, so its reply must not be refused */
    tcs_work_start(request, request->server->text_worker, &s->work, INT_MAX);
  else
    tcs_work_inline(request, &s->work);
}
