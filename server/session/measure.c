#include "server/session/measure.h"

#include "server/observe/log.h"
#include "server/observe/metrics.h"
#include "server/session/deliver.h"

/* After this time the pixels measured so far are the sample. */
#define MOST_MS 5000

struct tcs_measure {
  tcs_task task;
  tcs_server *server;
  tcs_session *session; /* NULL: cancelled */
  tcs_view *view;
  tcs_picture *picture;       /* owned reference */
  tc_volume *volume, *labels; /* owned references; no labels: NULL */
  struct tc_mesh **meshes;    /* of the scene's surfaces; taken from the job */
  tc_scene scene;
  tc_meter *meter;
  atomic_bool cancel;
  tc_meter_result result;
  GError *error;
};

static void run(tcs_task *task) {
  tcs_measure *m = (tcs_measure *)task;
  const tc_meter_subject of = {m->volume, m->labels, m->meshes, &m->scene, &m->cancel};
  tc_meter_measure(m->meter, &of, MOST_MS, &m->result, &m->error);
}

/* Stores the reason for having no result. */
static void tell_failure(const tcs_measure *m) {
  tcs_log(TCS_LOG_WARN, "meter.failed", "code=%d", m->error->code);
  tcs_picture *picture = m->picture;
  g_strlcpy(picture->unmeasured, m->error->message, sizeof picture->unmeasured);
  picture->header.unmeasured = picture->unmeasured;
}

static tcp_surface_error surface_error(const tc_depth_error *e, bool listed) {
  return (tcp_surface_error){.surface = listed ? e->surface : -1, .label = e->label, .both = e->both, .one = e->one,
                             .rms = e->rms, .p99 = e->p99, .max = e->max, .outline = e->outline};
}

static void tell(const tcs_measure *m) {
  tcp_frame_header *header = &m->picture->header;
  tcs_histogram_add_error(&m->server->metrics->error, m->result.rms);
  header->has_error = true;
  header->rms = m->result.rms;
  header->low = m->result.low;
  header->high = m->result.high;
  header->max = m->result.max;
  header->pixels = m->result.pixels;
  header->depth = surface_error(&m->result.depth, false);
  header->n_surfaces = MIN(m->result.n_surfaces, TCP_MOST_SURFACES);
  for (int i = 0; i < header->n_surfaces; i++)
    header->surfaces[i] = surface_error(&m->result.surfaces[i], m->scene.mode == TC_MODE_MESH && m->scene.mesh.n_surfaces);
  header->n_layers = MIN(m->result.n_layers, TCP_MOST_LAYERS);
  for (int i = 0; i < header->n_layers; i++) header->layers[i] = surface_error(&m->result.layers[i], false);
}

static void done(tcs_task *task) {
  tcs_measure *m = (tcs_measure *)task;
  tcs_metrics *metrics = m->server->metrics;
  metrics->meter_seconds += m->result.ms / 1000;
  metrics->meter_pixels += (uint64_t)m->result.pixels;
  tcs_session *session = m->session;
  if (session) m->view->measure = NULL;
  if (!session) {
    metrics->meter_cancelled++;
  } else {
    (m->error ? tell_failure : tell)(m);
    tcs_session_deliver(session);
  }
  tcs_picture_unref(m->picture);
  tc_meter_free(m->meter);
  tc_volume_unref(m->volume);
  tc_volume_unref(m->labels);
  tcs_meshes_free(m->meshes, m->scene.mesh.n_surfaces);
  tc_scene_clear(&m->scene);
  g_clear_error(&m->error);
  g_free(m);
}

void tcs_measure_begin(tcs_session *session, tcs_view *view, tcs_job *job, tcs_picture *picture) {
  tcs_measure_cancel(view);
  tcs_measure *m = g_new0(tcs_measure, 1);
  *m = (tcs_measure){.task = {.run = run, .done = done}, .server = session->server, .session = session, .view = view};
  m->picture = tcs_picture_ref(picture);
  m->volume = tc_volume_ref(job->volume);
  if (job->labels) m->labels = tc_volume_ref(job->labels);
  tc_scene_copy(&m->scene, &job->scene);
  m->meshes = g_steal_pointer(&job->meshes);
  m->meter = g_steal_pointer(&job->meter);
  atomic_init(&m->cancel, false);
  view->measure = m;
  tcs_worker_submit(session->server->meter_worker, &m->task);
}

void tcs_measure_cancel(tcs_view *view) {
  if (!view->measure) return;
  atomic_store(&view->measure->cancel, true);
  view->measure->session = NULL;
  view->measure = NULL;
}

int tcs_meter_pixels(const tcs_job *job) {
  char reason[96];
  return tc_meter_refuses(&job->scene, reason, sizeof reason) ? 0 : job->scene.error_meter.pixels;
}

void tcs_session_still(tcs_session *session, tcs_job *job) {
  if (job->revision != session->revision || session->watchers->len || !job->scene.error_meter.pixels) return;
  tcs_view *view = tcs_session_own_view(session);
  const tcs_picture *last = session->still;
  if (last && last->revision == job->revision && last->header.width == job->out_width &&
      last->header.height == job->out_height && (view->measure || tcs_picture_is_judged(last)))
    return;                 /* repeated requests must not restart the measurement */
  tcs_measure_cancel(view); /* of the previous picture */
  tcs_picture_unref(session->still);
  session->still = tcs_picture_new(job);
  g_clear_pointer(&session->still->image, g_bytes_unref);
  if (job->meter) tcs_measure_begin(session, view, job, session->still);
}

const tcs_picture *tcs_session_judged(const tcs_session *session) {
  const tcs_picture *picture = session->still;
  for (guint i = 0; i < session->views->len; i++) {
    if (picture && picture->revision == session->revision && tcs_picture_is_judged(picture)) return picture;
    picture = ((const tcs_view *)g_ptr_array_index(session->views, i))->latest;
  }
  return picture && picture->revision == session->revision && tcs_picture_is_judged(picture) ? picture : NULL;
}
