#include "server/bench/difference.h"

#include <math.h>
#include <stdlib.h>

/* ---- channel differences ---- */

static int ascending(const void *a, const void *b) {
  float x = *(const float *)a, y = *(const float *)b;
  return (x > y) - (x < y);
}

/* The mean square is a sample mean with a normal interval, from which the interval of its root follows. */
static void set_rms(tcs_difference *d, double sum, double sum2) {
  double n = (double)d->pixels, mean = sum / n, variance = n > 1 ? fmax(0, (sum2 - sum * mean) / (n - 1)) : 0;
  double half = 1.96 * sqrt(variance / n);
  d->rms = sqrt(mean);
  d->rms_lo = sqrt(fmax(0, mean - half));
  d->rms_hi = sqrt(mean + half);
}

bool tcs_compare_pixels(const float *a, const float *b, size_t pixels, tcs_difference *out) {
  *out = (tcs_difference){.pixels = pixels};
  if (pixels == 0) return true;
  float *worst = malloc(pixels * sizeof *worst);
  if (!worst) return false;
  double sum = 0, sum2 = 0;
  for (size_t i = 0; i < pixels; i++) {
    double square = 0, largest = 0;
    for (int c = 0; c < 4; c++) {
      double e = fabs((double)a[4 * i + (size_t)c] - b[4 * i + (size_t)c]);
      square += 0.25 * e * e;
      largest = fmax(largest, e);
    }
    worst[i] = (float)largest;
    sum += square;
    sum2 += square * square;
  }
  set_rms(out, sum, sum2);
  qsort(worst, pixels, sizeof *worst, ascending);
  out->max = worst[pixels - 1];
  size_t rank = (size_t)ceil(0.999 * (double)pixels); /* nearest rank */
  out->p999 = worst[rank - 1];
  free(worst);
  return true;
}

/* ---- colour ---- */

static double to_linear(double c) { return c <= 0.04045 ? c / 12.92 : pow((c + 0.055) / 1.055, 2.4); }
static double to_display(double c) { return c <= 0.0031308 ? 12.92 * c : 1.055 * pow(c, 1 / 2.4) - 0.055; }

static double lab_f(double t) {
  const double edge = 6.0 / 29;
  return t > edge * edge * edge ? cbrt(t) : t / (3 * edge * edge) + 4.0 / 29;
}

void tcs_lab(const double srgb[3], double lab[3]) {
  /* Rows sum to the white point, so that white is L* = 100 and a* = b* = 0 up to rounding. */
  static const double m[3][3] = {{0.4123907993, 0.3575843394, 0.1804807884},
                                 {0.2126390059, 0.7151686788, 0.0721923154},
                                 {0.0193308187, 0.1191947798, 0.9505321522}};
  double linear[3], f[3];
  for (int c = 0; c < 3; c++) linear[c] = to_linear(fmin(fmax(srgb[c], 0), 1));
  for (int r = 0; r < 3; r++)
    f[r] = lab_f((m[r][0] * linear[0] + m[r][1] * linear[1] + m[r][2] * linear[2]) / (m[r][0] + m[r][1] + m[r][2]));
  lab[0] = 116 * f[1] - 16;
  lab[1] = 500 * (f[0] - f[1]);
  lab[2] = 200 * (f[1] - f[2]);
}

static double radians(double degrees) { return degrees * M_PI / 180; }

static double hue(double b, double a) {
  if (a == 0 && b == 0) return 0;
  double h = atan2(b, a) * 180 / M_PI;
  return h < 0 ? h + 360 : h;
}

/* G of the paper's equation 4: stretches a* of near-grey colours, where chroma differences are more visible. */
static double chroma_stretch(double mean_chroma) {
  double c7 = pow(mean_chroma, 7);
  return 1 + 0.5 * (1 - sqrt(c7 / (c7 + 6103515625.0 /* 25^7 */)));
}

/* The circular mean of two hues; if one colour is grey (no hue), the other hue. */
static double mean_hue(double h1, double h2, bool grey) {
  if (grey) return h1 + h2;
  if (fabs(h1 - h2) <= 180) return 0.5 * (h1 + h2);
  return h1 + h2 < 360 ? 0.5 * (h1 + h2 + 360) : 0.5 * (h1 + h2 - 360);
}

double tcs_ciede2000(const double lab1[3], const double lab2[3]) {
  double stretch = chroma_stretch(0.5 * (hypot(lab1[1], lab1[2]) + hypot(lab2[1], lab2[2])));
  double a1 = stretch * lab1[1], a2 = stretch * lab2[1];
  double c1 = hypot(a1, lab1[2]), c2 = hypot(a2, lab2[2]), h1 = hue(lab1[2], a1), h2 = hue(lab2[2], a2);
  bool grey = c1 * c2 == 0;
  double turn = grey ? 0 : h2 - h1;
  if (turn > 180) turn -= 360;
  if (turn < -180) turn += 360;
  double dl = lab2[0] - lab1[0], dc = c2 - c1, dh = 2 * sqrt(c1 * c2) * sin(radians(turn) / 2);
  double l = 0.5 * (lab1[0] + lab2[0]), c = 0.5 * (c1 + c2), h = mean_hue(h1, h2, grey);
  double t = 1 - 0.17 * cos(radians(h - 30)) + 0.24 * cos(radians(2 * h)) + 0.32 * cos(radians(3 * h + 6)) -
             0.20 * cos(radians(4 * h - 63));
  double l50 = (l - 50) * (l - 50), c7 = pow(c, 7);
  double sl = 1 + 0.015 * l50 / sqrt(20 + l50), sc = 1 + 0.045 * c, sh = 1 + 0.015 * c * t;
  double rotation = -sin(radians(60 * exp(-((h - 275) / 25) * ((h - 275) / 25)))) * 2 * sqrt(c7 / (c7 + 6103515625.0));
  double x = dl / sl, y = dc / sc, z = dh / sh;
  return sqrt(fmax(0, x * x + y * y + z * z + rotation * y * z));
}

static void shown(const float rgba[4], const tcs_look *look, double srgb[3]) {
  for (int c = 0; c < 3; c++) {
    double back = look->linear_light ? to_linear(look->background[c]) : look->background[c];
    double v = fmin(fmax(rgba[c] + (1 - (double)rgba[3]) * back, 0), 1);
    srgb[c] = look->linear_light ? to_display(v) : v;
  }
}

/* ---- structural similarity ---- */

enum { WINDOW = 11 };

/* Gaussian-weighted mean of f(a, b) = a^p * b^q in the window at (x, y); separable, rows then columns. */
typedef struct moments {
  double a, b, aa, bb, ab;
} moments;

static void add(moments *m, double w, const moments *from) {
  m->a += w * from->a, m->b += w * from->b, m->aa += w * from->aa, m->bb += w * from->bb, m->ab += w * from->ab;
}

static int weights(int side, double w[WINDOW]) {
  int size = side < WINDOW ? side : WINDOW;
  double sum = 0;
  for (int i = 0; i < size; i++) {
    double x = (i - 0.5 * (size - 1)) / 1.5;
    sum += w[i] = exp(-0.5 * x * x);
  }
  for (int i = 0; i < size; i++) w[i] /= sum;
  return size;
}

static double similarity(const moments *m) {
  const double c1 = 0.01 * 0.01, c2 = 0.03 * 0.03;
  double va = m->aa - m->a * m->a, vb = m->bb - m->b * m->b, vab = m->ab - m->a * m->b;
  return (2 * m->a * m->b + c1) * (2 * vab + c2) / ((m->a * m->a + m->b * m->b + c1) * (va + vb + c2));
}

double tcs_ssim(const float *a, const float *b, int width, int height) {
  double wx[WINDOW], wy[WINDOW], sum = 0;
  int nx = weights(width, wx), ny = weights(height, wy), columns = width - nx + 1, rows = height - ny + 1;
  moments *across = calloc((size_t)columns * (size_t)height, sizeof *across);
  if (!across) return NAN;
  for (int y = 0; y < height; y++)
    for (int x = 0; x < columns; x++)
      for (int i = 0; i < nx; i++) {
        double p = a[(size_t)y * (size_t)width + (size_t)(x + i)], q = b[(size_t)y * (size_t)width + (size_t)(x + i)];
        add(&across[(size_t)y * (size_t)columns + (size_t)x], wx[i], &(moments){p, q, p * p, q * q, p * q});
      }
  for (int y = 0; y < rows; y++)
    for (int x = 0; x < columns; x++) {
      moments m = {0};
      for (int i = 0; i < ny; i++) add(&m, wy[i], &across[(size_t)(y + i) * (size_t)columns + (size_t)x]);
      sum += similarity(&m);
    }
  free(across);
  return sum / ((double)columns * rows);
}

/* ---- pictures ---- */

bool tcs_compare(const float *a, const float *b, int width, int height, const tcs_look *look, tcs_difference *out) {
  size_t pixels = (size_t)width * (size_t)height;
  float *luma = malloc(2 * pixels * sizeof *luma);
  bool good = luma && tcs_compare_pixels(a, b, pixels, out);
  if (good) {
    double sum = 0;
    for (size_t i = 0; i < pixels; i++) {
      double p[3], q[3], lab1[3], lab2[3];
      shown(a + 4 * i, look, p);
      shown(b + 4 * i, look, q);
      luma[i] = (float)(0.2126 * p[0] + 0.7152 * p[1] + 0.0722 * p[2]);
      luma[pixels + i] = (float)(0.2126 * q[0] + 0.7152 * q[1] + 0.0722 * q[2]);
      tcs_lab(p, lab1);
      tcs_lab(q, lab2);
      double e = tcs_ciede2000(lab1, lab2);
      sum += e;
      out->ciede_max = fmax(out->ciede_max, e);
    }
    out->ciede = sum / (double)pixels;
    out->ssim = tcs_ssim(luma, luma + pixels, width, height);
    good = isfinite(out->ssim);
  }
  free(luma);
  return good;
}
