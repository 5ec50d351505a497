#include "server/cli/report_svg.h"

#include <math.h>
#include <string.h>

/* Inside of the viewBox; text of 12 units is still read at a phone's width. */
enum { WIDTH = 420, HEIGHT = 290, LEFT = 58, RIGHT = 408, TOP = 10, BOTTOM = 246 };

typedef struct axis {
  double lo, hi; /* log10 */
} axis;
typedef struct canvas {
  GString *out;
  axis x, y;
} canvas;

void tcs_html_text(GString *out, const char *text) {
  char *escaped = g_markup_escape_text(text, -1);
  g_string_append(out, escaped);
  g_free(escaped);
}

tcs_series *tcs_chart_series(tcs_chart *chart, const char *name) {
  for (int i = 0; i < chart->n_series; i++)
    if (!strcmp(chart->series[i].name, name)) return &chart->series[i];
  if (chart->n_series == TCS_CHART_SERIES) return NULL;
  tcs_series *s = &chart->series[chart->n_series++];
  *s = (tcs_series){.points = g_array_new(FALSE, FALSE, sizeof(tcs_point))};
  g_strlcpy(s->name, name, sizeof s->name);
  return s;
}

void tcs_series_add(tcs_series *series, double x, double y, double low, double high, const char *tip) {
  if (!series || !(x > 0) || !(y > 0) || !isfinite(x) || !isfinite(y)) return;
  tcs_point p = {x, y, low, high, ""};
  g_strlcpy(p.tip, tip, sizeof p.tip);
  g_array_append_val(series->points, p);
}

/* ---- axes ---- */

static void widen(axis *a, double v) {
  a->lo = fmin(a->lo, log10(v));
  a->hi = fmax(a->hi, log10(v));
}

/* A margin at both ends, and never less than half a decade in all. */
static void settle(axis *a) {
  double middle = 0.5 * (a->lo + a->hi), half = fmax(0.5 * (a->hi - a->lo) * 1.08, 0.25);
  a->lo = middle - half;
  a->hi = middle + half;
}

static double at_x(const canvas *c, double v) {
  return LEFT + (RIGHT - LEFT) * (log10(v) - c->x.lo) / (c->x.hi - c->x.lo);
}
static double at_y(const canvas *c, double v) {
  double t = (log10(v) - c->y.lo) / (c->y.hi - c->y.lo);
  return BOTTOM - (BOTTOM - TOP) * fmin(fmax(t, 0), 1);
}

/* Ticks at powers of two where asked; else at 1, or at 1, 2 and 5 of each decade where there are few; every so many
 * decades where there are many. */
static void each_tick(const axis *a, bool octaves, void (*draw)(canvas *c, double v), canvas *c) {
  static const double fine[] = {1, 2, 5};
  double decades = a->hi - a->lo;
  if (octaves && decades < 3) {
    for (double e = ceil(a->lo / log10(2)); e * log10(2) <= a->hi; e++)
      draw(c, exp2(e));
    return;
  }
  int per = decades < 2.2 ? 3 : 1, every = (int)ceil(decades / 8);
  for (int d = (int)floor(a->lo); d <= (int)ceil(a->hi); d++) {
    if (d % every) continue;
    for (int i = 0; i < per; i++) {
      double v = fine[i] * pow(10, d), l = log10(v);
      if (l >= a->lo && l <= a->hi) draw(c, v);
    }
  }
}

static void number(GString *out, double v) {
  char digits[G_ASCII_DTOSTR_BUF_SIZE];
  int exponent = (int)floor(log10(v) + 1e-9);
  if (v >= 1e-2 && v < 1e5)
    g_string_append(out, g_ascii_formatd(digits, sizeof digits, "%.4g", v));
  else
    g_string_append_printf(out, "%.0fe%d", v / pow(10, exponent), exponent);
}

static void draw_x(canvas *c, double v) {
  double x = at_x(c, v);
  g_string_append_printf(c->out,
                         "<path class=\"grid\" d=\"M%.1f %dV%d\"/><text x=\"%.1f\" y=\"%d\" text-anchor=\"middle\">", x,
                         TOP, BOTTOM, x, BOTTOM + 15);
  number(c->out, v);
  g_string_append(c->out, "</text>");
}

static void draw_y(canvas *c, double v) {
  double y = at_y(c, v);
  g_string_append_printf(c->out,
                         "<path class=\"grid\" d=\"M%d %.1fH%d\"/><text x=\"%d\" y=\"%.1f\" text-anchor=\"end\">", LEFT,
                         y, RIGHT, LEFT - 5, y + 4);
  number(c->out, v);
  g_string_append(c->out, "</text>");
}

/* ---- marks ---- */

static void marker(GString *out, const tcs_series *s, double x, double y, const char *tip) {
  double r = s->small ? 2.6 : s->hollow ? 5.2 : 3.6; /* a ring lies around the dot of the other back end */
  const char *hollow = s->hollow || s->shape == 4 ? " hollow" : "";
  g_string_append_printf(out, "<path class=\"c%d%s\" d=\"", s->color, hollow);
  switch (s->shape) {
  case 0:
    g_string_append_printf(out, "M%.1f %.1fa%.1f %.1f 0 1 0 %.1f 0a%.1f %.1f 0 1 0 %.1f 0z", x - r, y, r, r, 2 * r, r,
                           r, -2 * r);
    break;
  case 1:
    g_string_append_printf(out, "M%.1f %.1fh%.1fv%.1fh%.1fz", x - r, y - r, 2 * r, 2 * r, -2 * r);
    break;
  case 2:
    g_string_append_printf(out, "M%.1f %.1fL%.1f %.1fH%.1fz", x, y - 1.2 * r, x + 1.1 * r, y + r, x - 1.1 * r);
    break;
  case 3:
    g_string_append_printf(out, "M%.1f %.1fL%.1f %.1fL%.1f %.1fL%.1f %.1fz", x, y - 1.3 * r, x + 1.3 * r, y, x,
                           y + 1.3 * r, x - 1.3 * r, y);
    break;
  default:
    g_string_append_printf(out, "M%.1f %.1fL%.1f %.1fM%.1f %.1fL%.1f %.1f", x - r, y - r, x + r, y + r, x - r, y + r,
                           x + r, y - r);
    break;
  }
  g_string_append(out, "\">");
  if (tip) {
    g_string_append(out, "<title>");
    tcs_html_text(out, tip);
    g_string_append(out, "</title>");
  }
  g_string_append(out, "</path>");
}

static void draw_series(canvas *c, const tcs_series *s) {
  if (s->line && s->points->len > 1) {
    g_string_append_printf(c->out, "<path class=\"c%d path%s\" d=\"", s->color, s->dashed ? " dashed" : "");
    for (guint i = 0; i < s->points->len; i++) {
      const tcs_point *p = &g_array_index(s->points, tcs_point, i);
      g_string_append_printf(c->out, "%c%.1f %.1f", i ? 'L' : 'M', at_x(c, p->x), at_y(c, p->y));
    }
    g_string_append(c->out, "\"/>");
  }
  for (guint i = 0; i < s->points->len; i++) {
    const tcs_point *p = &g_array_index(s->points, tcs_point, i);
    if (p->low > 0 && p->high > p->low)
      g_string_append_printf(c->out, "<path class=\"c%d whisker\" d=\"M%.1f %.1fV%.1f\"/>", s->color, at_x(c, p->x),
                             at_y(c, p->low), at_y(c, p->high));
    marker(c->out, s, at_x(c, p->x), at_y(c, p->y), p->tip);
  }
}

static void draw_front(canvas *c, const GArray *front) {
  if (!front || front->len == 0) return;
  g_string_append(c->out, "<path class=\"front\" d=\"");
  for (guint i = 0; i < front->len; i++) {
    const tcs_point *p = &g_array_index(front, tcs_point, i);
    double x = at_x(c, p->x), y = at_y(c, p->y);
    if (i == 0)
      g_string_append_printf(c->out, "M%.1f %dV%.1f", x, TOP, y);
    else
      g_string_append_printf(c->out, "H%.1fV%.1f", x, y);
  }
  g_string_append_printf(c->out, "H%d\"/>", RIGHT);
}

static void draw_guides(canvas *c, const tcs_chart *chart) {
  for (int i = 0; i < chart->n_guides; i++) {
    double l = log10(chart->guides[i]);
    if (l < c->y.lo || l > c->y.hi) continue;
    double y = at_y(c, chart->guides[i]);
    g_string_append_printf(
        c->out, "<path class=\"guide\" d=\"M%d %.1fH%d\"/><text class=\"halo\" x=\"%d\" y=\"%.1f\">%s</text>", LEFT, y,
        RIGHT, LEFT + 4, y < TOP + 14 ? y + 13 : y - 4, chart->guide_names[i]);
  }
}

static void draw_axes(canvas *c, const tcs_chart *chart) {
  g_string_append_printf(c->out, "<svg viewBox=\"0 0 %d %d\" role=\"img\" aria-label=\"", WIDTH, HEIGHT);
  tcs_html_text(c->out, chart->title);
  g_string_append(c->out, "\">");
  each_tick(&c->x, chart->octaves, draw_x, c);
  each_tick(&c->y, false, draw_y, c);
  g_string_append_printf(c->out,
                         "<path class=\"frame\" d=\"M%d %dV%dH%d\"/><text x=\"%d\" y=\"%d\" text-anchor=\"middle\">",
                         LEFT, TOP, BOTTOM, RIGHT, (LEFT + RIGHT) / 2, HEIGHT - 6);
  tcs_html_text(c->out, chart->x_label);
  g_string_append_printf(c->out, "</text><text transform=\"translate(11 %d) rotate(-90)\" text-anchor=\"middle\">",
                         (TOP + BOTTOM) / 2);
  tcs_html_text(c->out, chart->y_label);
  g_string_append(c->out, "</text>");
}

static void write_legend(GString *out, const tcs_chart *chart) {
  g_string_append(out, "<figcaption>");
  for (int i = 0; i < chart->n_series; i++) {
    const tcs_series *s = &chart->series[i];
    if (s->points->len == 0) continue;
    g_string_append(out, "<span><svg class=\"key\" viewBox=\"0 0 22 12\" aria-hidden=\"true\">");
    if (s->line)
      g_string_append_printf(out, "<path class=\"c%d path%s\" d=\"M0 6H22\"/>", s->color, s->dashed ? " dashed" : "");
    marker(out, s, 11, 6, NULL);
    g_string_append(out, "</svg> ");
    tcs_html_text(out, s->name);
    g_string_append(out, "</span> ");
  }
  if (chart->caption) {
    g_string_append(out, "<br/>");
    tcs_html_text(out, chart->caption);
  }
  g_string_append(out, "</figcaption></figure>\n");
}

void tcs_chart_write(tcs_chart *chart, GString *out) {
  canvas c = {out, {INFINITY, -INFINITY}, {INFINITY, -INFINITY}};
  for (int i = 0; i < chart->n_series; i++)
    for (guint k = 0; k < chart->series[i].points->len; k++) {
      const tcs_point *p = &g_array_index(chart->series[i].points, tcs_point, k);
      widen(&c.x, p->x);
      widen(&c.y, p->y);
    }
  if (c.x.lo <= c.x.hi) {
    settle(&c.x);
    settle(&c.y);
    g_string_append(out, "<figure><h4>");
    tcs_html_text(out, chart->title);
    g_string_append(out, "</h4>");
    draw_axes(&c, chart);
    draw_front(&c, chart->front);
    draw_guides(&c, chart);
    for (int i = 0; i < chart->n_series; i++)
      draw_series(&c, &chart->series[i]);
    g_string_append(out, "</svg>");
    write_legend(out, chart);
  }
  for (int i = 0; i < chart->n_series; i++)
    g_array_free(chart->series[i].points, TRUE);
  chart->n_series = 0;
}
