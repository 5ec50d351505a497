#include "server/bench/edits.h"

#include <stdio.h>

#include "server/bench/timing.h"

enum { FRAMES = 12, FIRST = 5 }; /* the first frames allocate memory that later ones reuse */

typedef void (*edit_knots)(tc_transfer_function *tf, int frame);

static double width_of(const tc_transfer_function *tf) {
  const double width = tf->points[tf->count - 1].value - tf->points[0].value;
  return width > 0 ? width : 1;
}

static void slide_knot(tc_transfer_function *tf, int frame) {
  const size_t i = tf->count / 2;
  const double room = i + 1 < tf->count ? tf->points[i + 1].value - tf->points[i].value : width_of(tf);
  tf->points[i].value += 0.5 * room * frame / FRAMES;
}

static void shift_knots(tc_transfer_function *tf, int frame) {
  const double by = 0.05 * width_of(tf) * frame / FRAMES;
  for (size_t i = 0; i < tf->count; i++) tf->points[i].value += by;
}

static void change_preset(tc_transfer_function *tf, int frame) {
  size_t count;
  const tc_preset *presets = tc_presets(&count);
  const double lo = tf->points[0].value;
  tc_transfer_function_set_preset(tf, presets[(size_t)frame % count].name, lo, lo + width_of(tf));
}

static bool measure(tc_renderer *renderer, tc_volume *volume, const tc_scene *scene, edit_knots change, tcs_edit *edit,
                    GError **error) {
  double tables[FRAMES], skips[FRAMES];
  tc_frame frame = {0};
  bool good = true;
  for (int i = 0; good && i < FRAMES; i++) {
    tc_scene edited;
    tc_scene_copy(&edited, scene);
    tc_scene_set_points(&edited,
                        g_memdup2(scene->transfer_function.points, scene->transfer_function.count * sizeof(tc_knot)),
                        scene->transfer_function.count);
    change(&edited.transfer_function, i + 1);
    good = tc_render(renderer, volume, &edited, NULL, &frame, error);
    tables[i] = frame.stats.tables_ms;
    skips[i] = frame.stats.skip_ms;
    tc_scene_clear(&edited);
  }
  tc_frame_finish(&frame);
  if (!good) return false;
  edit->tables_ms = tcs_median(tables + FIRST, FRAMES - FIRST);
  edit->skip_ms = tcs_median(skips + FIRST, FRAMES - FIRST);
  return true;
}

bool tcs_edits_measure(tc_renderer *renderer, tc_volume *volume, const tc_scene *scene, tcs_edit edits[TCS_EDITS],
                       GError **error) {
  static const struct {
    const char *name;
    edit_knots change;
  } all[TCS_EDITS] = {
      {"a knot slides", slide_knot}, {"all knots shift", shift_knots}, {"presets change", change_preset}};
  for (int i = 0; i < TCS_EDITS; i++) {
    edits[i].name = all[i].name;
    if (!measure(renderer, volume, scene, all[i].change, &edits[i], error)) return false;
  }
  return true;
}

void tcs_edits_print(const tcs_edit edits[TCS_EDITS]) {
  for (int i = 0; i < TCS_EDITS; i++)
    printf("  %-20s %9.2f %9.2f\n", edits[i].name, edits[i].tables_ms, edits[i].skip_ms);
}

cJSON *tcs_edits_as_json(const tcs_edit edits[TCS_EDITS]) {
  cJSON *list = cJSON_CreateArray();
  for (int i = 0; i < TCS_EDITS; i++) {
    cJSON *o = cJSON_CreateObject();
    cJSON_AddStringToObject(o, "edit", edits[i].name);
    cJSON_AddNumberToObject(o, "tablesMs", edits[i].tables_ms);
    cJSON_AddNumberToObject(o, "skipMs", edits[i].skip_ms);
    cJSON_AddItemToArray(list, o);
  }
  return list;
}
