/* The page: what the rows say, for people. Everything is inline; nothing is fetched. */
#include <math.h>
#include <string.h>

#include "renderer/embedded.h"
#include "server/cli/report.h"
#include "server/cli/report_svg.h"

typedef struct page {
  GString *out;
  const GArray *rows;
  const cJSON *scenes;
} page;

/* The one member in which a row differs from the usual. */
typedef enum away { PLAIN, TERMINATION, TABLE, RAYS, FILTER, ORDER, JITTER, SEVERAL } away;

static const tcs_report_row *row_at(const page *p, guint i) { return &g_array_index(p->rows, tcs_report_row, i); }
static const char *text_of(const cJSON *json, const char *name) {
  const cJSON *item = cJSON_GetObjectItemCaseSensitive(json, name);
  return cJSON_IsString(item) ? item->valuestring : "";
}

static int color_of(const char *classification) {
  for (size_t i = 0; i < TC_CLASSIFICATION_COUNT; i++)
    if (!strcmp(tc_classification_names[i], classification)) return (int)i;
  return TCS_CHART_COLORS - 1;
}

static away away_of(const tcs_report_row *r) {
  const bool differs[] = {false,
                          r->termination > 0,
                          r->table_size > 0 || r->table_bits > 0,
                          r->rays > 1 || r->coherence,
                          strcmp(r->filter, "linear") != 0,
                          strcmp(r->order, "front-to-back") != 0,
                          r->jitter != 0};
  away found = PLAIN;
  for (int i = PLAIN + 1; i < SEVERAL; i++)
    if (differs[i]) found = found == PLAIN ? (away)i : SEVERAL;
  return found;
}

static void away_label(const tcs_report_row *r, char *label, gulong size) {
  switch (away_of(r)) {
  case TERMINATION:
    g_snprintf(label, size, "%.2g", r->termination);
    break;
  case TABLE:
    if (r->table_bits)
      g_strlcpy(label, r->table_bits == 8 ? "8 bit" : "half", size);
    else
      g_snprintf(label, size, "%g", r->table_size);
    break;
  case RAYS:
    g_snprintf(label, size, "%g rays%s", r->rays, r->coherence ? ", coherent" : "");
    break;
  case FILTER:
    g_strlcpy(label, r->filter, size);
    break;
  case ORDER:
    g_strlcpy(label, r->order, size);
    break;
  case JITTER:
    g_strlcpy(label, "jitter", size);
    break;
  case PLAIN:
  case SEVERAL:
    g_strlcpy(label, "usual", size);
    break;
  }
}

/* The usual strategy at one voxel's step, where single members are varied. */
static bool at_base(const tcs_report_row *r, const char *scene) {
  return !strcmp(r->scene, scene) && !strcmp(r->backend, "cpu") &&
         !strcmp(r->classification, tc_classification_names[0]) && r->step == 1;
}

static const tcs_report_row *find_away(const page *p, const char *scene, const char *label) {
  for (guint i = 0; i < p->rows->len; i++) {
    char own[48];
    away_label(row_at(p, i), own, sizeof own);
    if (at_base(row_at(p, i), scene) && away_of(row_at(p, i)) != SEVERAL && !strcmp(own, label)) return row_at(p, i);
  }
  return NULL;
}

/* ---- tables ---- */

/* On a phone a table is stacked cell by cell, or as a grid scrolls sideways. */
static void open_table(page *p, const char *kind, const char *const *heads, guint count) {
  g_string_append_printf(p->out, "<div class=\"wide\"><table class=\"%s\"><thead><tr>", kind);
  for (guint i = 0; i < count; i++) {
    g_string_append(p->out, "<th>");
    tcs_html_text(p->out, heads[i]);
    g_string_append(p->out, "</th>");
  }
  g_string_append(p->out, "</tr></thead><tbody>\n");
}

static void close_table(page *p) { g_string_append(p->out, "</tbody></table></div>\n"); }

static void open_row(page *p, const cJSON *scene) {
  int number = 1;
  for (const cJSON *before = p->scenes->child; before && before != scene; before = before->next)
    number++;
  g_string_append_printf(p->out, "<tr><th scope=\"row\"><a href=\"#scene-%d\">", number);
  tcs_html_text(p->out, text_of(scene, "title"));
  g_string_append(p->out, "</a></th>");
}

static void open_cell(page *p, const char *label) {
  g_string_append(p->out, "<td data-label=\"");
  tcs_html_text(p->out, label);
  g_string_append(p->out, "\">");
}

static void cheapest_table(page *p, bool maximum) {
  const char *heads[1 + TCS_REPORT_BOUNDS] = {"scene"};
  for (int b = 0; b < TCS_REPORT_BOUNDS; b++)
    heads[1 + b] = tcs_report_bound_names[b];
  g_string_append(p->out, maximum ? "<h3>Every compared pixel under the bound</h3>\n"
                                  : "<h3>Root mean square under the bound</h3>\n");
  open_table(p, "stack", heads, G_N_ELEMENTS(heads));
  const cJSON *scene;
  cJSON_ArrayForEach(scene, p->scenes) {
    open_row(p, scene);
    for (int b = 0; b < TCS_REPORT_BOUNDS; b++) {
      int best = tcs_report_cheapest(p->rows, text_of(scene, "name"), tcs_report_bounds[b], maximum);
      open_cell(p, heads[1 + b]);
      if (best < 0) {
        g_string_append(p->out, "none</td>");
        continue;
      }
      const tcs_report_row *r = row_at(p, (guint)best);
      char *title = tcs_report_row_title(r);
      g_string_append_printf(
          p->out,
          "<b>%.3g ms</b> %s<small>rms %.2g, 99.9 %% under %.2g, max %.2g, &#916;E %.2g, SSIM %.4f</small></td>",
          r->time_ms, title, tcs_report_error(r), tcs_report_error_p999(r), tcs_report_error_max(r), r->ciede, r->ssim);
      g_free(title);
    }
    g_string_append(p->out, "</tr>\n");
  }
  close_table(p);
}

static void cheapest(page *p) {
  g_string_append(
      p->out,
      "<h2>Cheapest setting under a bound</h2>\n<p>The fastest of all measured settings whose error against the "
      "reference stays under the bound; colours and opacity count from 0 to 1. &#916;E is the mean CIEDE2000 of the "
      "picture as shown.</p>\n");
  cheapest_table(p, false);
  cheapest_table(p, true);
}

static bool any_row(const page *p, const char *classification) {
  for (guint i = 0; i < p->rows->len; i++)
    if (!strcmp(row_at(p, i)->classification, classification)) return true;
  return false;
}

static void orders(page *p) {
  const char *heads[1 + TC_CLASSIFICATION_COUNT] = {"scene"}, *names[TC_CLASSIFICATION_COUNT];
  char labels[TC_CLASSIFICATION_COUNT][64];
  guint count = 0;
  for (size_t i = 0; i < TC_CLASSIFICATION_COUNT; i++) {
    if (!any_row(p, tc_classification_names[i])) continue;
    g_snprintf(labels[count], sizeof *labels, "%s, expected %s", tc_classification_names[i],
               tcs_report_expected(tc_classification_names[i]));
    heads[1 + count] = labels[count];
    names[count++] = tc_classification_names[i];
  }
  g_string_append(
      p->out,
      "<h2>Observed orders of convergence</h2>\n<p>Slope of the error over the step, finest three octaves above single "
      "precision, cpu back end. The expected order holds where field and transfer function are smooth along a ray; "
      "what "
      "each scene does to it stands with the scene.</p>\n");
  open_table(p, "stack", heads, 1 + count);
  const cJSON *scene;
  cJSON_ArrayForEach(scene, p->scenes) {
    open_row(p, scene);
    for (guint i = 0; i < count; i++) {
      double slope, expected = g_ascii_strtod(tcs_report_expected(names[i]), NULL);
      open_cell(p, heads[1 + i]);
      bool known = tcs_report_slope(p->rows, text_of(scene, "name"), "cpu", names[i], &slope);
      bool worse = known && cJSON_IsTrue(cJSON_GetObjectItem(scene, "smooth")) && slope < expected - 0.15;
      if (known)
        g_string_append_printf(p->out, "%s%.2f%s</td>", worse ? "<b class=\"worse\">" : "", slope,
                               worse ? " short</b>" : "");
      else
        g_string_append(p->out, "-</td>");
    }
    g_string_append(p->out, "</tr>\n");
  }
  close_table(p);
}

/* One member varied, all scenes: a column a value. */
static void matrix(page *p, away which, const char *title, const char *words) {
  enum { MOST = 16 };
  char labels[MOST][48];
  const char *heads[2 + MOST] = {"scene", "usual"};
  guint count = 0;
  for (guint i = 0; i < p->rows->len && count < MOST; i++) {
    const tcs_report_row *r = row_at(p, i);
    bool seen = away_of(r) != which || !at_base(r, r->scene);
    away_label(r, labels[count], sizeof *labels);
    for (guint k = 0; k < count && !seen; k++)
      seen = !strcmp(labels[k], labels[count]);
    if (!seen) heads[2 + count] = labels[count], count++;
  }
  if (count == 0) return;
  g_string_append_printf(p->out, "<h3>%s</h3>\n<p>%s</p>\n", title, words);
  open_table(p, "grid", heads, 2 + count);
  const cJSON *scene;
  cJSON_ArrayForEach(scene, p->scenes) {
    const tcs_report_row *usual = find_away(p, text_of(scene, "name"), "usual");
    open_row(p, scene);
    for (guint i = 0; i <= count; i++) {
      const tcs_report_row *r = find_away(p, text_of(scene, "name"), heads[1 + i]);
      open_cell(p, heads[1 + i]);
      if (r && usual) {
        double e = which == RAYS          ? r->area_rms
                   : which == TERMINATION ? r->ended_rms
                                          : r->rms,
               most = which == RAYS          ? r->area_max
                      : which == TERMINATION ? r->ended_max
                                             : r->max;
        g_string_append_printf(p->out, "%.2g<small>max %.2g</small><small>time %.2f</small></td>", e, most,
                               r->time_ms / usual->time_ms);
      } else {
        g_string_append(p->out, "-</td>");
      }
    }
    g_string_append(p->out, "</tr>\n");
  }
  close_table(p);
}

static void matrices(page *p) {
  g_string_append(p->out, "<h2>What single choices cost</h2>\n<p>Pre-integrated, step of one voxel, cpu; one member "
                          "away from the usual. Each "
                          "cell: rms, largest error, and time as a multiple of the usual's.</p>\n");
  matrix(p, TERMINATION, "Early termination",
         "A ray ends once less than this share of what lies behind it would be seen; usual: never. What that alone "
         "changes: differences from the usual's picture, not from the reference. No pixel's may be more than the "
         "threshold.");
  matrix(p, TABLE, "Size and precision of the table",
         "Entries a side of the pre-integration table, and entries rounded to half floats and to 8 bits; usual: the "
         "size the plan chooses, "
         "single precision.");
  matrix(p, RAYS, "Rays per pixel",
         "Against the mean over the pixel's area, the truth that more rays go to; edges weigh most. "
         "The compared picture has fewer, larger pixels than the timed one: the more there is to gain.");
  matrix(p, FILTER, "Filter",
         "Each against the reference of its own field: what the method adds, not which field is nicer.");
  matrix(p, ORDER, "Order of compositing", "Rays that end nowhere: both orders must agree.");
  matrix(p, JITTER, "Jitter", "Rays start a fraction of a step apart: rings become noise of the same size.");
}

/* ---- charts ---- */

static void cloud(page *p, const char *scene) {
  tcs_chart chart = {.title = "Error against run time",
                     .x_label = "ms a frame",
                     .y_label = "rms error",
                     .guides = tcs_report_bounds,
                     .guide_names = tcs_report_bound_names,
                     .n_guides = TCS_REPORT_BOUNDS,
                     .caption = "Stairs: the Pareto front. Varied: one choice away from the usual."};
  for (guint i = 0; i < p->rows->len; i++) {
    const tcs_report_row *r = row_at(p, i);
    if (strcmp(r->scene, scene) || strcmp(r->filter, "linear")) continue; /* another field, another truth */
    char name[64], *title = tcs_report_row_title(r),
                   *tip = g_strdup_printf("%s: %.3g ms, rms %.2g", title, r->time_ms, tcs_report_error(r));
    g_snprintf(name, sizeof name, "%s, %s%s", r->classification, r->backend, tcs_report_plain(r) ? "" : ", varied");
    tcs_series *s = tcs_chart_series(&chart, name);
    if (s) {
      s->color = color_of(r->classification), s->shape = s->color % TCS_CHART_SHAPES;
      s->hollow = !strcmp(r->backend, "gl"), s->small = !tcs_report_plain(r);
    }
    tcs_series_add(s, r->time_ms, tcs_report_error(r), 0, 0, tip);
    g_free(tip);
    g_free(title);
  }
  GArray *front = tcs_report_front(p->rows, scene), *stairs = g_array_new(FALSE, FALSE, sizeof(tcs_point));
  for (guint i = 0; i < front->len; i++) {
    const tcs_report_row *r = row_at(p, g_array_index(front, guint, i));
    tcs_point at = {.x = r->time_ms, .y = fmax(tcs_report_error(r), 1e-9)};
    g_array_append_val(stairs, at);
  }
  chart.front = stairs;
  tcs_chart_write(&chart, p->out);
  g_array_free(stairs, TRUE);
  g_array_free(front, TRUE);
}

static void convergence(page *p, const cJSON *json) {
  const char *scene = text_of(json, "name");
  tcs_chart chart = {.title = "Convergence",
                     .x_label = "step, voxels",
                     .octaves = true,
                     .y_label = "rms error",
                     .caption = "Slope: observed (expected)."};
  for (guint i = 0; i < p->rows->len; i++) {
    const tcs_report_row *r = row_at(p, i);
    if (strcmp(r->scene, scene) || !tcs_report_plain(r)) continue;
    double slope;
    char name[64], tip[96], observed[16] = "-";
    if (tcs_report_slope(p->rows, scene, r->backend, r->classification, &slope))
      g_snprintf(observed, sizeof observed, "%.2f", slope);
    g_snprintf(name, sizeof name, "%s, %s: %s (%s)", r->classification, r->backend, observed,
               tcs_report_expected(r->classification));
    g_snprintf(tip, sizeof tip, "%s, %s, step %g: rms %.3g", r->classification, r->backend, r->step, r->rms);
    tcs_series *s = tcs_chart_series(&chart, name);
    if (s) {
      s->color = color_of(r->classification), s->shape = s->color % TCS_CHART_SHAPES, s->line = true;
      s->hollow = s->dashed = !strcmp(r->backend, "gl");
    }
    tcs_series_add(s, r->step, r->rms, r->rms_lo, r->rms_hi, tip);
  }
  tcs_chart_write(&chart, p->out);
}

static void losses(page *p, const cJSON *scene) {
  char **lines = g_strsplit(text_of(scene, "loss"), "\n", -1);
  if (*lines) g_string_append(p->out, "<h3>Orders short of the expected, and why</h3>\n<ul>\n");
  for (char **line = lines; *line && **line; line++) {
    g_string_append(p->out, "<li>");
    tcs_html_text(p->out, *line);
    g_string_append(p->out, "</li>\n");
  }
  if (*lines) g_string_append(p->out, "</ul>\n");
  g_strfreev(lines);
}

static int step_look(double step) { return step == 1 ? 0 : step < 1 ? 2 : 1; }

static bool varies(const tcs_report_row *r, const char *scene, away which) {
  return !strcmp(r->scene, scene) && away_of(r) == which && !strcmp(r->backend, "cpu") &&
         !strcmp(r->classification, tc_classification_names[0]);
}

/* Series by step of the table's sizes; its precisions are one point each. */
static void table_chart(page *p, const char *scene) {
  tcs_chart chart = {
      .title = "Table: size and precision", .x_label = "entries a side", .octaves = true, .y_label = "rms error"};
  for (guint i = 0; i < p->rows->len; i++) {
    const tcs_report_row *r = row_at(p, i);
    if (!varies(r, scene, TABLE)) continue;
    char name[64], tip[96];
    if (r->table_bits)
      g_snprintf(name, sizeof name, "%s, step %g", r->table_bits == 8 ? "8 bit" : "half floats", r->step);
    else
      g_snprintf(name, sizeof name, "step %g", r->step);
    g_snprintf(tip, sizeof tip, "%s: rms %.3g, max %.3g, %.3g ms", name, r->rms, r->max, r->time_ms);
    tcs_series *s = tcs_chart_series(&chart, name);
    if (s) {
      s->color = s->shape = r->table_bits == 8 ? 4 : r->table_bits == 16 ? 3 : step_look(r->step);
      s->line = r->table_bits == 0;
    }
    tcs_series_add(s, r->table_nodes, r->rms, 0, 0, tip);
  }
  tcs_chart_write(&chart, p->out);
}

/* Both of the same setting without the threshold: how far a pixel is from it, and the share of its time. */
static void termination_chart(page *p, const char *scene) {
  tcs_chart chart = {.title = "Early termination: cost and gain",
                     .x_label = "threshold of transparency",
                     .y_label = "largest difference; share of time",
                     .caption = "Beside the same setting that ends no ray."};
  for (int times = 0; times < 2; times++)
    for (guint i = 0; i < p->rows->len; i++) {
      const tcs_report_row *r = row_at(p, i), *line[TCS_REPORT_STEPS];
      if (!varies(r, scene, TERMINATION)) continue;
      double share = 0;
      for (int n = tcs_report_line(p->rows, scene, r->backend, r->classification, "linear", line); n-- > 0;)
        if (line[n]->step == r->step) share = r->time_ms / line[n]->time_ms;
      char name[64], tip[96];
      g_snprintf(name, sizeof name, "%s, step %g", times ? "time" : "difference", r->step);
      g_snprintf(tip, sizeof tip, "step %g, threshold %.2g: %.2g at most, rms %.2g, time %.2f", r->step, r->termination,
                 r->ended_max, r->ended_rms, share);
      tcs_series *s = tcs_chart_series(&chart, name);
      if (s) s->color = s->shape = step_look(r->step), s->line = true, s->dashed = s->hollow = times;
      tcs_series_add(s, r->termination, times ? share : r->ended_max, 0, 0, tip);
    }
  tcs_chart_write(&chart, p->out);
}

static void scene_section(page *p, const cJSON *scene, int number) {
  const char *name = text_of(scene, "name");
  const cJSON *volume = cJSON_GetObjectItem(scene, "volume"), *dims = cJSON_GetObjectItem(volume, "dims");
  int side = cJSON_GetObjectItem(scene, "side")->valueint;
  g_string_append_printf(p->out, "<section class=\"scene\" id=\"scene-%d\"><h2>", number);
  tcs_html_text(p->out, text_of(scene, "title"));
  g_string_append(p->out, "</h2>\n<p>");
  tcs_html_text(p->out, text_of(scene, "why"));
  g_string_append(p->out, "</p>\n<p class=\"soft\">");
  tcs_html_text(p->out, name);
  g_string_append_printf(p->out,
                         ", %d x %d x %d %s voxels. Compared: %d x %d pixels (n = %d rays), whiskers: 95 %% "
                         "interval of the rms.</p>\n<div class=\"charts\">\n",
                         cJSON_GetArrayItem(dims, 0)->valueint, cJSON_GetArrayItem(dims, 1)->valueint,
                         cJSON_GetArrayItem(dims, 2)->valueint, text_of(volume, "type"), side, side, side * side);
  cloud(p, name);
  convergence(p, scene);
  termination_chart(p, name);
  table_chart(p, name);
  g_string_append(p->out, "</div>\n");
  losses(p, scene);
  g_string_append(p->out, "</section>\n");
}

/* ---- head and foot ---- */

static void head(page *p, const cJSON *about) {
  const cJSON *machine = cJSON_GetObjectItem(about, "machine"), *scene;
  int size = cJSON_GetObjectItem(about, "size")->valueint, number = 0;
  g_string_append(
      p->out,
      "<h1>Error against run time</h1>\n<p>How far each way of rendering is from the exact rendering integral, and "
      "what it "
      "costs. Pictures are compared with a double-precision reference that takes no steps; times are medians of frames "
      "taken in turn, in the same run.</p>\n<p class=\"soft\">");
  g_string_append_printf(p->out, "Tomocast %s. cpu: ", text_of(about, "version"));
  tcs_html_text(p->out, text_of(machine, "cpu"));
  g_string_append_printf(p->out, ", %s, %d threads. gl: ", text_of(machine, "isa"),
                         cJSON_GetObjectItem(machine, "threads")->valueint);
  tcs_html_text(p->out, *text_of(machine, "gl") ? text_of(machine, "gl") : "none");
  g_string_append_printf(p->out, ". %u settings; timed at %d x %d pixels%s.%s</p>\n<nav>", p->rows->len, size, size,
                         cJSON_IsTrue(cJSON_GetObjectItem(about, "quick")) ? ", quick selection" : "",
                         cJSON_IsTrue(cJSON_GetObjectItem(about, "complete"))
                             ? ""
                             : " <b>Interrupted: not all settings were measured.</b>");
  cJSON_ArrayForEach(scene, p->scenes) {
    g_string_append_printf(p->out, "<a href=\"#scene-%d\">", ++number);
    tcs_html_text(p->out, text_of(scene, "title"));
    g_string_append(p->out, "</a>");
  }
  g_string_append(p->out, "</nav>\n");
}

static void foot(page *p, bool quick, const cJSON *left_out) {
  const cJSON *entry;
  g_string_append(
      p->out,
      "<h2>How it was measured</h2>\n<p>rms, 99.9th percentile and maximum are of premultiplied colour and opacity, 0 "
      "to 1, "
      "before the background and the 8 bits of a picture; CIEDE2000 and SSIM of the picture as shown. "
      "Settings of one ray a pixel are compared with the ray through the pixel's centre, settings of more with the "
      "mean over "
      "the pixel's area (4 x 4 reference rays for a random 16th of the pixels). Every batch of eight settings holds "
      "one "
      "anchor; times are scaled by it, so that a machine that slows down does not bend the front. report.json and "
      "report.csv hold every figure.</p>\n");
  g_string_append(
      p->out,
      quick ? "<p>Swept: every classification at steps of 2 to 0.25 voxels on the cpu, preintegrated2 from 4, and "
              "pre-integrated on gl; at a step of 1, pre-integrated on the cpu, one other choice at a time; at 0.25, "
              "tables of 1024 entries a side. Without --quick much more is.</p>\n"
            : "<p>Swept, on both back ends: every classification at steps of 4 to 0.125 voxels with 1 to 16 rays a "
              "pixel, all combined; and of the pre-integrated ones, at steps of 2, 1 and 0.5, one other choice at a "
              "time: order, filter, jitter, coherence of four rays, termination, size and precision of the table; at "
              "0.125, the largest table. Not combined: several of these.</p>\n");
  if (cJSON_GetArraySize(left_out)) g_string_append(p->out, "<h3>Left out</h3>\n<ul>\n");
  cJSON_ArrayForEach(entry, left_out) {
    g_string_append(p->out, "<li>");
    tcs_html_text(p->out, text_of(entry, "why"));
    g_string_append(p->out, "</li>\n");
  }
  if (cJSON_GetArraySize(left_out)) g_string_append(p->out, "</ul>\n");
}

char *tcs_report_html(const cJSON *about, const cJSON *scenes, const cJSON *left_out, const GArray *rows) {
  static const char mark[] = "<!--BODY-->";
  const char *frame = (const char *)tcs_report_files[0].bytes, *at = strstr(frame, mark);
  page p = {g_string_new_len(frame, at - frame), rows, scenes};
  const cJSON *scene;
  int number = 0;
  head(&p, about);
  cheapest(&p);
  orders(&p);
  matrices(&p);
  cJSON_ArrayForEach(scene, scenes) scene_section(&p, scene, ++number);
  foot(&p, cJSON_IsTrue(cJSON_GetObjectItem(about, "quick")), left_out);
  g_string_append(p.out, at + strlen(mark));
  return g_string_free(p.out, FALSE);
}
