#include "server/bench/objects.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "renderer/plan/object_cost.h"
#include "server/cli/cli.h"

#define TIE 1.05 /* where times differ by less, neither is the faster and the scene is not counted */

/* A scene of every combination that a list names: shares of the fitted surface's way to the largest value, and views.
 */
static const double thresholds[] = {0, 0.2, 0.45};
static const struct view {
  double azimuth, elevation, zoom;
  int size;
} views[] = {{30, 20, 1.3, 512}, {200, 40, 3, 384}, {50, 30, 1.3, 256}, {80, 0, 1.3, 192}, {120, -10, 0.8, 96}};

typedef struct object {
  const tcs_objects_run *run;
  tc_renderer *renderer;
  tc_volume *volume;
  tc_scene scene;
  double ms[TC_OBJECT_MODES];
  tc_object_cost cost;
} object;

/* The least of several frames of each way, in turn, after one that builds. */
static bool measure(object *o, GError **error) {
  tc_frame frame = {0};
  bool good = true;
  for (int i = 0; i <= o->run->runs && good; i++)
    for (int m = 0; m < TC_OBJECT_MODES && good; m++) {
      o->scene.mode = tc_object_mode_of((tc_object_mode)m);
      good = tc_render(o->renderer, o->volume, &o->scene, NULL, &frame, NULL, error);
      if (i == 0 || (i > 0 && frame.stats.render_ms < o->ms[m])) o->ms[m] = i ? frame.stats.render_ms : INFINITY;
    }
  tc_frame_finish(&frame);
  return good;
}

static tc_object_mode fastest(const double ms[TC_OBJECT_MODES], int ways) {
  int best = 0;
  for (int m = 1; m < ways; m++)
    if (ms[m] < ms[best]) best = m;
  return (tc_object_mode)best;
}

static void add(const object *o, const char *name, cJSON *report) {
  cJSON *json = cJSON_CreateObject(), *ms = cJSON_AddObjectToObject(json, "ms"),
        *expected = cJSON_AddObjectToObject(json, "expectedMs");
  cJSON_AddStringToObject(json, "volume", name);
  cJSON_AddNumberToObject(json, "threshold", o->scene.isosurface.value);
  cJSON_AddNumberToObject(json, "size", o->scene.image.width);
  for (int m = 0; m < TC_OBJECT_MODES; m++) {
    const char *mode = tc_mode_names[tc_object_mode_of((tc_object_mode)m)];
    cJSON_AddNumberToObject(ms, mode, o->ms[m]);
    cJSON_AddNumberToObject(expected, mode, o->cost.ms[m]);
  }
  cJSON_AddItemToObject(json, "terms", cJSON_CreateDoubleArray(o->cost.terms, TC_TERM_COUNT));
  /* Of the two that draw voxels and rays; and of all three. */
  const bool two = fastest(o->ms, 2) == fastest(o->cost.ms, 2), three = fastest(o->ms, 3) == fastest(o->cost.ms, 3);
  cJSON_AddBoolToObject(json, "named", two);
  cJSON_AddBoolToObject(json, "namedOfThree", three);
  cJSON_AddItemToArray(report, json);
  if (!o->run->print) return;
  printf("%-22.22s %8.4g %5d", name, o->scene.isosurface.value, o->scene.image.width);
  for (int m = 0; m < TC_OBJECT_MODES; m++)
    printf("  %7.2f %7.2f", o->ms[m], o->cost.ms[m]);
  printf("  %s%s\n", two ? "" : "splats or rays: no  ", three ? "" : "of three: no");
  fflush(stdout);
}

static bool take_view(object *o, const tc_fit *fit, double share, const struct view *v, GError **error) {
  const tc_volume_stats *range = tc_volume_statistics(o->volume);
  const double value = fit->surface + share * (fit->stretch.high - fit->surface);
  tc_scene_init(&o->scene);
  tc_scene_fit(&o->scene, o->volume);
  tc_scene_light(&o->scene, true);
  tcs_cli_place_camera(o->volume, v->azimuth, v->elevation, v->zoom, &o->scene.camera);
  o->scene.image.width = o->scene.image.height = v->size;
  o->scene.isosurface.value = o->scene.splat.threshold[0] = value;
  o->scene.splat.threshold[1] = fmax(range->max, value);
  o->scene.mode = TC_MODE_SPLAT;
  return tc_object_cost_of(o->volume, &o->scene, v->size, v->size, &o->cost) && measure(o, error);
}

bool tcs_objects_volume(const tcs_objects_run *run, tc_volume *volume, const char *name, cJSON *report,
                        GError **error) {
  const tc_renderer_options options = {.backend = TC_BACKEND_CPU, .threads = run->threads, .cache_bytes = 2u << 30};
  object o = {.run = run, .renderer = tc_renderer_new(&options, error), .volume = volume};
  bool good = o.renderer != NULL;
  tc_fit fit;
  tc_fit_find(&fit, volume);
  if (run->print && !cJSON_GetArraySize(report))
    printf("%-22s %8s %5s  %15s  %15s  %15s\n%-37s  %15s  %15s  %15s\n", "volume", "value", "size", "splat",
           "isosurface", "mesh", "", "ms      plan", "ms      plan", "ms      plan");
  for (size_t t = 0; t < G_N_ELEMENTS(thresholds) && good; t++)
    for (size_t v = 0; v < G_N_ELEMENTS(views) && good; v++) {
      good = take_view(&o, &fit, thresholds[t], &views[v], error);
      if (good) add(&o, name, report);
      tc_scene_clear(&o.scene);
    }
  tc_renderer_free(o.renderer);
  return good;
}

void tcs_objects_end(const tcs_objects_run *run, const cJSON *report) {
  int two = 0, three = 0, ties = 0;
  const cJSON *scene;
  cJSON_ArrayForEach(scene, report) {
    const bool named = cJSON_IsTrue(cJSON_GetObjectItem(scene, "named"));
    const cJSON *ms = cJSON_GetObjectItem(scene, "ms");
    const double splat = cJSON_GetObjectItem(ms, "splat")->valuedouble,
                 rays = cJSON_GetObjectItem(ms, "isosurface")->valuedouble;
    const bool tie = fmax(splat, rays) < TIE * fmin(splat, rays);
    two += named && !tie, ties += tie;
    three += cJSON_IsTrue(cJSON_GetObjectItem(scene, "namedOfThree"));
  }
  if (run->print)
    printf(
        "the faster of splats and rays is named in %d of %d scenes (in %d more they differ by less than %.0f %%), of "
        "splats, rays and mesh in %d of all\n",
        two, cJSON_GetArraySize(report) - ties, ties, 100 * (TIE - 1), three);
}
