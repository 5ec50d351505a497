/* Why errors fall more slowly than the orders that hold for smooth scenes, said from what was measured. */
#include <math.h>
#include <string.h>

#include "server/cli/report.h"

#define SHORT 0.15     /* of the expected order, before words are due */
#define STALLED 0.75   /* an octave of the step leaves more of the error than this */
#define BY_TABLE 0.7   /* a doubled table leaves less of it than this */
#define EXACT 2e-5     /* rms under which nothing is worth a word */

static double extinction(const tc_transfer_function *tf, double amount) {
  return tf->kind == TC_KNOT_EXTINCTION ? amount : -log1p(-fmin(amount, 1 - 0x1p-24)) / tf->unit_distance_mm;
}

cJSON *tcs_report_roughness(const tcs_report_scene *scene) {
  const tc_transfer_function *tf = &scene->scene.transfer_function;
  const double *spacing = tc_volume_describe(scene->volume)->spacing;
  const tc_volume_stats *range = tc_volume_statistics(scene->volume);
  int knots = 0, jumps = 0;
  double densest = 0;
  for (size_t i = 0; i < tf->count; i++) {
    const tc_knot *k = &tf->points[i];
    knots += k->value > range->min && k->value < range->max;
    jumps += i > 0 && k->value == k[-1].value && k->amount != k[-1].amount;
    densest = fmax(densest, extinction(tf, k->amount));
  }
  cJSON *json = cJSON_CreateObject();
  cJSON_AddNumberToObject(json, "knots", knots);
  cJSON_AddNumberToObject(json, "jumps", jumps);
  cJSON_AddNumberToObject(json, "depth", densest * fmin(spacing[0], fmin(spacing[1], spacing[2])));
  return json;
}

static double number_of(const cJSON *json, const char *name) {
  const cJSON *item = cJSON_GetObjectItemCaseSensitive(json, name);
  return cJSON_IsNumber(item) ? item->valuedouble : 0;
}

/* The cpu back end's row of the usual classification that is plain but for the table asked for; NULL: not measured. */
static const tcs_report_row *find(const GArray *rows, const char *scene, double step, double table_size) {
  for (guint i = 0; i < rows->len; i++) {
    const tcs_report_row *r = &g_array_index(rows, tcs_report_row, i);
    tcs_report_row plain = *r;
    plain.table_size = 0;
    if (r->runs > 0 && !strcmp(r->scene, scene) && !strcmp(r->backend, "cpu") &&
        !strcmp(r->classification, "preintegrated") && tcs_report_plain(&plain) && r->step == step &&
        r->table_size == table_size)
      return r;
  }
  return NULL;
}

static bool falls_short(const GArray *rows, const char *scene) {
  static const char *const names[] = {"preintegrated", "preintegrated2", "approximate", "post"};
  for (size_t i = 0; i < G_N_ELEMENTS(names); i++) {
    double slope, expected = g_ascii_strtod(tcs_report_expected(names[i]), NULL);
    if (tcs_report_slope(rows, scene, "cpu", names[i], &slope) && slope < expected - SHORT) return true;
  }
  return false;
}

static void say_what_is_rough(GString *out, const cJSON *rough) {
  double knots = number_of(rough, "knots"), jumps = number_of(rough, "jumps"), depth = number_of(rough, "depth");
  g_string_append(
      out,
      "Orders fall short where a ray is not smooth within a step: the interpolated field bends at every cell face");
  if (knots > 0) g_string_append_printf(out, ", the transfer function at %.0f knot%s", knots, knots > 1 ? "s" : "");
  if (jumps > 0) g_string_append_printf(out, ", where it jumps %.0f time%s", jumps, jumps > 1 ? "s" : "");
  g_string_append(
      out,
      ". Such a step's error is of the second order however exact the method, and of the first where samples are classified.");
  if (depth > 20)
    g_string_append_printf(
        out,
        " A voxel of the densest value has an optical depth of %.2g: where a ray first touches it is all that is "
        "seen, sampled to within a step.",
        depth);
}

/* Where smaller steps no longer help: is it the table? */
static void say_what_is_left(GString *out, const GArray *rows, const char *scene) {
  static const double steps[] = {0.125, 0.25, 0.5, 1, 2};
  for (size_t i = 0; i + 1 < G_N_ELEMENTS(steps); i++) {
    const tcs_report_row *fine = find(rows, scene, steps[i], 0), *coarse = find(rows, scene, steps[i + 1], 0);
    if (!fine || !coarse) continue;
    if (!(fine->rms > EXACT) || fine->rms < STALLED * coarse->rms) return;
    g_string_append_printf(out, " Below a step of %g the pre-integrated error stays at an rms of %.2g", steps[i + 1],
                           fine->rms);
    const tcs_report_row *half = find(rows, scene, 0.5, 512), *whole = find(rows, scene, 0.5, 1024);
    if (!half || !whole) half = find(rows, scene, 1, 64), whole = find(rows, scene, 1, 256);
    if (half && whole && whole->rms < BY_TABLE * half->rms)
      g_string_append_printf(
          out, ": the table's own, which has %.0f entries a side (at a step of %g, %.0f leave %.2g, %.0f leave %.2g)",
          fine->table_nodes, half->step, half->table_size, half->rms, whole->table_size, whole->rms);
    g_string_append(out, ".");
    return;
  }
}

char *tcs_report_loss(const GArray *rows, const cJSON *scene) {
  const char *name = cJSON_GetObjectItemCaseSensitive(scene, "name")->valuestring;
  GString *out = g_string_new(NULL);
  if (falls_short(rows, name)) {
    if (!cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(scene, "smooth")))
      say_what_is_rough(out, cJSON_GetObjectItemCaseSensitive(scene, "roughness"));
    say_what_is_left(out, rows, name);
  }
  return g_string_free(out, FALSE);
}
