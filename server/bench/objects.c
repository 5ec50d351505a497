#include "server/bench/objects.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "renderer/reference/reference.h"
#include "server/cli/cli.h"

#define TIE 1.05 /* ratio of times below which neither is faster and the scene does not count */

/* A scene for every combination of a threshold (share of the way from the fitted surface to the largest value) and a
 * view. */
static const double thresholds[] = {0, 0.2, 0.45};
static const struct view {
  double azimuth, elevation, zoom;
  int size;
} views[] = {{30, 20, 1.3, 512}, {200, 40, 3, 384}, {50, 30, 1.3, 256}, {80, 0, 1.3, 192}, {120, -10, 0.8, 96}};

/* The shortest of several frames per mode, taken in turn, after one that builds the resources. */
static bool time_object(tcs_object *o, tc_renderer *renderer, tc_volume *volume, tc_scene *scene, int runs,
                        GError **error) {
  tc_frame frame = {0};
  bool good = true;
  for (int i = 0; i <= runs && good; i++)
    for (int m = 0; m < TC_OBJECT_MODES && good; m++) {
      scene->mode = tc_object_mode_of((tc_object_mode)m);
      good = tc_render(renderer, volume, scene, NULL, &frame, error);
      o->samples[m] = (double)frame.stats.samples;
      if (!i) o->build_ms[m] = frame.stats.coefficients_ms + frame.stats.tables_ms + frame.stats.skip_ms;
      if (i == 0 || frame.stats.render_ms < o->ms[m]) o->ms[m] = i ? frame.stats.render_ms : INFINITY;
    }
  tc_frame_finish(&frame);
  return good;
}

bool tcs_object_measure(tc_renderer *renderer, tc_volume *volume, const tc_scene *scene, int runs, tcs_object *o,
                        GError **error) {
  tc_explanation plan;
  *o = (tcs_object){0};
  for (int calls = 0; calls == 0 || (plan.has_object && !plan.object_measured && calls < 100); calls++)
    if (!tc_renderer_explain(renderer, volume, scene, NULL, &plan, error)) return false;
  if (!plan.has_object) {
    tc_set_error(error, TC_ERROR_INVALID, "/mode", "an opaque object over a volume with a grid expected");
    return false;
  }
  o->cost = plan.object;
  tc_scene own;
  tc_scene_copy(&own, scene);
  const bool good = time_object(o, renderer, volume, &own, runs, error);
  tc_scene_clear(&own);
  return good;
}

bool tcs_object_judge(tc_renderer *renderer, tc_volume *volume, const tc_scene *scene, int side, tcs_object *o,
                      GError **error) {
  const tc_render_request request = {.width = side, .height = side, .want_linear = true};
  tcs_look look = {.linear_light = scene->image.linear_light};
  memcpy(look.background, scene->image.background, sizeof look.background);
  tc_frame frame = {0};
  tc_scene own;
  tc_scene_copy(&own, scene);
  own.mode = TC_MODE_ISOSURFACE;
  tc_reference *reference = tc_reference_new(volume, &own, side, side, 0, error);
  float *truth = g_new(float, 4 * (size_t)side * (size_t)side);
  bool good = reference && tc_reference_image(reference, tc_renderer_about(renderer)->threads, truth, error);
  for (int m = 0; m < TC_OBJECT_MODES && good; m++) {
    own.mode = tc_object_mode_of((tc_object_mode)m);
    good = tc_render(renderer, volume, &own, &request, &frame, error);
    if (!good || tcs_compare(frame.linear, truth, side, side, &look, &o->off[m])) continue;
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "comparing pictures: out of memory");
    good = false;
  }
  tc_frame_finish(&frame);
  tc_reference_free(reference);
  tc_scene_clear(&own);
  g_free(truth);
  return good;
}

void tcs_object_scene(const tc_volume *volume, double share, int size, tc_scene *scene) {
  tc_fit fit;
  tc_fit_find(&fit, volume);
  const double value = fit.surface + share * (fit.stretch.high - fit.surface);
  tc_scene_init(scene);
  tc_scene_fit(scene, volume);
  tc_scene_light(scene, true);
  scene->image.width = scene->image.height = size;
  scene->isosurface.value = scene->splat.threshold[0] = value;
  scene->splat.threshold[1] = fmax(tc_volume_statistics(volume)->max, value);
  scene->mode = TC_MODE_SPLAT;
}

static tc_object_mode fastest(const double ms[TC_OBJECT_MODES], int ways) {
  int best = 0;
  for (int m = 1; m < ways; m++)
    if (ms[m] < ms[best]) best = m;
  return (tc_object_mode)best;
}

static void put(cJSON *json, const char *name, double value) { cJSON_AddNumberToObject(json, name, value); }

static cJSON *difference_json(const tcs_difference *d) {
  cJSON *json = cJSON_CreateObject();
  put(json, "rms", d->rms), put(json, "rmsLow", d->rms_lo), put(json, "rmsHigh", d->rms_hi);
  put(json, "p999", d->p999), put(json, "max", d->max);
  put(json, "ciede2000", d->ciede), put(json, "ssim", d->ssim);
  return json;
}

cJSON *tcs_object_json(const tcs_object *o, const tc_scene *scene) {
  cJSON *json = cJSON_CreateObject(), *ms = cJSON_AddObjectToObject(json, "ms"),
        *samples = cJSON_AddObjectToObject(json, "samples"),
        *build = cJSON_AddObjectToObject(json, "buildMs"),
        *expected = cJSON_AddObjectToObject(json, "expectedMs"),
        *errors = o->off[0].pixels ? cJSON_AddObjectToObject(json, "errors") : NULL;
  put(json, "threshold", scene->isosurface.value);
  put(json, "size", scene->image.width);
  for (int m = 0; m < TC_OBJECT_MODES; m++) {
    const char *mode = tc_mode_names[tc_object_mode_of((tc_object_mode)m)];
    put(ms, mode, o->ms[m]);
    put(samples, mode, o->samples[m]);
    put(build, mode, o->build_ms[m]);
    put(expected, mode, o->cost.ms[m]);
    if (errors) cJSON_AddItemToObject(errors, mode, difference_json(&o->off[m]));
  }
  cJSON_AddItemToObject(json, "terms", cJSON_CreateDoubleArray(o->cost.terms, TC_TERM_COUNT));
  /* Among the two that draw voxels and rays; and among all three. */
  cJSON_AddBoolToObject(json, "named", fastest(o->ms, 2) == fastest(o->cost.ms, 2));
  cJSON_AddBoolToObject(json, "namedOfThree", fastest(o->ms, 3) == fastest(o->cost.ms, 3));
  return json;
}

static double number(const cJSON *json, const char *name) { return cJSON_GetObjectItem(json, name)->valuedouble; }

static void print_object(const char *name, const cJSON *json) {
  const cJSON *ms = cJSON_GetObjectItem(json, "ms"), *expected = cJSON_GetObjectItem(json, "expectedMs");
  printf("%-22.22s %8.4g %5g", name, number(json, "threshold"), number(json, "size"));
  for (int m = 0; m < TC_OBJECT_MODES; m++) {
    const char *mode = tc_mode_names[tc_object_mode_of((tc_object_mode)m)];
    printf("  %7.2f %7.2f", number(ms, mode), number(expected, mode));
  }
  printf("  %s%s\n", cJSON_IsTrue(cJSON_GetObjectItem(json, "named")) ? "" : "splats or rays: no  ",
         cJSON_IsTrue(cJSON_GetObjectItem(json, "namedOfThree")) ? "" : "of three: no");
  fflush(stdout);
}

/* Measures one view. NULL with *error. */
static cJSON *take_view(int runs, tc_renderer *renderer, tc_volume *volume, double share, const struct view *v,
                        GError **error) {
  tc_scene scene;
  tcs_object o;
  tcs_object_scene(volume, share, v->size, &scene);
  tcs_cli_place_camera(volume, v->azimuth, v->elevation, v->zoom, &scene.camera);
  cJSON *json =
      tcs_object_measure(renderer, volume, &scene, runs, &o, error) ? tcs_object_json(&o, &scene) : NULL;
  tc_scene_clear(&scene);
  return json;
}

bool tcs_objects_volume(const tcs_objects_run *run, tc_volume *volume, const char *name, cJSON *report,
                        GError **error) {
  const tc_renderer_options options = {
      .backend = TC_BACKEND_CPU, .threads = run->threads, .isa = run->isa, .cache_bytes = 2u << 30};
  tc_renderer *renderer = tc_renderer_new(&options, error);
  bool good = renderer != NULL;
  if (run->print && !cJSON_GetArraySize(report))
    printf("%-22s %8s %5s  %15s  %15s  %15s\n%-37s  %15s  %15s  %15s\n", "volume", "value", "size", "splat",
           "isosurface", "mesh", "", "ms      plan", "ms      plan", "ms      plan");
  for (size_t t = 0; t < G_N_ELEMENTS(thresholds) && good; t++)
    for (size_t v = 0; v < G_N_ELEMENTS(views) && good; v++) {
      cJSON *json = take_view(run->runs, renderer, volume, thresholds[t], &views[v], error);
      if (!(good = json != NULL)) break;
      cJSON_AddStringToObject(json, "volume", name);
      cJSON_AddItemToArray(report, json);
      if (run->print) print_object(name, json);
    }
  tc_renderer_free(renderer);
  return good;
}

void tcs_objects_end(const tcs_objects_run *run, const cJSON *report) {
  int two = 0, three = 0, ties = 0;
  const cJSON *scene;
  cJSON_ArrayForEach(scene, report) {
    const bool named = cJSON_IsTrue(cJSON_GetObjectItem(scene, "named"));
    const cJSON *ms = cJSON_GetObjectItem(scene, "ms");
    const double splat = number(ms, "splat"), rays = number(ms, "isosurface");
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
