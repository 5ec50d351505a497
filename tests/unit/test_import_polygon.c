/* Concave polygons of mesh files: the triangles cover the polygon once, whatever its plane and direction. */
#include "import_files.h"

#include "renderer/import/helper/polygon.h"
#include "renderer/mesh/measure.h"
#include "tests/support/read_mesh_here.h"

enum { MOST = 4000 };

typedef struct outline {
  const char *name;
  int n;
  double at[MOST][2]; /* counterclockwise */
} outline;

static void add(outline *o, double x, double y) {
  o->at[o->n][0] = x, o->at[o->n][1] = y;
  o->n++;
}

static void polar(outline *o, double radius, double turn) { add(o, radius * cos(2 * M_PI * turn), radius * sin(2 * M_PI * turn)); }

static void make_star(outline *o) {
  for (int i = 0; i < 40; i++) polar(o, i % 2 ? 3 : 10, i / 40.0);
}

static void make_arrow(outline *o) { add(o, 10, 0), add(o, -5, 6), add(o, -1, 0), add(o, -5, -6); }

/* Two arms that wind four times; a fan of any corner crosses them. */
static void make_spiral(outline *o) {
  enum { N = 200 };
  for (int i = 0; i < N; i++) polar(o, 2.5 + 4 * 3.0 * i / N, 4.0 * i / N);
  for (int i = N - 1; i >= 0; i--) polar(o, 1 + 4 * 3.0 * i / N, 4.0 * i / N);
}

static void make_comb(outline *o) {
  add(o, 0, 0), add(o, 100, 0);
  for (int i = 99; i >= 0; i--) add(o, i + 0.75, i % 2 ? 1 : 20), add(o, i + 0.25, i % 2 ? 1 : 20);
}

/* Corners in the middle of straight sides, which no triangle may pass by. */
static void make_straight(outline *o) {
  for (int i = 0; i < 4; i++) add(o, i, 0);
  for (int i = 0; i < 4; i++) add(o, 4, i);
  for (int i = 0; i < 4; i++) add(o, 4 - i, 4);
  for (int i = 0; i < 4; i++) add(o, 0, 4 - i);
}

/* A square with a square hole: the outline passes the bridge between them twice. */
static void make_hole(outline *o) {
  add(o, 0, 0), add(o, 9, 0), add(o, 9, 9), add(o, 0, 9), add(o, 0, 0);
  add(o, 3, 3), add(o, 3, 6), add(o, 6, 6), add(o, 6, 3), add(o, 3, 3);
}

static void (*const makers[])(outline *) = {make_star, make_arrow, make_spiral, make_comb, make_straight, make_hole};
static const char *const names[] = {"star", "arrow", "spiral", "comb", "straight", "hole"};

static double outline_area(const outline *o) {
  double sum = 0;
  for (int i = 0; i < o->n; i++) {
    const double *a = o->at[i], *b = o->at[(i + 1) % o->n];
    sum += (a[0] * b[1] - a[1] * b[0]) / 2;
  }
  return sum;
}

static double triangle_area(const outline *o, const uint32_t t[3]) {
  const double *a = o->at[t[0]], *b = o->at[t[1]], *c = o->at[t[2]];
  return ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2;
}

/* Sides of the outline occur once, in its direction; every other edge once in both directions. */
static void check_edges(const outline *o, uint32_t (*triangles)[3], int step) {
  g_autofree uint8_t *seen = g_new0(uint8_t, (size_t)o->n * (size_t)o->n);
  for (int t = 0; t < o->n - 2; t++)
    for (int c = 0; c < 3; c++) {
      uint8_t *edge = &seen[triangles[t][c] * (uint32_t)o->n + triangles[t][(c + 1) % 3]];
      if (*edge) fail_msg("%s: an edge occurs twice", o->name);
      *edge = 1;
    }
  for (int a = 0; a < o->n; a++)
    for (int b = 0; b < o->n; b++) {
      const bool side = (a + step + o->n) % o->n == b, behind = (b + step + o->n) % o->n == a;
      if (side != seen[a * o->n + b] && (side || (!behind && seen[a * o->n + b] != seen[b * o->n + a])))
        fail_msg("%s: edge %d-%d", o->name, a, b);
    }
}

/* All planes along the axes, and a slanting one; both directions; every corner the first. */
TEST(concave_polygons_are_covered_once) {
  static const double planes[4][6] = {{1, 0, 0, 0, 1, 0}, {0, 1, 0, 0, 0, 1}, {0, 0, 1, 1, 0, 0}, {0.6, 0.8, 0, -0.48, 0.36, 0.8}};
  g_autofree outline *o = g_new(outline, 1);
  g_autofree float(*positions)[3] = (float(*)[3])g_malloc_n(MOST, 12);
  g_autofree uint32_t *corners = g_new(uint32_t, MOST);
  tc_polygon p = {0};
  for (size_t m = 0; m < G_N_ELEMENTS(makers); m++)
    for (int c = 0; c < 8; c++) {
      const double *plane = planes[c / 2];
      *o = (outline){.name = names[m]};
      makers[m](o);
      for (int i = 0; i < o->n; i++)
        for (int k = 0; k < 3; k++) positions[i][k] = (float)(o->at[i][0] * plane[k] + o->at[i][1] * plane[3 + k] + 30);
      for (int first = 0; first < o->n; first += 1 + o->n / 16) {
        const int step = c % 2 ? -1 : 1;
        double sum = 0;
        for (int i = 0; i < o->n; i++) corners[i] = (uint32_t)((first + step * i + o->n) % o->n);
        assert_true(tc_polygon_split(&p, (const float(*)[3])positions, corners, (size_t)o->n, NULL));
        for (int t = 0; t < o->n - 2; t++) {
          for (int k = 0; k < 3; k++) p.triangles[t][k] = corners[p.triangles[t][k]];
          const double part = step * triangle_area(o, p.triangles[t]);
          if (part < -1e-4) fail_msg("%s: a triangle is turned over, %g", o->name, part);
          sum += fabs(part);
        }
        if (fabs(sum - outline_area(o)) > 1e-4 * sum) fail_msg("%s: %g of %g", o->name, sum, outline_area(o));
        check_edges(o, p.triangles, step);
      }
    }
  tc_polygon_clear(&p);
}

/* No shape to be right about: the number of triangles is, and every corner is used. */
TEST(polygons_that_cross_themselves_end) {
  tc_polygon p = {0};
  g_autofree float(*positions)[3] = (float(*)[3])g_malloc_n(MOST, 12);
  g_autofree uint32_t *corners = g_new(uint32_t, MOST);
  g_autoptr(GRand) random = g_rand_new_with_seed(7);
  for (int round = 0; round < 300; round++) {
    const int n = g_rand_int_range(random, 3, round % 10 ? 60 : 700), kinds = g_rand_int_range(random, 1, 6);
    bool used[MOST] = {0};
    for (int i = 0; i < n; i++) {
      corners[i] = (uint32_t)i;
      for (int k = 0; k < 3; k++) positions[i][k] = round % 3 ? (float)g_rand_int_range(random, 0, kinds) : (float)g_rand_double(random);
      if (round % 7 == 0) positions[i][g_rand_int_range(random, 0, 3)] *= 1e30f;
    }
    assert_true(tc_polygon_split(&p, (const float(*)[3])positions, corners, (size_t)n, NULL));
    for (int t = 0; t < n - 2; t++)
      for (int c = 0; c < 3; c++) {
        assert_true(p.triangles[t][c] < (uint32_t)n);
        used[p.triangles[t][c]] = true;
      }
    for (int i = 0; i < n; i++) assert_true(used[i]);
  }
  tc_polygon_clear(&p);
}

TEST(concave_polygons_without_end_are_refused) {
  tc_polygon p = {.tests = UINT64_C(1000000000) - 50};
  g_autofree outline *o = g_new0(outline, 1);
  g_autofree float(*positions)[3] = (float(*)[3])g_malloc_n(MOST, 12);
  g_autofree uint32_t *corners = g_new(uint32_t, MOST);
  g_autoptr(GError) error = NULL;
  make_spiral(o);
  for (int i = 0; i < o->n; i++) memcpy(positions[i], (const float[3]){(float)o->at[i][0], (float)o->at[i][1], 0}, 12), corners[i] = (uint32_t)i;
  assert_false(tc_polygon_split(&p, (const float(*)[3])positions, corners, (size_t)o->n, &error));
  assert_string_equal(error->message, "the file has concave polygons of too many corners; save the mesh as triangles");
  tc_polygon_clear(&p);
}

/* An arrow as the outline of a prism: the two ends are concave, the sides are not. */
TEST(a_prism_of_an_arrow_is_closed_in_every_format) {
  static const char *const texts[][2] = {
      {"v 10 0 0\nv -5 6 0\nv -1 0 0\nv -5 -6 0\nv 10 0 4\nv -5 6 4\nv -1 0 4\nv -5 -6 4\nvn 0 0 1\nvn 0 0 -1\nvn 1 0 0\n"
       "f -1//1 -4//1 -3//1 -2//1\nf 1//2 4//2 3//2 2//2\nf 1//3 2//3 6//3 5//3\nf 2//3 3//3 7//3 6//3\nf 3//3 4//3 8//3 7//3\n"
       "f 4//3 1//3 5//3 8//3\n", "arrow.obj"},
      {"ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\nelement face 6\n"
       "property list uchar int vertex_indices\nend_header\n10 0 0\n-5 6 0\n-1 0 0\n-5 -6 0\n10 0 4\n-5 6 4\n-1 0 4\n-5 -6 4\n"
       "4 7 4 5 6\n4 0 3 2 1\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n", "arrow.ply"}};
  for (size_t i = 0; i < G_N_ELEMENTS(texts); i++) {
    g_autoptr(GError) error = NULL;
    g_autoptr(tc_mesh) m = read_mesh_here(texts[i][0], strlen(texts[i][0]), texts[i][1], NULL, 0, 0, NULL, &error);
    tc_mesh_measures is;
    assert_non_null(m);
    tc_mesh_measure(m, &is);
    assert_int_equal(m->n_triangles, 12);
    const double base = 11.0 * 6; /* arrow: 11 mm from notch to tip, 12 mm wide */
    double top = 0, volume = 0;
    for (size_t t = 0; t < 12; t++) {
      const float *a = m->positions[m->triangles[t][0]], *b = m->positions[m->triangles[t][1]], *c = m->positions[m->triangles[t][2]];
      volume += ((double)a[0] * (b[1] * c[2] - b[2] * c[1]) + (double)a[1] * (b[2] * c[0] - b[0] * c[2]) +
                 (double)a[2] * (b[0] * c[1] - b[1] * c[0])) / 6;
      if (t < 2) top += fabs((double)(b[0] - a[0]) * (c[1] - a[1]) - (double)(b[1] - a[1]) * (c[0] - a[0])) / 2;
    }
    assert_true(fabs(top - base) < 1e-9 && fabs(volume - 4 * base) < 1e-4);
    if (i) assert_true(is.closed); /* the OBJ's normals split its vertices */
  }
}

TESTS(make_folder, remove_folder)
