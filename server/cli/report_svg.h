/* One kind of chart: points and lines over logarithmic axes, as inline SVG whose colours are the page's (classes
 * c0..c5). */
#ifndef TC_SERVER_REPORT_SVG_H
#define TC_SERVER_REPORT_SVG_H

#include <glib.h>
#include <stdbool.h>

enum { TCS_CHART_COLORS = 6, TCS_CHART_SHAPES = 5, TCS_CHART_SERIES = 16 };

typedef struct tcs_point {
  double x, y;      /* above 0; what is not is left out */
  double low, high; /* interval of y; 0, 0: none */
  char tip[160];
} tcs_point;

typedef struct tcs_series {
  char name[64];
  int color, shape;  /* shapes: circle, square, triangle, diamond, cross */
  bool line, dashed; /* joined in the order given */
  bool hollow;
  bool small;
  GArray *points; /* tcs_point */
} tcs_series;

typedef struct tcs_chart {
  const char *title, *x_label, *y_label;
  bool octaves;        /* ticks of x at powers of two */
  const char *caption; /* one sentence below, or NULL */
  tcs_series series[TCS_CHART_SERIES];
  int n_series;
  const GArray *front;  /* tcs_point, ascending x and descending y: drawn as stairs; NULL: none */
  const double *guides; /* y of dotted lines */
  const char *const *guide_names;
  int n_guides;
} tcs_chart;

/* The series of that name, made when it is new; NULL when there is no room. */
tcs_series *tcs_chart_series(tcs_chart *chart, const char *name);
void tcs_series_add(tcs_series *series, double x, double y, double low, double high, const char *tip);
/* Appends <figure> with the chart and its legend; nothing where no point can be drawn. Frees the series. */
void tcs_chart_write(tcs_chart *chart, GString *out);

/* Appends text with what HTML reserves escaped. */
void tcs_html_text(GString *out, const char *text);

#endif
