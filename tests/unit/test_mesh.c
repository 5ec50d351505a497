/* Meshes: the cases of a cell, extraction from analytic and random fields, files. */
#include "tests/support/test.h"

#include "renderer/mesh/cases.h"
#include "renderer/mesh/mesh.h"
#include "tests/support/scoped.h"

/* ---- cells ---- */

static int side_of(int edge, int axis) { /* 0, 1: the edge lies in that face of the axis; -1: it is along the axis */
  int kind = edge / 4;
  if (axis == kind) return -1;
  bool first = axis == (kind == 0 ? 1 : 0);
  return first ? edge & 1 : edge >> 1 & 1;
}

static bool share_face(int a, int b) {
  for (int axis = 0; axis < 3; axis++)
    if (side_of(a, axis) >= 0 && side_of(a, axis) == side_of(b, axis)) return true;
  return false;
}

/* Every crossed edge is used; an edge of two triangles lies inside, one of a single triangle in a face; none is met by
 * more. */
TEST(cases_are_surfaces_with_their_rim_in_the_faces) {
  for (int pattern = 0; pattern < 256; pattern++)
    for (int joined = 0; joined < 64; joined++) {
      if (joined & ~tc_cell_cases_all()->ambiguous[pattern]) continue;
      const tc_cell_case *c = &tc_cell_cases_all()->of[pattern][joined];
      int times[13][13] = {{0}}, used = 0;
      for (int t = 0; t < c->n_triangles; t++)
        for (int k = 0; k < 3; k++) {
          used |= 1 << c->edges[t][k];
          times[c->edges[t][k]][c->edges[t][(k + 1) % 3]]++;
        }
      for (int a = 0; a < 12; a++) {
        int x = a / 4 == 0 ? 0 : a & 1,
            y = a / 4 == 0   ? a & 1
                : a / 4 == 1 ? 0
                             : a >> 1 & 1,
            z = a / 4 == 2 ? 0 : a >> 1 & 1;
        int low = x + 2 * y + 4 * z, high = low + (1 << a / 4);
        assert_int_equal(used >> a & 1, (pattern >> low & 1) != (pattern >> high & 1));
        for (int b = 0; b < 12; b++) {
          assert_true(times[a][b] <= 1);
          if (times[a][b] && !times[b][a]) assert_true(share_face(a, b));
          if (times[a][b] && times[b][a]) assert_false(share_face(a, b));
        }
        assert_true(times[a][TC_CELL_CENTRE] == times[TC_CELL_CENTRE][a] && times[a][TC_CELL_CENTRE] <= 1);
      }
    }
}

/* ---- volumes ---- */

typedef double (*field_fn)(double x, double y, double z);

static tc_volume *make(const int dims[3], tc_voxel_type type, const double spacing[3], const double direction[9],
                       double slope, field_fn field) {
  tc_volume_desc d = {.type = type, .slope = slope, .frames = 1, .origin = {-31.5, 1e6, 12}};
  memcpy(d.dims, dims, sizeof d.dims);
  memcpy(d.spacing, spacing, sizeof d.spacing);
  memcpy(d.direction, direction, sizeof d.direction);
  tc_volume *v = tc_volume_new(&d, NULL);
  size_t i = 0;
  for (int z = 0; z < dims[2]; z++)
    for (int y = 0; y < dims[1]; y++)
      for (int x = 0; x < dims[0]; x++, i++) {
        double value = field(x, y, z) / slope;
        if (type == TC_F32)
          ((float *)tc_volume_voxels(v))[i] = (float)value;
        else if (type == TC_I16)
          ((int16_t *)tc_volume_voxels(v))[i] = (int16_t)lrint(value);
        else
          ((uint8_t *)tc_volume_voxels(v))[i] = (uint8_t)lrint(value);
      }
  tc_volume_seal(v);
  return v;
}

static const double even[3] = {1, 1, 1}, straight[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1},
                    mirrored[9] = {-1, 0, 0, 0, 1, 0, 0, 0, 1}, oblique[9] = {0.8, -0.6, 0, 0.6, 0.8, 0, 0, 0, 1};

static void check_equal(const tc_mesh *a, const tc_mesh *b) {
  assert_true(a->n_vertices == b->n_vertices && a->n_triangles == b->n_triangles);
  assert_memory_equal(a->positions, b->positions, a->n_vertices * sizeof *a->positions);
  assert_memory_equal(a->normals, b->normals, a->n_vertices * sizeof *a->normals);
  assert_memory_equal(a->triangles, b->triangles, a->n_triangles * sizeof *a->triangles);
}

/* The mesh, which is the same with min-max blocks of any width. */
static tc_mesh *extract(const tc_volume *v, double iso, int threads) {
  static int width = 2;
  GError *error = NULL;
  tc_mesh_options options = {.normals = true, .pool = threads ? tc_pool_new(threads, NULL) : NULL};
  tc_mesh *m = tc_mesh_extract(v, iso, &options, &error);
  if (!m) fail_msg("%s", error->message);
  tc_minmax *blocks = tc_minmax_build(v, width % 6 + 2, width & 1, options.pool, NULL);
  width++;
  options.blocks = blocks;
  tc_mesh *again = tc_mesh_extract(v, iso, &options, &error);
  check_equal(m, again);
  tc_mesh_free(again);
  tc_minmax_free(blocks);
  tc_pool_free(options.pool);
  return m;
}

/* ---- topology ---- */

typedef struct side {
  uint32_t from, to;
} side;

static int by_ends(const void *a, const void *b) {
  const side *p = a, *q = b;
  uint32_t p0 = MIN(p->from, p->to), p1 = MAX(p->from, p->to), q0 = MIN(q->from, q->to), q1 = MAX(q->from, q->to);
  return p0 != q0 ? (p0 > q0) - (p0 < q0) : (p1 > q1) - (p1 < q1);
}

static bool at_rim(const tc_volume *v, const tc_mesh *m, uint32_t vertex) {
  double lps[3], index[3];
  const int *dims = tc_volume_describe(v)->dims;
  for (int k = 0; k < 3; k++)
    lps[k] = m->origin[k] + m->positions[vertex][k];
  tc_volume_lps_to_index(v, lps, index);
  for (int k = 0; k < 3; k++)
    if (fabs(index[k]) < 1e-4 || fabs(index[k] - (dims[k] - 1)) < 1e-4) return true;
  return false;
}

typedef struct topology {
  long rim;   /* edges of one triangle */
  long euler; /* vertices - edges + triangles */
} topology;

/* Each edge has two triangles that pass it in opposite directions, or one and lies in a face of the volume; around each
 * vertex they are one fan. */
static topology check_manifold(const tc_volume *v, const tc_mesh *m) {
  size_t n = 3 * m->n_triangles, edges = 0;
  topology t = {0};
  side *sides = g_new(side, n + 1);
  uint8_t *used = g_new0(uint8_t, m->n_vertices + 1);
  int *corners = g_new0(int, m->n_vertices + 1), *sharing = g_new0(int, m->n_vertices + 1);
  for (size_t i = 0; i < n; i++) {
    sides[i] = (side){m->triangles[i / 3][i % 3], m->triangles[i / 3][(i + 1) % 3]};
    assert_true(sides[i].from < m->n_vertices && sides[i].from != sides[i].to);
    used[sides[i].from] = 1;
    corners[sides[i].from]++;
  }
  for (size_t i = 0; i < m->n_vertices; i++)
    assert_true(used[i]);
  qsort(sides, n, sizeof *sides, by_ends);
  for (size_t i = 0; i < n; edges++) {
    size_t last = i + 1;
    while (last < n && by_ends(&sides[i], &sides[last]) == 0)
      last++;
    if (last - i == 1) {
      t.rim++;
      if (!at_rim(v, m, sides[i].from) || !at_rim(v, m, sides[i].to))
        fail_msg("an edge of one triangle within the volume");
    } else if (last - i != 2 || sides[i].from != sides[i + 1].to) {
      fail_msg("an edge of %zu triangles", last - i);
    }
    sharing[sides[i].from]++, sharing[sides[i].to]++;
    i = last;
  }
  /* k triangles around a vertex have k edges there, or k + 1 at the rim; two fans at one vertex would have more at the
   * rim, and within the volume there is one, because a cell's polygons pass each of its edges once. */
  for (size_t i = 0; i < m->n_vertices; i++)
    assert_true(sharing[i] == corners[i] || sharing[i] == corners[i] + 1);
  t.euler = (long)m->n_vertices - (long)edges + (long)m->n_triangles;
  g_free(sides), g_free(used), g_free(corners), g_free(sharing);
  return t;
}

static void cross(const float *a, const float *b, const float *c, double out[3]) {
  double u[3], w[3];
  for (int k = 0; k < 3; k++)
    u[k] = (double)b[k] - a[k], w[k] = (double)c[k] - a[k];
  for (int k = 0; k < 3; k++)
    out[k] = u[(k + 1) % 3] * w[(k + 2) % 3] - u[(k + 2) % 3] * w[(k + 1) % 3];
}

static void measure(const tc_mesh *m, double *area, double *volume, double *worst_normal) {
  *area = *volume = 0;
  *worst_normal = 1;
  for (size_t i = 0; i < m->n_triangles; i++) {
    const uint32_t *t = m->triangles[i];
    const float *a = m->positions[t[0]];
    double n[3], size;
    cross(a, m->positions[t[1]], m->positions[t[2]], n);
    size = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    if (!(size > 0)) fail_msg("triangle %zu has no area", i);
    *area += size / 2;
    for (int k = 0; k < 3; k++)
      *volume += a[k] * n[k] / 6;
    for (int c = 0; c < 3; c++) {
      const float *normal = m->normals[t[c]];
      double along = (normal[0] * n[0] + normal[1] * n[1] + normal[2] * n[2]) / size;
      if (size > 1e-3) *worst_normal = fmin(*worst_normal, along); /* slivers have no direction worth a comparison */
    }
  }
}

/* ---- analytic surfaces ---- */

static int grid; /* voxels along an axis of the field under test */
static double at_grid(double i) { return 2 * i / (grid - 1) - 1; }
static double sphere(double x, double y, double z) {
  return 1000 * (1 - hypot(hypot(at_grid(x), at_grid(y)), at_grid(z)));
}
static double torus(double x, double y, double z) {
  return 1000 * (1 - hypot(hypot(at_grid(x), at_grid(y)) - 0.55, at_grid(z)));
}

TEST(spheres_converge) {
  double before = 0;
  for (grid = 17; grid <= 65; grid = 2 * grid - 1) {
    const int dims[3] = {grid, grid, grid};
    const double mm[3] = {2.0 / (grid - 1), 2.0 / (grid - 1), 2.0 / (grid - 1)}; /* a radius of 0.6 mm at 400 */
    g_autoptr(tc_volume) v = make(dims, TC_F32, mm, oblique, 1, sphere);
    g_autoptr(tc_mesh) m = extract(v, 400, 0);
    topology t = check_manifold(v, m);
    double area, volume, normal;
    measure(m, &area, &volume, &normal);
    double error = fabs(volume / (4.0 / 3 * G_PI * 0.216) - 1);
    print_message("%d^3: %zu triangles, area off by %.2g, volume by %.2g, least n.t %.3f\n", grid, m->n_triangles,
                  area / (4 * G_PI * 0.36) - 1, error, normal);
    assert_true(t.rim == 0 && t.euler == 2);
    assert_true(fabs(area / (4 * G_PI * 0.36) - 1) < 0.03 && normal > 0.8);
    if (before > 0) assert_true(error < 0.3 * before); /* of second order */
    before = error;
    for (size_t i = 0; i < m->n_vertices; i++) {
      const float *n = m->normals[i], *p = m->positions[i];
      double r = sqrt((double)p[0] * p[0] + (double)p[1] * p[1] + (double)p[2] * p[2]);
      assert_true(fabs(r - 0.6) < 0.6 * mm[0] * mm[0] + 1e-6);
      assert_true((n[0] * p[0] + n[1] * p[1] + n[2] * p[2]) / r > 0.95);
    }
  }
}

static double gyroid(double x, double y, double z) {
  const double a = M_PI * at_grid(x), b = M_PI * at_grid(y), c = M_PI * at_grid(z);
  return 1000 * (sin(a) * cos(b) + sin(b) * cos(c) + sin(c) * cos(a));
}

/* Schoen's minimal surface but for third digits: 3.0919 squares of its period (2 mm) in each. */
TEST(gyroids_converge) {
  double before[2] = {0};
  for (grid = 17; grid <= 65; grid = 2 * grid - 1) {
    const double mm[3] = {2.0 / (grid - 1), 2.0 / (grid - 1), 2.0 / (grid - 1)};
    g_autoptr(tc_volume) v = make((const int[3]){grid, grid, grid}, TC_F32, mm, straight, 1, gyroid);
    g_autoptr(tc_mesh) m = extract(v, 0, 2);
    double area, volume, normal, off[2] = {0};
    assert_true(check_manifold(v, m).rim > 0);
    measure(m, &area, &volume, &normal);
    for (size_t i = 0; i < m->n_vertices; i++) {
      const double a = M_PI * m->positions[i][0], b = M_PI * m->positions[i][1], c = M_PI * m->positions[i][2];
      const double g[3] = {sin(c) * sin(a) - cos(a) * cos(b), sin(a) * sin(b) - cos(b) * cos(c), sin(b) * sin(c) - cos(c) * cos(a)};
      const double size = sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2]);
      const float *n = m->normals[i]; /* towards lower values, as g */
      bool rim = false; /* differences there have one side */
      for (int k = 0; k < 3; k++) rim = rim || fabs((double)m->positions[i][k]) > 1 - 1.01 * mm[0];
      off[1] = fmax(off[1], rim ? 0 : acos(fmin((n[0] * g[0] + n[1] * g[1] + n[2] * g[2]) / size, 1)));
    }
    off[0] = fabs(area / 4 / 3.0919 - 1);
    print_message("%d^3: %zu triangles, area off by %.2g, normals by %.2g\n", grid, m->n_triangles, off[0], off[1]);
    assert_true(normal > 0.8 && off[0] < 0.02);
    for (int k = 0; k < 2; k++) {
      if (before[k] > 0) assert_true(off[k] < 0.35 * before[k] + 2e-3); /* of second order, but for the area's third digit */
      before[k] = off[k];
    }
  }
}

TEST(a_torus_has_a_hole) {
  grid = 48;
  const int dims[3] = {48, 48, 48};
  g_autoptr(tc_volume) v = make(dims, TC_I16, even, straight, 1, torus);
  g_autoptr(tc_mesh) m = extract(v, 700, 2);
  topology t = check_manifold(v, m);
  assert_true(t.rim == 0 && t.euler == 0);
}

/* Anisotropic, mirrored, rescaled by a negative slope: outside stays outside, and vertices have the value. */
TEST(geometry_is_the_patients) {
  grid = 30;
  const int dims[3] = {30, 30, 30};
  const double mm[3] = {0.7, 1.3, 2.9};
  for (int turn = 0; turn < 4; turn++) {
    g_autoptr(tc_volume) v = make(dims, TC_I16, mm, turn & 1 ? mirrored : oblique, turn & 2 ? -0.25 : 0.25, sphere);
    g_autoptr(tc_mesh) m = extract(v, 350.1, 0);
    double area, volume, normal;
    measure(m, &area, &volume, &normal);
    double expected = 4.0 / 3 * G_PI * pow(0.65 * 14.5, 3) * 0.7 * 1.3 * 2.9;
    assert_true(fabs(volume / expected - 1) < 0.02 && normal > 0.6);
    assert_int_equal(check_manifold(v, m).euler, 2);
    for (size_t i = 0; i < m->n_vertices; i += 7) {
      double lps[3], index[3], value;
      for (int k = 0; k < 3; k++)
        lps[k] = m->origin[k] + m->positions[i][k];
      tc_volume_lps_to_index(v, lps, index);
      assert_true(tc_volume_value_at(v, index, &value) && fabs(value - 350.1) < 0.05);
    }
  }
}

/* ---- random fields ---- */

static uint32_t seed;
static double few_values(double x, double y, double z) {
  seed = seed * 1664525u + 1013904223u;
  return (seed >> 24) % 5;
}
static double any_value(double x, double y, double z) {
  seed = seed * 1664525u + 1013904223u;
  return (double)(seed >> 8) / (1 << 24);
}

TEST(random_fields_are_manifolds) {
  static const int sizes[][3] = {{2, 2, 2}, {3, 2, 5}, {64, 4, 3}, {65, 5, 4}, {130, 6, 7}, {17, 18, 19}};
  for (seed = 1; seed < 200; seed += 33)
    for (size_t i = 0; i < G_N_ELEMENTS(sizes); i++)
      for (int ties = 0; ties < 2; ties++) {
        g_autoptr(tc_volume) v = make(sizes[i], ties ? TC_U8 : TC_F32, even, straight, 1, ties ? few_values : any_value);
        tc_mesh *m = extract(v, ties ? 2 : 0.5, 0), *again = extract(v, ties ? 2 : 0.5, 3);
        double area, volume, normal;
        check_manifold(v, m);
        measure(m, &area, &volume, &normal); /* none without area, values of exactly the surface's included */
        assert_true(m->n_vertices == again->n_vertices && m->n_triangles == again->n_triangles);
        check_equal(m, again);
        tc_mesh_free(m);
        tc_mesh_free(again);
      }
}

/* ---- labels ---- */

static tc_mesh *of_label(const tc_volume *v, uint32_t label, int threads) {
  GError *error = NULL;
  tc_mesh_options options = {.normals = true, .pool = threads ? tc_pool_new(threads, NULL) : NULL};
  tc_mesh *m = tc_mesh_extract_label(v, label, NULL, &options, &error);
  if (!m) fail_msg("%s", error->message);
  tc_pool_free(options.pool);
  return m;
}

/* Whether a point along +x from an index position meets the surface an odd number of times. */
static bool is_within(const tc_volume *v, const tc_mesh *m, const double index[3]) {
  int crossings = 0;
  for (size_t i = 0; i < m->n_triangles; i++) {
    double corner[3][3];
    for (int c = 0; c < 3; c++) {
      double lps[3];
      for (int k = 0; k < 3; k++)
        lps[k] = m->origin[k] + m->positions[m->triangles[i][c]][k];
      tc_volume_lps_to_index(v, lps, corner[c]);
    }
    /* beside the voxel's centre: no edge of a triangle is hit */
    const double y = index[1] + 1.7e-4, z = index[2] - 2.3e-4;
    double side[3], area = 0, x = 0;
    for (int c = 0; c < 3; c++) {
      const double *a = corner[(c + 1) % 3], *b = corner[(c + 2) % 3];
      side[c] = (a[1] - y) * (b[2] - z) - (a[2] - z) * (b[1] - y);
      area += side[c];
      x += side[c] * corner[c][0];
    }
    if ((side[0] > 0 && side[1] > 0 && side[2] > 0) || (side[0] < 0 && side[1] < 0 && side[2] < 0))
      crossings += x / area > index[0];
  }
  return crossings & 1;
}

static double some_labels(double x, double y, double z) {
  seed = seed * 1664525u + 1013904223u;
  return (seed >> 24) % 4;
}

/* Thin parts, single voxels and gaps keep their side; the surface is closed at the volume's faces too. */
TEST(labels_keep_every_voxel_on_its_side) {
  const int dims[3] = {7, 6, 5};
  seed = 5;
  g_autoptr(tc_volume) v = make(dims, TC_U8, even, oblique, 1, some_labels);
  const uint8_t *voxels = tc_volume_data(v);
  for (uint32_t label = 1; label < 4; label++) {
    tc_mesh *m = of_label(v, label, 0), *again = of_label(v, label, 3);
    assert_int_equal(check_manifold(v, m).rim, 0);
    for (int i = 0; i < 7 * 6 * 5; i++) {
      const double index[3] = {i % 7, i / 7 % 6, i / 42};
      assert_int_equal(is_within(v, m, index), voxels[i] == label);
    }
    assert_true(m->n_vertices == again->n_vertices && m->n_triangles == again->n_triangles);
    assert_memory_equal(m->positions, again->positions, m->n_vertices * sizeof *m->positions);
    tc_mesh_free(m);
    tc_mesh_free(again);
  }
  g_autoptr(tc_mesh) none = of_label(v, 9, 0);
  assert_int_equal(none->n_triangles, 0);
}

static double ball; /* radius in voxels */
static double in_ball(double x, double y, double z) { return hypot(hypot(x - 20, y - 20), z - 20) <= ball ? 300 : 0; }

/* The steps of voxels are gone, and small segments keep their size: a plain filter of this width takes a quarter of
 * the volume of a ball of 5 voxels. */
TEST(labels_are_smooth) {
  const int dims[3] = {41, 41, 41};
  const double size_bound[] = {0.06, 0.02}, normal_bound[] = {0.9, 0.96};
  for (int large = 0; large < 2; large++) {
    ball = large ? 14.3 : 5.2;
    g_autoptr(tc_volume) v = make(dims, TC_I16, even, mirrored, 1, in_ball);
    g_autoptr(tc_mesh) m = of_label(v, 300, 2);
    double area, volume, normal, worst = 1;
    measure(m, &area, &volume, &normal);
    area /= 4 * G_PI * ball * ball, volume /= 4.0 / 3 * G_PI * ball * ball * ball;
    assert_int_equal(check_manifold(v, m).euler, 2);
    for (size_t i = 0; i < m->n_vertices; i++) {
      const float *n = m->normals[i], *p = m->positions[i];
      worst = fmin(worst, (n[0] * p[0] + n[1] * p[1] + n[2] * p[2]) / hypot(hypot(p[0], p[1]), p[2]));
    }
    print_message("ball of %.1f voxels: area off by %.3f, volume by %.3f, least n.r %.3f\n", ball, area - 1, volume - 1,
                  worst);
    assert_true(fabs(area - 1) < size_bound[large] && fabs(volume - 1) < size_bound[large] &&
                worst > normal_bound[large]);
  }
  g_autoptr(tc_volume) f = make(dims, TC_F32, even, straight, 1, in_ball);
  g_autoptr(GError) error = NULL;
  assert_null(tc_mesh_extract_label(f, 300, NULL, &(tc_mesh_options){0}, &error));
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_INVALID));
}

static double in_pillar(double x, double y, double z) {
  const double radius = z >= 1 && z <= 8 ? 10 + ((int)z % 2 ? 0 : 1.5) : 0;
  return z >= 1 && z <= 8 && x == 2 && y == 2 ? 1 : hypot(x - 24, y - 24) <= radius;
}

/* Outlines of thick slices that differ by a pixel and a half show no ridges: the surface lies between them, with the volume of
 * the voxels; a line of single pixels survives. */
TEST(outlines_of_thick_slices_become_one_surface) {
  const int dims[3] = {41, 41, 10};
  const double thick[3] = {1, 1, 5};
  g_autoptr(tc_volume) v = make(dims, TC_U8, thick, straight, 1, in_pillar);
  g_autoptr(tc_mesh) m = of_label(v, 1, 2);
  double area, volume, normal, least = INFINITY, most = 0, line = 0;
  measure(m, &area, &volume, &normal);
  assert_int_equal(check_manifold(v, m).euler, 4);
  for (size_t i = 0; i < m->n_vertices; i++) {
    double lps[3], at[3];
    for (int k = 0; k < 3; k++) lps[k] = m->origin[k] + m->positions[i][k];
    tc_volume_lps_to_index(v, lps, at);
    if (at[2] < 3 || at[2] > 6) continue; /* near the ends */
    if (at[0] < 8 && at[1] < 8)
      line = fmax(line, fabs(at[0] - 2));
    else
      least = fmin(least, hypot(at[0] - 24, at[1] - 24)), most = fmax(most, hypot(at[0] - 24, at[1] - 24));
  }
  size_t voxels = 0;
  for (size_t i = 0; i < 41 * 41 * 10; i++) voxels += ((const uint8_t *)tc_volume_data(v))[i];
  print_message("radius %.2f to %.2f, line +-%.2f, volume %.3f of the voxels'\n", least, most, line, volume / (5.0 * (double)voxels));
  assert_true(least > 10 && most < 11.6 && most - least < 0.6);
  assert_true(line > 0.1 && fabs(volume / (5.0 * (double)voxels) - 1) < 0.07);
}

static double three_boxes(double x, double y, double z) {
  return x > 2 && x < 6 && y > 3 && z > 4 ? -2 : x >= 20 && z < 2 ? 300 : x == 10 && y == 1 && z == 1 ? 7 : 0;
}

/* One pass finds what a walk for each label would; its boxes make the same surface. */
TEST(boxes_of_all_labels_are_found_at_once) {
  const int dims[3] = {24, 6, 9};
  static const struct { int16_t label; int first[3], end[3]; } wanted[] = {
      {-2, {3, 4, 5}, {6, 6, 9}}, {300, {20, 0, 0}, {24, 6, 2}}, {7, {10, 1, 1}, {11, 2, 2}}};
  g_autoptr(tc_volume) v = make(dims, TC_I16, even, straight, 1, three_boxes);
  g_autoptr(tc_pool) pool = tc_pool_new(3, NULL);
  g_autofree tc_label_boxes *boxes = tc_label_boxes_find(v, pool, NULL);
  assert_int_equal(boxes->n_values, 65536);
  for (size_t i = 0; i < G_N_ELEMENTS(wanted); i++)
    for (int k = 0; k < 3; k++) {
      assert_int_equal(boxes->reach[(uint16_t)wanted[i].label][k], dims[k] - wanted[i].first[k]);
      assert_int_equal(boxes->reach[(uint16_t)wanted[i].label][3 + k], wanted[i].end[k]);
    }
  assert_int_equal(boxes->reach[8][3], 0);
  tc_mesh *own = of_label(v, 7, 0), *given = tc_mesh_extract_label(v, 7, boxes, &(tc_mesh_options){.normals = true}, NULL);
  assert_true(own->n_triangles > 0 && own->n_triangles == given->n_triangles);
  assert_memory_equal(own->positions, given->positions, own->n_vertices * sizeof *own->positions);
  tc_mesh_free(own);
  tc_mesh_free(given);
}

/* Fewer triangles within the error that was asked for, still closed. */
TEST(simplification_keeps_its_bound) {
  grid = 41;
  const int dims[3] = {41, 41, 41};
  g_autoptr(tc_volume) v = make(dims, TC_F32, even, straight, 1, sphere);
  g_autoptr(tc_mesh) m = extract(v, 400, 0);
  size_t before = m->n_triangles;
  for (double bound = 0.05; bound < 0.5; bound *= 2) {
    GError *error = NULL;
    g_autoptr(tc_mesh) s = tc_mesh_simplify(m, bound, 0, &error);
    assert_non_null(s);
    double area, volume, normal, worst = 0;
    measure(s, &area, &volume, &normal);
    assert_int_equal(check_manifold(v, s).euler, 2);
    for (size_t i = 0; i < s->n_triangles; i++) { /* the middle of a triangle lies furthest from the sphere */
      double middle[3] = {0};
      for (int k = 0; k < 9; k++)
        middle[k % 3] += s->positions[s->triangles[i][k / 3]][k % 3] / 3;
      worst = fmax(worst, fabs(hypot(hypot(middle[0], middle[1]), middle[2]) - 12));
    }
    print_message("%.2f mm: %zu of %zu triangles, off by %.3f mm\n", bound, s->n_triangles, m->n_triangles, worst);
    assert_true(s->n_triangles < before && worst < 2 * bound + 0.02);
    before = s->n_triangles;
  }
  tc_mesh *none = extract(v, 5000, 0), *still = tc_mesh_simplify(none, 1, 0, NULL);
  assert_true(still && still->n_triangles == 0);
  tc_mesh_free(none);
  tc_mesh_free(still);
}

static uint32_t first_of(uint32_t *piece, uint32_t v) {
  while (piece[v] != v) v = piece[v] = piece[piece[v]];
  return v;
}

/* Connected parts. */
static long parts_of(const tc_mesh *m) {
  g_autofree uint32_t *piece = g_new(uint32_t, m->n_vertices + 1);
  long n = (long)m->n_vertices;
  for (uint32_t v = 0; v < m->n_vertices; v++) piece[v] = v;
  for (size_t i = 0; i < 3 * m->n_triangles; i++) {
    const uint32_t a = first_of(piece, m->triangles[i / 3][i % 3]), b = first_of(piece, m->triangles[i / 3][(i + 1) % 3]);
    n -= a != b;
    piece[a > b ? a : b] = a > b ? b : a;
  }
  return n;
}

/* Within a rim of zeros, so that the surface is closed. */
static double noise_inside(double x, double y, double z) {
  const double a = any_value(x, y, z);
  return x < 1 || y < 1 || z < 1 || x > 22 || y > 22 || z > 22 ? 0 : a;
}

/* Of many narrow necks: each edge keeps two triangles, each vertex one fan, and the surface its handles, but for parts that
 * vanish, each of which takes two from the Euler characteristic if it was a ball. */
TEST(simplified_random_fields_are_manifolds) {
  static const int dims[3] = {24, 24, 24};
  grid = 24, seed = 5;
  g_autoptr(tc_volume) v = make(dims, TC_F32, even, straight, 1, noise_inside);
  for (int round = 0; round < 2; round++) {
    g_autoptr(tc_mesh) m = extract(v, round ? 0.5 : 0.8, 0);
    const topology full = check_manifold(v, m);
    const long balls = parts_of(m);
    assert_int_equal(full.rim, 0);
    for (double bound = 0.02; bound < 0.5; bound *= 3) {
      g_autoptr(tc_mesh) s = tc_mesh_simplify(m, bound, 0, NULL);
      const topology t = check_manifold(v, s);
      const long lost = balls - parts_of(s);
      print_message("%.2f mm: %zu of %zu triangles, Euler characteristic %ld of %ld, %ld of %ld parts lost\n", bound,
                    s->n_triangles, m->n_triangles, t.euler, full.euler, lost, balls);
      assert_true(t.rim == 0 && t.euler == full.euler - 2 * lost && s->n_triangles < m->n_triangles);
    }
  }
}

/* On a face with two opposite corners inside, the saddle of the bilinear field says what is joined. */
static double two_corners;
static double saddle(double x, double y, double z) {
  double w = (x == y) == (z == 0) ? two_corners : -1;
  return z == 0 ? w : -1;
}

TEST(ambiguous_faces_follow_the_field) {
  const int dims[3] = {2, 2, 2};
  for (int joined = 0; joined < 2; joined++) {
    two_corners = joined ? 1.5 : 0.5;
    g_autoptr(tc_volume) v = make(dims, TC_F32, even, straight, 1, saddle);
    g_autoptr(tc_mesh) m = extract(v, 0, 0);
    check_manifold(v, m);
    assert_int_equal(m->n_triangles, joined ? 4 : 2); /* a bridge between the corners, or a piece at each */
  }
}

/* A second volume has another ball, in blocks that lie on one side of the surface in the first one: with the first one's blocks
 * the second ball is not found, so its voxels were not read. */
TEST(blocks_on_one_side_are_not_read) {
  for (int type = 0; type < TC_VOXEL_TYPE_COUNT; type++) {
    tc_volume *v[2];
    for (int i = 0; i < 2; i++) {
      tc_volume_desc d = {.type = (tc_voxel_type)type, .slope = 1, .frames = 1, .dims = {300, 40, 40}, .spacing = {1, 1, 1},
                          .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
      v[i] = tc_volume_new(&d, NULL);
      for (int at = 0; at < 300 * 40 * 40; at++) {
        const int x = at % 300, y = at / 300 % 40, z = at / 300 / 40;
        const double ball = 10 - hypot(hypot(x - 40, y - 20), z - 20), other = i ? 10 - hypot(hypot(x - 200, y - 20), z - 20) : 0;
        const double value = fmax(fmax(ball, other) * 10, 0);
        switch (type) {
        case TC_U8: ((uint8_t *)tc_volume_voxels(v[i]))[at] = (uint8_t)value; break;
        case TC_I8: ((int8_t *)tc_volume_voxels(v[i]))[at] = (int8_t)value; break;
        case TC_U16: ((uint16_t *)tc_volume_voxels(v[i]))[at] = (uint16_t)value; break;
        case TC_I16: ((int16_t *)tc_volume_voxels(v[i]))[at] = (int16_t)value; break;
        default: ((float *)tc_volume_voxels(v[i]))[at] = (float)value;
        }
      }
      tc_volume_seal(v[i]);
    }
    tc_mesh *one = extract(v[0], 50.5, 2), *two = extract(v[1], 50.5, 2);
    assert_true(two->n_triangles > one->n_triangles * 3 / 2);
    tc_minmax *blocks = tc_minmax_build(v[0], TC_SKIP_BLOCK, 0, NULL, NULL);
    tc_mesh *unread = tc_mesh_extract(v[1], 50.5, &(tc_mesh_options){.normals = true, .blocks = blocks}, NULL);
    check_equal(one, unread);
    tc_mesh_free(one);
    tc_mesh_free(two);
    tc_mesh_free(unread);
    tc_minmax_free(blocks);
    for (int i = 0; i < 2; i++) tc_volume_unref(v[i]);
  }
}

TEST(what_is_not_there_is_empty) {
  grid = 12;
  const int dims[3] = {12, 12, 12}, flat[3] = {12, 12, 1};
  tc_volume *v = make(dims, TC_F32, even, straight, 1, sphere), *f = make(flat, TC_F32, even, straight, 1, sphere);
  GError *error = NULL;
  tc_mesh *m = extract(v, 5000, 0), *none = extract(f, 400, 0);
  assert_true(m->n_triangles == 0 && m->n_vertices == 0 && none->n_triangles == 0 && none->n_vertices == 0);
  assert_null(tc_mesh_extract(v, NAN, &(tc_mesh_options){0}, &error));
  g_clear_error(&error);
  assert_null(tc_mesh_extract(v, 400, &(tc_mesh_options){.max_bytes = 1000}, &error));
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_LIMIT));
  g_clear_error(&error);
  tc_mesh_free(m);
  tc_mesh_free(none);
  tc_volume_unref(v);
  tc_volume_unref(f);
}

TESTS(NULL, NULL)
