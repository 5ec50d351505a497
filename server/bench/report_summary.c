/* Evaluation of the rows: Pareto fronts, cheapest settings within a bound, observed orders. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "server/bench/report.h"
#include "server/bench/timing.h"

const double tcs_report_bounds[TCS_REPORT_BOUNDS] = {1.0 / 255, 1e-3, 1e-4};
const char *const tcs_report_bound_names[TCS_REPORT_BOUNDS] = {"1/255", "1/1000", "1e-4"};

static const tcs_report_row *row_at(const GArray *rows, guint i) { return &g_array_index(rows, tcs_report_row, i); }

double tcs_report_error(const tcs_report_row *r) { return r->rays > 1 ? r->area_rms : r->rms; }
double tcs_report_error_max(const tcs_report_row *r) { return r->rays > 1 ? r->area_max : r->max; }

bool tcs_report_plain(const tcs_report_row *r) {
  return r->rays == 1 && !r->coherence && !r->jitter && r->termination == 0 && r->table_size == 0 &&
         r->table_bits == 0 && !strcmp(r->filter, "linear") && !strcmp(r->order, "front-to-back");
}

void tcs_report_steady(GArray *rows, guint first) {
  guint count = rows->len - first;
  if (count == 0) return;
  double *anchors = g_new(double, count);
  for (guint i = 0; i < count; i++) anchors[i] = row_at(rows, first + i)->anchor_ms;
  tcs_sort(anchors, count);
  for (guint i = first; i < rows->len; i++) {
    tcs_report_row *r = &g_array_index(rows, tcs_report_row, i);
    r->time_ms = r->render_ms * (r->anchor_ms > 0 ? anchors[count / 2] / r->anchor_ms : 1);
  }
  g_free(anchors);
}

static bool measured(const tcs_report_row *r, const char *scene) { return r->runs > 0 && !strcmp(r->scene, scene); }

/* Other filters have other reference pictures, so only rows of the linear filter compete. */
static bool competes(const tcs_report_row *r, const char *scene) {
  return measured(r, scene) && !strcmp(r->filter, "linear") && isfinite(tcs_report_error(r));
}

static int faster(const void *a, const void *b, void *data) {
  const tcs_report_row *x = row_at(data, *(const guint *)a), *y = row_at(data, *(const guint *)b);
  return (x->time_ms > y->time_ms) - (x->time_ms < y->time_ms);
}

static GArray *by_time(const GArray *rows, const char *scene) {
  GArray *order = g_array_new(FALSE, FALSE, sizeof(guint));
  for (guint i = 0; i < rows->len; i++)
    if (competes(row_at(rows, i), scene)) g_array_append_val(order, i);
  g_array_sort_with_data(order, faster, (gpointer)rows);
  return order;
}

GArray *tcs_report_front(const GArray *rows, const char *scene) {
  GArray *order = by_time(rows, scene), *front = g_array_new(FALSE, FALSE, sizeof(guint));
  double best = INFINITY;
  for (guint i = 0; i < order->len; i++) {
    guint row = g_array_index(order, guint, i);
    double e = tcs_report_error(row_at(rows, row));
    if (e < best) g_array_append_val(front, row), best = e;
  }
  g_array_free(order, TRUE);
  return front;
}

typedef enum methods { ALL, FIRST_ORDER, HIGHER_ORDER } methods;

static bool among(const tcs_report_row *r, methods which) {
  return which == ALL || !strcmp(tcs_report_expected(r->classification), "1") == (which == FIRST_ORDER);
}

static int cheapest_of(const GArray *rows, const char *scene, double bound, bool maximum, methods which) {
  GArray *order = by_time(rows, scene);
  int found = -1;
  for (guint i = 0; found < 0 && i < order->len; i++) {
    guint row = g_array_index(order, guint, i);
    const tcs_report_row *r = row_at(rows, row);
    if (among(r, which) && (maximum ? tcs_report_error_max : tcs_report_error)(r) < bound) found = (int)row;
  }
  g_array_free(order, TRUE);
  return found;
}

int tcs_report_cheapest(const GArray *rows, const char *scene, double bound, bool maximum) {
  return cheapest_of(rows, scene, bound, maximum, ALL);
}

static void say_row(GString *out, const tcs_report_row *r) {
  char *title = tcs_report_row_title(r);
  g_string_append_printf(out, "%s (%.3g ms)", title, r->time_ms);
  g_free(title);
}

char *tcs_report_conclusion(const GArray *rows, const char *scene) {
  const double bound = tcs_report_bounds[0];
  GString *out = g_string_new(NULL);
  GArray *front = tcs_report_front(rows, scene); /* the last row has the least error */
  int best = tcs_report_cheapest(rows, scene, bound, false);
  if (best >= 0) {
    const tcs_report_row *fastest = row_at(rows, (guint)best);
    const char *others = among(fastest, FIRST_ORDER) ? "higher" : "first";
    int other = cheapest_of(rows, scene, bound, false, among(fastest, FIRST_ORDER) ? HIGHER_ORDER : FIRST_ORDER);
    g_string_append(out, "Fastest under 1/255: ");
    say_row(out, fastest);
    if (other >= 0) {
      g_string_append_printf(out, ", %.2g times faster than the best %s-order setting: ",
                             row_at(rows, (guint)other)->time_ms / fastest->time_ms, others);
      say_row(out, row_at(rows, (guint)other));
    } else {
      g_string_append_printf(out, "; no %s-order setting comes under it", others);
    }
  } else if (front->len > 0) {
    const tcs_report_row *least = row_at(rows, g_array_index(front, guint, front->len - 1));
    g_string_append_printf(out, "No setting stays under 1/255; the least rms is %.2g: ", tcs_report_error(least));
    say_row(out, least);
  }
  if (out->len > 0) g_string_append_c(out, '.');
  g_array_free(front, TRUE);
  return g_string_free(out, FALSE);
}

static int finer(const void *a, const void *b) {
  double x = (*(const tcs_report_row *const *)a)->step, y = (*(const tcs_report_row *const *)b)->step;
  return (x > y) - (x < y);
}

int tcs_report_line(const GArray *rows, const char *scene, const char *backend, const char *classification,
                    const char *filter, const tcs_report_row *line[TCS_REPORT_STEPS]) {
  int n = 0;
  for (guint i = 0; i < rows->len && n < TCS_REPORT_STEPS; i++) {
    tcs_report_row plain = *row_at(rows, i);
    if (!measured(&plain, scene) || strcmp(plain.backend, backend) || strcmp(plain.classification, classification) ||
        strcmp(plain.filter, filter))
      continue;
    g_strlcpy(plain.filter, "linear", sizeof plain.filter);
    if (tcs_report_plain(&plain) && isfinite(plain.rms)) line[n++] = row_at(rows, i);
  }
  qsort(line, (size_t)n, sizeof *line, finer);
  return n;
}

bool tcs_report_slope(const GArray *rows, const char *scene, const char *backend, const char *classification,
                      double *slope) {
  const tcs_report_row *line[TCS_REPORT_STEPS];
  double sx = 0, sy = 0, sxx = 0, sxy = 0, first = 0;
  int all = tcs_report_line(rows, scene, backend, classification, "linear", line), n = 0;
  for (int i = 0; i < all; i++) {
    double x = log2(line[i]->step), y = log2(line[i]->rms);
    if (!(line[i]->rms > TCS_REPORT_FLOOR)) continue;
    if (n == 0) first = x;
    if (x > first + 3.01) break;
    n++, sx += x, sy += y, sxx += x * x, sxy += x * y;
  }
  if (n < 3) return false;
  *slope = (n * sxy - sx * sy) / (n * sxx - sx * sx);
  return true;
}

const char *tcs_report_expected(const char *classification) {
  static const struct {
    const char *name, *order;
  } expected[] = {
      {"preintegrated", "2"}, {"preintegrated2", "3"}, {"approximate", "2"}, {"post", "1"}, {"linearized", "1"}};
  for (size_t i = 0; i < G_N_ELEMENTS(expected); i++)
    if (!strcmp(expected[i].name, classification)) return expected[i].order;
  return "";
}

static cJSON *cheapest_json(const GArray *rows, const char *scene) {
  cJSON *list = cJSON_CreateArray();
  for (int maximum = 0; maximum < 2; maximum++)
    for (int b = 0; b < TCS_REPORT_BOUNDS; b++) {
      cJSON *entry = cJSON_CreateObject();
      int row = tcs_report_cheapest(rows, scene, tcs_report_bounds[b], maximum);
      cJSON_AddStringToObject(entry, "measure", maximum ? "max" : "rms");
      cJSON_AddStringToObject(entry, "bound", tcs_report_bound_names[b]);
      if (row < 0)
        cJSON_AddNullToObject(entry, "key");
      else
        cJSON_AddStringToObject(entry, "key", row_at(rows, (guint)row)->key);
      cJSON_AddItemToArray(list, entry);
    }
  return list;
}

static bool listed(const cJSON *list, const tcs_report_row *r) {
  const cJSON *entry;
  cJSON_ArrayForEach(entry, list) if (!strcmp(cJSON_GetObjectItem(entry, "backend")->valuestring, r->backend) &&
                                      !strcmp(cJSON_GetObjectItem(entry, "classification")->valuestring,
                                              r->classification)) return true;
  return false;
}

static cJSON *slopes_json(const GArray *rows, const char *scene) {
  cJSON *list = cJSON_CreateArray();
  for (guint i = 0; i < rows->len; i++) {
    const tcs_report_row *r = row_at(rows, i);
    double slope;
    if (!measured(r, scene) || listed(list, r)) continue;
    cJSON *entry = cJSON_CreateObject();
    cJSON_AddStringToObject(entry, "backend", r->backend);
    cJSON_AddStringToObject(entry, "classification", r->classification);
    if (tcs_report_slope(rows, scene, r->backend, r->classification, &slope))
      cJSON_AddNumberToObject(entry, "observed", slope);
    else
      cJSON_AddNullToObject(entry, "observed");
    cJSON_AddStringToObject(entry, "expected", tcs_report_expected(r->classification));
    cJSON_AddItemToArray(list, entry);
  }
  return list;
}

cJSON *tcs_report_summary(const GArray *rows, const char *scene) {
  cJSON *json = cJSON_CreateObject(), *keys = cJSON_AddArrayToObject(json, "front");
  GArray *front = tcs_report_front(rows, scene);
  for (guint i = 0; i < front->len; i++)
    cJSON_AddItemToArray(keys, cJSON_CreateString(row_at(rows, g_array_index(front, guint, i))->key));
  g_array_free(front, TRUE);
  cJSON_AddItemToObject(json, "cheapest", cheapest_json(rows, scene));
  cJSON_AddItemToObject(json, "orders", slopes_json(rows, scene));
  return json;
}
