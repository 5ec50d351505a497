/* Explains from the measurements why errors fall more slowly than the orders that hold for smooth scenes. */
#include <math.h>
#include <string.h>

#include "server/bench/report.h"

#define SHORT 0.15   /* shortfall of the order that needs an explanation */
#define STALLED 0.75 /* if the finest octave keeps more of the error than this, it is a floor */
#define LESS 0.7     /* ratio of errors below which another row counts as better */
#define RISING 0.1   /* increase of the order from one octave to the next that counts as rising */
#define SINGLE 1e-5  /* rms that sums in single precision can cause */
#define DEEP 2       /* optical depth of a step above which no order shows */
#define DIFFER 0.15  /* difference between the orders of cpu and gl above which both are reported */

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

/* One classification on one back end, by ascending step. */
typedef struct line {
  const tcs_report_row *at[TCS_REPORT_STEPS];
  int n;         /* all plain rows */
  int low, high; /* rows used for the slope: above single precision, within three octaves */
  double slope;  /* NAN: too few rows */
} line;

static line line_of(const GArray *rows, const char *scene, const char *backend, const char *classification,
                    const char *filter) {
  line l = {.slope = NAN};
  l.n = tcs_report_line(rows, scene, backend, classification, filter, l.at);
  tcs_report_slope(rows, scene, backend, classification, &l.slope);
  while (l.low < l.n && !(l.at[l.low]->rms > TCS_REPORT_FLOOR)) l.low++;
  for (l.high = l.low; l.high + 1 < l.n && l.at[l.high + 1]->step <= 8.02 * l.at[l.low]->step; l.high++)
    ;
  return l;
}

/* The order over the octave (or more) above row i. */
static double order_above(const line *l, int i) {
  return log2(l->at[i + 1]->rms / l->at[i]->rms) / log2(l->at[i + 1]->step / l->at[i]->step);
}

/* The row equal to `like` except for its table, the largest with more entries; NULL: none. */
static const tcs_report_row *larger_table(const GArray *rows, const tcs_report_row *like) {
  const tcs_report_row *best = NULL;
  for (guint i = 0; i < rows->len; i++) {
    const tcs_report_row *r = &g_array_index(rows, tcs_report_row, i);
    tcs_report_row plain = *r;
    plain.table_size = 0;
    if (r->runs > 0 && r->step == like->step && r->table_size > (best ? best->table_size : like->table_nodes) &&
        !strcmp(r->scene, like->scene) && !strcmp(r->backend, like->backend) &&
        !strcmp(r->classification, like->classification) && tcs_report_plain(&plain))
      best = r;
  }
  return best;
}

/* Whether the table is indexed by segments (two values) instead of single values. */
static bool of_segments(const tcs_report_row *row) { return g_str_has_prefix(row->classification, "preintegrated"); }

/* Whether the table limits the finest steps: reports that, or which larger table did not help. */
static bool say_table(GString *out, const GArray *rows, const line *l) {
  const tcs_report_row *finest = l->at[l->low], *own = NULL, *large = NULL;
  for (int i = l->low; i <= l->high && !large; i++) own = l->at[i], large = larger_table(rows, own);
  if (large && large->rms < LESS * own->rms) {
    g_string_append_printf(
        out, ". It is the table's: at a step of %g, %.0f entries%s leave %.2g, the usual %.0f leave %.2g", own->step,
        large->table_nodes, of_segments(own) ? " a side" : "", large->rms, own->table_nodes, own->rms);
    return true;
  }
  const line none = line_of(rows, finest->scene, finest->backend, "approximate", "linear");
  for (int i = 0; i < none.n && of_segments(finest); i++)
    if (none.at[i]->step == finest->step && none.at[i]->rms < LESS * finest->rms) {
      g_string_append_printf(
          out, ". It is the table's: approximate, without one of segments, leaves %.2g at a step of %g, this %.2g",
          none.at[i]->rms, finest->step, finest->rms);
      return true;
    }
  if (large && large->rms * LESS > own->rms)
    g_string_append_printf(out, ". At a step of %g, %.0f entries without the plan's subtables leave more, %.2g",
                           own->step, large->table_nodes, large->rms);
  else if (large)
    g_string_append_printf(out, ". Not for want of entries: at a step of %g, %.0f leave %.2g", own->step,
                           large->table_nodes, large->rms);
  return false;
}

/* Whether the finest octave has a higher order than all others. */
static bool rises(const line *l) {
  for (int i = l->low + 1; i < l->high; i++)
    if (order_above(l, l->low) < order_above(l, i) + RISING) return false;
  return true;
}

/* Reports what limits one classification. True: the roughness of the scene, which is reported once for all. */
static bool say_line(GString *out, const GArray *rows, const line *l, double depth) {
  const tcs_report_row *finest = l->at[l->low];
  const char *on = strcmp(l->at[0]->backend, "cpu") ? " on gl" : "";
  if (isnan(l->slope)) {
    g_string_append_printf(out, "%s%s: fewer than three steps leave more than single precision's rms of %g.\n",
                           l->at[0]->classification, on, TCS_REPORT_FLOOR);
    return false;
  }
  g_string_append_printf(out, "%s%s: order ", finest->classification, on);
  for (int i = l->high - 1; i >= l->low; i--)
    g_string_append_printf(out, "%s%.2f", i < l->high - 1 ? ", " : "", order_above(l, i));
  g_string_append_printf(out, " from octave to octave, steps of %g to %g", l->at[l->high]->step, finest->step);
  bool floor = finest->rms > STALLED * l->at[l->low + 1]->rms, rough = true;
  double deep = depth * finest->step;
  if (floor) g_string_append_printf(out, ": a floor of %.2g", finest->rms);
  if (say_table(out, rows, l))
    rough = false;
  else if (deep > DEEP && !of_segments(finest))
    g_string_append_printf(out, ". A step of %g is up to %.2g deep; orders show where it is under 1", finest->step,
                           deep),
        rough = false;
  if (rough && !floor && rises(l)) g_string_append(out, ". Still rising");
  if (rough && floor && finest->rms < SINGLE)
    g_string_append(out, ". Sums in single precision come to that"), rough = false;
  g_string_append(out, ".\n");
  return rough;
}

static void say_what_is_rough(GString *out, const GArray *rows, const cJSON *scene) {
  const cJSON *rough = cJSON_GetObjectItemCaseSensitive(scene, "roughness");
  double knots = number_of(rough, "knots"), jumps = number_of(rough, "jumps"), depth = number_of(rough, "depth");
  g_string_append(out, "Not smooth along a ray: the interpolated field, at every cell face");
  if (knots > 0)
    g_string_append_printf(out, "; the transfer function, at %.0f knot%s between faces", knots, knots > 1 ? "s" : "");
  if (jumps > 0) g_string_append_printf(out, ", where it jumps %.0f time%s", jumps, jumps > 1 ? "s" : "");
  g_string_append(
      out,
      ". A step across a bend is of the second order at best however exact the method, across a jump of the first, "
      "and of none where a ray grazes it.");
  const char *name = cJSON_GetObjectItemCaseSensitive(scene, "name")->valuestring;
  const line linear = line_of(rows, name, "cpu", "preintegrated2", "linear"),
             cubic = line_of(rows, name, "cpu", "preintegrated2", "cubic");
  for (int i = linear.low; i < linear.high && cubic.high > cubic.low; i++) {
    const tcs_report_row *fine = cubic.at[cubic.low], *coarse = cubic.at[cubic.low + 1];
    double bent = order_above(&linear, i), free = order_above(&cubic, cubic.low);
    if (linear.at[i]->step == fine->step && linear.at[i + 1]->step == coarse->step && free > bent + 0.3)
      g_string_append_printf(out,
                             " The faces are much of it: under the cubic filter, whose field bends nowhere, "
                             "preintegrated2 is of order %.2f from a step of %g to %g, under the linear one of %.2f.",
                             free, coarse->step, fine->step, bent);
  }
  if (depth > 20)
    g_string_append_printf(
        out, " A voxel of the densest value is %.2g deep: where a ray first touches it is all that is seen.", depth);
}

char *tcs_report_loss(const GArray *rows, const cJSON *scene) {
  const char *name = cJSON_GetObjectItemCaseSensitive(scene, "name")->valuestring;
  double depth = number_of(cJSON_GetObjectItemCaseSensitive(scene, "roughness"), "depth");
  bool rough = false;
  GString *out = g_string_new(NULL);
  for (size_t c = 0; c < TC_CLASSIFICATION_COUNT; c++) {
    const char *classification = tc_classification_names[c];
    double expected = g_ascii_strtod(tcs_report_expected(classification), NULL);
    const line cpu = line_of(rows, name, "cpu", classification, "linear"),
               gl = line_of(rows, name, "gl", classification, "linear");
    bool differ = gl.n >= 3 && !(fabs(gl.slope - cpu.slope) < DIFFER);
    if (cpu.n >= 3 && !(cpu.slope >= expected - SHORT)) rough = say_line(out, rows, &cpu, depth) || rough;
    if (differ && !(gl.slope >= expected - SHORT)) rough = say_line(out, rows, &gl, depth) || rough;
  }
  if (rough && !cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(scene, "smooth"))) say_what_is_rough(out, rows, scene);
  return g_string_free(out, FALSE);
}
