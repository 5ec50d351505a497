/* Integrates one smooth piece: optical depth D(x) and colour  int L tau exp(-D) dx.
 *
 * Both use one set of Gauss points: tau is interpolated there and integrated up to each point (collocation), which
 * gives D where the colour integral needs it. A panel's estimate is compared with that of its two halves; the halves
 * are cut again where they disagree, or where the light falls more within a panel than a polynomial can follow. A
 * stiff piece (tau * length up to 1e15) thereby gets a mesh graded towards its front end, the only part that is
 * visible. */
#include <math.h>
#include <pthread.h>

#include "renderer/reference/internal.h"

#define POINTS 8
#define DEEPEST 120        /* halvings */
#define DEPTH_PER_PANEL 6  /* exp(-6 x) is a polynomial of degree 15 to 1e-13 over two halves */
#define NOTHING_LEFT 1e-30 /* transparency below which nothing reaches a colour in double */

/* The rule on [0, 1]; upto[i][j]: integral of basis polynomial j over [0, node i]. */
static double node[POINTS], weight[POINTS], upto[POINTS][POINTS];
static pthread_once_t made = PTHREAD_ONCE_INIT;

/* P_0 .. P_n at x. */
static void legendre(long double x, int n, long double *p) {
  p[0] = 1;
  p[1] = x;
  for (int k = 1; k < n; k++) p[k + 1] = ((2 * k + 1) * x * p[k] - k * p[k - 1]) / (k + 1);
}

static void make_rule(void) {
  long double x[POINTS], w[POINTS], p[POINTS][POINTS + 2];
  for (int i = 0; i < POINTS; i++) {
    x[i] = -cosl(3.141592653589793238462643L * (i + 0.75L) / (POINTS + 0.5L));
    for (int newton = 0; newton < 30; newton++) {
      legendre(x[i], POINTS + 1, p[i]);
      long double slope = POINTS * (x[i] * p[i][POINTS] - p[i][POINTS - 1]) / (x[i] * x[i] - 1);
      x[i] -= p[i][POINTS] / slope;
    }
    legendre(x[i], POINTS + 1, p[i]);
    long double slope = POINTS * (x[i] * p[i][POINTS] - p[i][POINTS - 1]) / (x[i] * x[i] - 1);
    w[i] = 2 / ((1 - x[i] * x[i]) * slope * slope);
  }
  /* Basis j = w_j sum_k (2k+1)/2 P_k(x_j) P_k, and (2k+1) int_{-1}^{x} P_k = P_{k+1}(x) - P_{k-1}(x). */
  for (int i = 0; i < POINTS; i++)
    for (int j = 0; j < POINTS; j++) {
      long double sum = x[i] + 1;
      for (int k = 1; k < POINTS; k++) sum += p[j][k] * (p[i][k + 1] - p[i][k - 1]);
      upto[i][j] = (double)(w[j] * sum / 4);
    }
  for (int i = 0; i < POINTS; i++) {
    node[i] = (double)((x[i] + 1) / 2);
    weight[i] = (double)(w[i] / 2);
  }
}

typedef struct job {
  const tc_ref_piece *piece;
  const tc_ref_span *span;
  const tc_ref_shading *shading; /* or NULL */
  double tolerance;
  bool one_color;
  double color[3]; /* the one colour */
  tc_ref_light *light;
} job;

typedef struct panel {
  double depth, clear; /* optical depth, exp(-depth) */
  double color[3];
} panel;

static double fraction_at(const job *j, double x) {
  const tc_ref_piece *p = j->piece;
  double rise = 0;
  for (int i = p->cell->degree; i-- > 0;) rise = x * (p->d[i] + rise);
  double f = ((p->front - j->span->base) + rise) * j->span->inverse_width;
  return fmin(fmax(f, 0), 1);
}

static void color_at(const job *j, double x, double rgb[3]) {
  tc_ref_span_color(j->span, fraction_at(j, x), rgb);
  if (j->piece->cell->label) tc_ref_label_tint(j->piece->cell->label, j->piece->from + x, rgb);
  if (j->shading) tc_ref_shade(j->shading, j->piece->cell, j->piece->from + x, rgb);
}

static double extinction_at(const job *j, double x) {
  double tint[4], extinction = tc_ref_span_extinction(j->span, fraction_at(j, x));
  const tc_ref_label_cell *label = j->piece->cell->label;
  return label ? extinction * tc_ref_label_mean(label, j->piece->from + x, tint) : extinction;
}

/* The rule on one panel [x0, x0 + width]. Colour is split into its value at the front, whose integral is exact, and
 * the rest: a constant colour gives colour * opacity to the last bit. */
static panel estimate(const job *j, double x0, double width) {
  double tau[POINTS], rgb[POINTS][3], front[3], mm = width * j->piece->mm;
  panel r = {0};
  for (int i = 0; i < POINTS; i++) {
    tau[i] = extinction_at(j, x0 + width * node[i]);
    if (!j->one_color) color_at(j, x0 + width * node[i], rgb[i]);
    r.depth += weight[i] * tau[i] * mm;
  }
  r.clear = exp(-r.depth);
  double opacity = -expm1(-r.depth);
  if (j->one_color) {
    for (int c = 0; c < 3; c++) r.color[c] = j->color[c] * opacity;
    return r;
  }
  color_at(j, x0, front);
  for (int c = 0; c < 3; c++) r.color[c] = front[c] * opacity;
  for (int i = 0; i < POINTS; i++) {
    double depth = 0;
    for (int k = 0; k < POINTS; k++) depth += upto[i][k] * tau[k];
    double share = weight[i] * tau[i] * mm * exp(-depth * mm);
    for (int c = 0; c < 3; c++) r.color[c] += share * (rgb[i][c] - front[c]);
  }
  return r;
}

static void add(tc_ref_light *light, const panel *p) {
  for (int c = 0; c < 3; c++) light->color[c] += light->transparency * p->color[c];
  light->opacity += light->transparency * -expm1(-p->depth);
  light->transparency *= p->clear;
}

static bool agree(const job *j, const panel *whole, const panel *a, const panel *b) {
  if (!j->one_color && whole->depth > DEPTH_PER_PANEL) return false;
  double error = fabs(whole->clear - a->clear * b->clear);
  for (int c = 0; c < 3; c++) error = fmax(error, fabs(whole->color[c] - (a->color[c] + a->clear * b->color[c])));
  return error * j->light->transparency <= j->tolerance;
}

static void refine(const job *j, double x0, double width, const panel *whole, int level) {
  if (j->light->transparency < NOTHING_LEFT) return;
  double half = 0.5 * width;
  panel a = estimate(j, x0, half), b = estimate(j, x0 + half, half);
  if (level == 0 || agree(j, whole, &a, &b)) {
    add(j->light, &a);
    add(j->light, &b);
    return;
  }
  refine(j, x0, half, &a, level - 1);
  refine(j, x0 + half, half, &b, level - 1);
}

/* Optical depth in closed form, for extinction that is a polynomial along the piece. */
static double polynomial_depth(const tc_ref_piece *p, const tc_ref_span *span) {
  double x = p->width, f0 = (p->front - span->base) * span->inverse_width;
  double mean = 0;
  for (int i = p->cell->degree; i-- > 0;) mean = x * (p->d[i] / (i + 2) + mean);
  double f = f0 + span->inverse_width * mean;
  return tc_ref_span_extinction(span, fmin(fmax(f, 0), 1)) * x * p->mm;
}

void tc_ref_integrate(const tc_ref_piece *piece, const tc_ref_span *span, const tc_ref_shading *shading,
                      double tolerance, tc_ref_light *light) {
  if (span->no_extinction || !(piece->width > 0) || light->transparency < NOTHING_LEFT) return;
  pthread_once(&made, make_rule);
  job j = {.piece = piece, .span = span, .shading = shading, .tolerance = tolerance, .light = light};
  bool flat = piece->front == piece->back;
  for (int i = 0; i < piece->cell->degree; i++) flat = flat && piece->d[i] == 0;
  j.one_color = !shading && !piece->cell->label && (span->one_color || flat);
  tc_ref_span_color(span, fraction_at(&j, 0), j.color);
  if (j.one_color && (flat || span->one_extinction || !span->opacity)) {
    panel whole = {.depth = polynomial_depth(piece, span)};
    whole.clear = exp(-whole.depth);
    for (int c = 0; c < 3; c++) whole.color[c] = -expm1(-whole.depth) * j.color[c];
    add(light, &whole);
    return;
  }
  panel whole = estimate(&j, 0, piece->width);
  refine(&j, 0, piece->width, &whole, DEEPEST);
}
