/* Which settings are measured: asked of the scene's own choices and of the plan, so that what is built later joins by
 * itself. */
#include <string.h>

#include "server/cli/report.h"

static const double full_steps[] = {4, 2, 1, 0.5, 0.25, 0.125}, quick_steps[] = {2, 1, 0.5, 0.25};
static const double away_steps[] = {2, 1, 0.5}; /* where one other member is varied */
static const int full_rays[] = {2, 4, 5, 8, 16}, quick_rays[] = {4};
static const int full_tables[] = {64, 128, 256, 512, 1024}, quick_tables[] = {64, 256};
static const double full_terminations[] = {1e-4, 1e-3, 1.0 / 255, 0.01, 0.02, 0.05};
static const double quick_terminations[] = {1e-3, 0.02};

typedef struct sweep {
  const tcs_report_scene *scene;
  cJSON *left_out;
  GArray *settings;
  bool quick;
} sweep;

void tcs_setting_apply(const tcs_setting *s, tc_scene *scene) {
  scene->classification = s->classification;
  scene->order = s->order;
  scene->filter = s->filter;
  scene->sampling.step = s->step;
  scene->sampling.termination = s->termination;
  scene->sampling.rays_per_pixel = s->rays;
  scene->sampling.coherence = s->coherence;
  scene->sampling.jitter = s->jitter;
}

void tcs_report_leave_out(cJSON *left_out, const char *what, const char *why) {
  const cJSON *entry;
  cJSON_ArrayForEach(entry, left_out) if (!strcmp(cJSON_GetObjectItem(entry, "what")->valuestring, what) &&
                                          !strcmp(cJSON_GetObjectItem(entry, "why")->valuestring, why)) return;
  cJSON *made = cJSON_CreateObject();
  cJSON_AddStringToObject(made, "what", what);
  cJSON_AddStringToObject(made, "why", why);
  cJSON_AddItemToArray(left_out, made);
}

/* Adds a setting that the plan accepts. */
static void add(sweep *w, const tcs_setting *s) {
  tc_scene scene;
  tc_plan plan;
  GError *error = NULL;
  tc_scene_copy(&scene, &w->scene->scene);
  tcs_setting_apply(s, &scene);
  if (tc_plan_make(w->scene->volume, &scene, 64, 64, &plan, &error)) {
    g_array_append_val(w->settings, *s);
  } else {
    const char *pointer = tc_error_pointer(error);
    tcs_report_leave_out(w->left_out, pointer ? pointer + 1 : "setting", error->message);
    g_error_free(error);
  }
  tc_scene_clear(&scene);
}

/* One member away from the usual at a time. */
static void vary(sweep *w, tcs_setting usual) {
  const bool quick = w->quick;
#define EACH(i, quick_list, full_list)                                                                                 \
  for (size_t i = 0; i < (quick ? G_N_ELEMENTS(quick_list) : G_N_ELEMENTS(full_list)); i++)
#define PICK(i, quick_list, full_list) (quick ? quick_list[i] : full_list[i])
  tcs_setting s = usual;
  for (int order = 0; order < TC_ORDER_COUNT; order++)
    if (order != (int)usual.order) s.order = (tc_order)order, add(w, &s), s = usual;
  for (int filter = 0; filter < TC_FILTER_COUNT; filter++)
    if (filter != (int)usual.filter) s.filter = (tc_filter)filter, add(w, &s), s = usual;
  s.jitter = true, add(w, &s), s = usual;
  EACH(i, quick_rays, full_rays) {
    s.rays = PICK(i, quick_rays, full_rays), add(w, &s);
    s.coherence = true, add(w, &s), s = usual;
  }
  EACH(i, quick_terminations, full_terminations)
  s.termination = PICK(i, quick_terminations, full_terminations), add(w, &s), s = usual;
  EACH(i, quick_tables, full_tables) s.table_size = PICK(i, quick_tables, full_tables), add(w, &s), s = usual;
  for (int bits = 8; bits <= 16; bits += 8)
    s.table_bits = bits, add(w, &s), s = usual;
}

GArray *tcs_report_settings(const tcs_report_scene *scene, bool quick, bool gl, cJSON *left_out) {
  sweep w = {scene, left_out, g_array_new(FALSE, FALSE, sizeof(tcs_setting)), quick};
  for (int b = TC_BACKEND_CPU; b <= (gl ? TC_BACKEND_GL : TC_BACKEND_CPU); b++)
    for (int c = 0; c < TC_CLASSIFICATION_COUNT; c++) {
      tcs_setting s = {.backend = (tc_backend)b, .classification = (tc_classification)c, .rays = 1};
      if (quick && b == TC_BACKEND_GL && c != TC_PREINTEGRATED) continue; /* in software it takes half of the minute */
      EACH(i, quick_steps, full_steps) s.step = PICK(i, quick_steps, full_steps), add(&w, &s);
      for (size_t i = 0; i < G_N_ELEMENTS(away_steps); i++) {
        s.step = away_steps[i];
        if (!quick || (s.step == 1 && c == TC_PREINTEGRATED && b == TC_BACKEND_CPU)) vary(&w, s);
      }
    }
#undef EACH
#undef PICK
  return w.settings;
}
