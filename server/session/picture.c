#include "server/session/picture.h"

#include <string.h>

#include "server/schedule/scheduler.h"

tcs_picture *tcs_picture_ref(tcs_picture *picture) {
  picture->references++;
  return picture;
}

void tcs_picture_unref(tcs_picture *picture) {
  if (!picture || --picture->references > 0) return;
  if (picture->image) g_bytes_unref(picture->image);
  if (picture->marks) g_array_unref(picture->marks);
  cJSON_free(picture->scene);
  g_free(picture);
}

bool tcs_picture_is_judged(const tcs_picture *picture) {
  return picture->header.has_error || picture->header.unmeasured;
}

static char *shown_scene(const tc_scene *scene) {
  cJSON *json = tcp_scene_write_shown(scene);
  char *text = cJSON_PrintUnformatted(json);
  cJSON_Delete(json);
  return text;
}

tcs_picture *tcs_picture_new(tcs_job *job) {
  tcs_picture *picture = g_new0(tcs_picture, 1);
  picture->references = 1;
  picture->revision = job->revision;
  picture->final = job->final;
  picture->classification = job->scene.classification;
  picture->step = job->scene.sampling.step;
  picture->image = g_bytes_ref(job->image);
  picture->marks = job->marks;
  job->marks = NULL;
  picture->scene = shown_scene(&job->scene);
  memcpy(picture->shown, job->shown, sizeof picture->shown);
  picture->header = (tcp_frame_header){
      .width = job->out_width,
      .height = job->out_height,
      .format = job->scene.image.format == TC_FORMAT_PNG ? "png" : "jpeg",
      .quality = job->scene.image.format == TC_FORMAT_PNG ? 100 : job->scene.image.quality,
      .final = job->final,
      .bridged = job->bridged,
      .queue_ms = job->queue_ms,
      .tables_ms = job->stats.tables_ms + job->stats.skip_ms,
      .render_ms = job->stats.render_ms,
      .encode_ms = job->encode_ms,
      .scene = picture->scene,
      .volume = picture->shown,
  };
  if (job->scene.error_meter.pixels && tc_meter_refuses(&job->scene, picture->unmeasured, sizeof picture->unmeasured))
    picture->header.unmeasured = picture->unmeasured;
  return picture;
}
