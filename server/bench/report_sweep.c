/* Chooses the settings to measure from the scene's enums and the plan, so that new features are included automatically.
 */
#include <string.h>

#include "server/bench/report.h"

static const double full_steps[] = {4, 2, 1, 0.5, 0.25, 0.125}, quick_steps[] = {2, 1, 0.5, 0.25};
static const double away_steps[] = {2, 1, 0.5}; /* steps at which one other member is varied */
static const int full_rays[] = {1, 2, 4, 5, 8, 16}, quick_rays[] = {1};
static const int full_tables[] = {64, 128, 256, 512, 1024, 2048}, quick_tables[] = {64, 256};
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

/* Adds the setting if the plan accepts it. */
static void add(sweep *w, const tcs_setting *s) {
  tc_scene scene;
  GError *error = NULL;
  tc_scene_copy(&scene, &w->scene->scene);
  tcs_setting_apply(s, &scene);
  if (tc_plan_check(w->scene->volume, &scene, 64, 64, NULL, &error)) {
    g_array_append_val(w->settings, *s);
  } else {
    const char *pointer = tc_error_pointer(error);
    tcs_report_leave_out(w->left_out, pointer ? pointer + 1 : "setting", error->message);
    g_error_free(error);
  }
  tc_scene_clear(&scene);
}

#define EACH(i, quick_list, full_list)                                                                                 \
  for (size_t i = 0; i < (w->quick ? G_N_ELEMENTS(quick_list) : G_N_ELEMENTS(full_list)); i++)
#define PICK(i, quick_list, full_list) (w->quick ? quick_list[i] : full_list[i])

/* Varies one member at a time. */
static void vary(sweep *w, tcs_setting usual) {
  tcs_setting s = usual;
  for (int order = 0; order < TC_ORDER_COUNT; order++)
    if (order != (int)usual.order) s.order = (tc_compositing_order)order, add(w, &s), s = usual;
  for (int filter = 0; filter < TC_FILTER_COUNT; filter++)
    if (filter != (int)usual.filter) s.filter = (tc_filter)filter, add(w, &s), s = usual;
  s.jitter = true, add(w, &s), s = usual;
  s.rays = 4;
  if (w->quick) add(w, &s); /* otherwise already in the product of steps and rays */
  s.coherence = true, add(w, &s), s = usual;
  EACH(i, quick_terminations, full_terminations)
  s.termination = PICK(i, quick_terminations, full_terminations), add(w, &s), s = usual;
  EACH(i, quick_tables, full_tables) s.table_size = PICK(i, quick_tables, full_tables), add(w, &s), s = usual;
  for (int bits = 8; bits <= 16; bits += 8) s.table_bits = bits, add(w, &s), s = usual;
}

GArray *tcs_report_settings(const tcs_report_scene *scene, bool quick, bool gl, cJSON *left_out) {
  sweep all = {scene, left_out, g_array_new(FALSE, FALSE, sizeof(tcs_setting)), quick}, *w = &all;
  for (int b = TC_BACKEND_CPU; b <= (gl ? TC_BACKEND_GL : TC_BACKEND_CPU); b++)
    for (int c = 0; c < TC_CLASSIFICATION_COUNT; c++) {
      tcs_setting s = {.backend = (tc_backend)b, .classification = (tc_classification)c};
      if (quick && b == TC_BACKEND_GL && c != TC_PREINTEGRATED) continue; /* in software gl takes half a minute */
      s.rays = 1;
      if (quick && c == TC_PREINTEGRATED2) s.step = 4, add(w, &s); /* of order 3: finer steps soon leave no error */
      EACH(i, quick_steps, full_steps)
      EACH(k, quick_rays, full_rays) {
        s.step = PICK(i, quick_steps, full_steps), s.rays = PICK(k, quick_rays, full_rays);
        add(w, &s);
      }
      bool tables = c == TC_PREINTEGRATED || c == TC_PREINTEGRATED2;
      s.rays = 1;
      if (b == TC_BACKEND_CPU && (tables || !quick)) { /* the table's part of the error at the finest step */
        s.step = quick ? 0.25 : 0.125, s.table_size = quick ? 1024 : tables ? 2048 : 4096;
        add(w, &s);
        s.table_size = 0;
      }
      for (size_t i = 0; i < G_N_ELEMENTS(away_steps); i++) {
        s.step = away_steps[i];
        if (quick ? s.step == 1 && c == TC_PREINTEGRATED && b == TC_BACKEND_CPU : tables) vary(w, s);
      }
    }
  return all.settings;
}
