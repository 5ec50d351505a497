/* What a session has rendered, and pictures that come in another order than they were begun in: there are two encoders.
 * The jobs are ended by hand, so that order and times are the test's. */
#include "tests/support/test.h"

#include "server/cli/daemon.h"
#include "server/session/change.h"
#include "server/session/jobs.h"
#include "server/session/sessions.h"
#include "server/session/viewers.h"
#include "tests/support/scoped.h"

static tcs_daemon *under_test;
static tcs_session *session;
static bool willing; /* the viewers take a picture; while they do not, the scheduler begins none */

typedef struct viewer {
  tcs_watcher watcher;
  int frames;
  bool final;
} viewer;

static bool ready(const tcs_watcher *watcher) { return willing; }
static void take(tcs_watcher *watcher, const tcs_picture *picture, const tcp_frame_header *header) {
  viewer *v = (viewer *)watcher;
  v->frames++;
  v->final = header->final;
}
static void ignore_text(tcs_watcher *watcher, const char *json) {}
static void ignore_end(tcs_watcher *watcher) {}
static const tcs_watcher_ops ops = {ready, take, ignore_text, ignore_end, true};

static int open_daemon(void **state) {
  char *arguments[] = {"serve", "--listen", "127.0.0.1:0", "--backend", "cpu", "--volume", "v=demo:bucky", NULL};
  int code = 0;
  under_test = tcs_daemon_open(G_N_ELEMENTS(arguments) - 1, arguments, &code);
  assert_non_null(under_test);
  tcs_server *server = tcs_daemon_server(under_test);
  tcs_entry *entry = tcs_catalogue_find(server->catalogue, TCS_KIND_VOLUME, "v");
  while (entry->state == TCS_LOADING) tcs_daemon_turn(under_test, 10);
  session = tcs_sessions_create(server->sessions, entry, NULL, NULL, "unit", NULL);
  assert_non_null(session);
  return 0;
}

static int close_daemon(void **state) {
  tcs_daemon_close(under_test);
  return 0;
}

static void change(double fov) {
  g_autoptr(cJSON) patch = cJSON_CreateObject();
  cJSON_AddNumberToObject(cJSON_AddObjectToObject(patch, "camera"), "fovY", fov);
  assert_true(tcs_session_patch(session, patch, NULL, false, NULL));
}

/* What the session wants now, rendered: it goes to an encoder. */
static tcs_job *rendered_job(bool at_rest) {
  session->active_until_us = at_rest ? 0 : INT64_MAX;
  willing = true;
  const tcs_class class = tcs_session_wants(session, g_get_monotonic_time(), NULL);
  tcs_job *job = class == TCS_CLASS_NONE ? NULL : tcs_session_next_job(session, class);
  willing = false;
  assert_non_null(job);
  assert_int_equal(job->final, at_rest);
  job->rendered(job);
  return job;
}

/* As the scheduler ends it. */
static void encoded(tcs_job *job) {
  job->image = g_bytes_new_static("picture", 7);
  job->out_width = job->out_height = 1;
  willing = true;
  job->finished(job);
  willing = false;
  tcs_job_free(job);
}

static const tcs_picture *latest(void) { return tcs_session_latest(session); }

TEST(what_was_overtaken_takes_no_place) {
  viewer first = {.watcher.ops = &ops}, late = {.watcher.ops = &ops};
  tcs_session_join(session, &first.watcher, 16);
  change(20);
  tcs_job *older = rendered_job(false);
  change(21);
  tcs_job *newer = rendered_job(false);
  const uint64_t revision = newer->revision;
  assert_true(older->revision < revision);
  encoded(newer);
  assert_int_equal(latest()->revision, revision);
  encoded(older);
  assert_int_equal(latest()->revision, revision);
  assert_int_equal(first.frames, 1);

  change(22);
  tcs_job *reduced = rendered_job(false), *final = rendered_job(true);
  assert_int_equal(reduced->revision, final->revision);
  encoded(final);
  assert_true(latest()->final && first.final);
  encoded(reduced);
  assert_true(latest()->final && first.final);
  assert_int_equal(first.frames, 2);
  willing = true;
  tcs_session_join(session, &late.watcher, 16);
  willing = false;
  assert_int_equal(late.frames, 1);
  assert_true(late.final);
  tcs_session_leave(&late.watcher);
  tcs_session_leave(&first.watcher);
}

TEST(what_comes_in_order_takes_its_place) {
  viewer v = {.watcher.ops = &ops};
  tcs_session_join(session, &v.watcher, 16);
  change(30);
  tcs_job *older = rendered_job(false);
  change(31);
  tcs_job *newer = rendered_job(false), *final = rendered_job(true);
  const uint64_t revisions[] = {older->revision, newer->revision};
  encoded(older);
  assert_int_equal(latest()->revision, revisions[0]);
  encoded(newer);
  assert_int_equal(latest()->revision, revisions[1]);
  assert_false(v.final);
  encoded(final);
  assert_true(v.final);
  assert_int_equal(v.frames, 3);
  tcs_session_leave(&v.watcher);
}

static void light(const char *gradient) {
  cJSON *patch = cJSON_CreateObject(), *shading = cJSON_AddObjectToObject(patch, "shading");
  cJSON_AddStringToObject(shading, "model", "blinn-phong");
  cJSON_AddStringToObject(shading, "gradient", gradient);
  assert_true(tcs_session_patch(session, patch, NULL, false, NULL));
  cJSON_Delete(patch);
}

/* A scene lit by central gradients is drawn with cell gradients while it moves: its interactive frames are as large as
 * those of a scene lit by cell gradients, and a final frame, however slow, makes none of them smaller. */
TEST(frames_in_motion_are_sized_by_their_own_gradients) {
  static const char *const gradients[] = {"cell", "central"};
  const tcs_ladder known = {.ms_per_sample = 2e-5, .measured = true};
  viewer v = {.watcher.ops = &ops};
  int widths[2];
  tcs_session_join(session, &v.watcher, 16);
  light("cell");
  tcs_job *first = rendered_job(false);
  tcs_ladder *ladder = &((tcs_view *)first->part)->ladders[TC_MODE_DVR];
  encoded(first);
  for (int i = 0; i < 2; i++) {
    light(gradients[i]);
    change(40 + i);
    *ladder = known;
    tcs_job *job = rendered_job(false);
    widths[i] = job->width;
    assert_int_equal(job->scene.shading.gradient, TC_GRADIENT_CELL);
    encoded(job);
  }
  assert_true(widths[0] < session->scene.image.width);
  assert_int_equal(widths[0], widths[1]);
  *ladder = known;
  tcs_job *final = rendered_job(true);
  final->stats.render_ms = 1e5;
  encoded(final);
  assert_true(ladder->ms_per_sample == known.ms_per_sample);
  tcs_session_leave(&v.watcher);
}

/* A projection has no light, a surface is lit once a pixel: the final frame tells what interactive ones take. */
TEST(what_is_not_lit_at_every_sample_is_sized_by_its_own_frames) {
  const tc_mode modes[] = {TC_MODE_MIP, TC_MODE_ISOSURFACE, TC_MODE_MESH, TC_MODE_SPLAT};
  for (size_t i = 0; i < sizeof modes / sizeof *modes; i++) {
    viewer v = {.watcher.ops = &ops};
    cJSON *patch = cJSON_CreateObject();
    cJSON_AddStringToObject(patch, "mode", tc_mode_names[modes[i]]);
    tcs_session_join(session, &v.watcher, 16);
    light("central");
    assert_true(tcs_session_patch(session, patch, NULL, false, NULL));
    tcs_job *final = rendered_job(true);
    tcs_ladder *ladder = &((tcs_view *) final->part)->ladders[modes[i]];
    final->stats.render_ms = 1e-5 * final->samples;
    encoded(final);
    assert_true(ladder->measured && fabs(ladder->ms_per_sample - 1e-5) < 1e-9);
    cJSON_Delete(patch);
    tcs_session_leave(&v.watcher);
  }
}

TESTS(open_daemon, close_daemon)
