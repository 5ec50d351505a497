#include "renderer/volume/demo_shapes.h"

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>

#define MAX_SHAPES 4096

/* ---- painting ---- */

static float ellipsoid_distance(const tc_shape *s, float x, float y, float z) {
  float px = (x - s->a[0]) / s->b[0], py = (y - s->a[1]) / s->b[1], pz = (z - s->a[2]) / s->b[2];
  float k0 = sqrtf(px * px + py * py + pz * pz);
  float gx = px / s->b[0], gy = py / s->b[1], gz = pz / s->b[2];
  float k1 = sqrtf(gx * gx + gy * gy + gz * gz);
  return k1 > 0 ? k0 * (k0 - 1) / k1 : -fminf(s->b[0], fminf(s->b[1], s->b[2]));
}

static float capsule_distance(const tc_shape *s, float x, float y, float z) {
  float d[3] = {s->b[0] - s->a[0], s->b[1] - s->a[1], s->b[2] - s->a[2]};
  float p[3] = {x - s->a[0], y - s->a[1], z - s->a[2]};
  float dd = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
  float h = dd > 0 ? (p[0] * d[0] + p[1] * d[1] + p[2] * d[2]) / dd : 0;
  h = h < 0 ? 0 : h > 1 ? 1 : h;
  float q = 0;
  for (int k = 0; k < 3; k++) q += (p[k] - h * d[k]) * (p[k] - h * d[k]);
  return sqrtf(q) - (s->ra + h * (s->rb - s->ra));
}

static void bounds(const tc_shape *s, int axis, float *lo, float *hi) {
  float margin = s->edge + s->wave;
  if (s->kind == TC_ELLIPSOID) {
    *lo = s->a[axis] - s->b[axis] - margin;
    *hi = s->a[axis] + s->b[axis] + margin;
  } else {
    float r = fmaxf(s->ra, s->rb) + margin;
    *lo = fminf(s->a[axis], s->b[axis]) - r;
    *hi = fmaxf(s->a[axis], s->b[axis]) + r;
  }
}

static int clamp_index(double v, int n) { return v < 0 ? 0 : v > n ? n : (int)v; }

void tc_shape_paint(const tc_shape *s, const int dims[3], const double origin[3], double spacing, int z, float *slice) {
  float lo, hi, pz = (float)(origin[2] + z * spacing);
  bounds(s, 2, &lo, &hi);
  if (pz < lo || pz > hi) return;
  bounds(s, 0, &lo, &hi);
  int x0 = clamp_index(floor((lo - origin[0]) / spacing), dims[0]),
      x1 = clamp_index(ceil((hi - origin[0]) / spacing) + 1, dims[0]);
  bounds(s, 1, &lo, &hi);
  int y0 = clamp_index(floor((lo - origin[1]) / spacing), dims[1]),
      y1 = clamp_index(ceil((hi - origin[1]) / spacing) + 1, dims[1]);
  for (int y = y0; y < y1; y++) {
    float py = (float)(origin[1] + y * spacing);
    for (int x = x0; x < x1; x++) {
      float px = (float)(origin[0] + x * spacing);
      float d = s->kind == TC_ELLIPSOID ? ellipsoid_distance(s, px, py, pz) : capsule_distance(s, px, py, pz);
      if (s->wave > 0 && fabsf(d) < 3 * s->wave) /* gyri: two folded waves */
        d += s->wave * sinf(0.42f * px + 1.7f * sinf(0.21f * pz)) * sinf(0.38f * py + 1.3f * sinf(0.27f * px)) *
             sinf(0.35f * pz + 1.1f * sinf(0.24f * py));
      float cover = 0.5f - d / s->edge;
      if (cover <= 0) continue;
      float *v = &slice[y * dims[0] + x];
      *v += (cover < 1 ? cover : 1) * (s->value - *v);
    }
  }
}

/* ---- lists ---- */

typedef struct list {
  tc_shape *shapes;
  int count;
} list;

static void add(list *l, tc_shape s) {
  if (l->shapes && l->count < MAX_SHAPES) l->shapes[l->count++] = s;
}

static void ball(list *l, float value, float x, float y, float z, float rx, float ry, float rz) {
  add(l, (tc_shape){.kind = TC_ELLIPSOID, .a = {x, y, z}, .b = {rx, ry, rz}, .value = value, .edge = 2.2f});
}

static void rod(list *l, float value, float x0, float y0, float z0, float r0, float x1, float y1, float z1, float r1) {
  add(l,
      (tc_shape){
          .kind = TC_CAPSULE, .a = {x0, y0, z0}, .b = {x1, y1, z1}, .ra = r0, .rb = r1, .value = value, .edge = 2.2f});
}

/* Two ellipsoids, mirrored at the midline. */
static void balls(list *l, float value, float x, float y, float z, float rx, float ry, float rz) {
  ball(l, value, x, y, z, rx, ry, rz);
  ball(l, value, -x, y, z, rx, ry, rz);
}
static void rods(list *l, float value, float x0, float y0, float z0, float r0, float x1, float y1, float z1, float r1) {
  rod(l, value, x0, y0, z0, r0, x1, y1, z1, r1);
  rod(l, value, -x0, y0, z0, r0, -x1, y1, z1, r1);
}

enum {
  SKIN = 45,
  FAT = -90,
  MUSCLE = 58,
  BONE = 1150,
  SPONGY = 480,
  BRAIN = 36,
  WHITE = 28,
  FLUID = 6,
  AIR = -1000,
  TOOTH = 2100
};

static void head_soft_tissue(list *l) {
  rod(l, SKIN, 0, 30, -125, 47, 0, 26, -60, 50); /* neck */
  ball(l, SKIN, 0, 8, 28, 77, 96, 82);           /* cranium */
  ball(l, SKIN, 0, -34, -30, 60, 58, 62);        /* face */
  ball(l, SKIN, 0, -48, -66, 44, 44, 30);        /* jaw */
  rod(l, SKIN, 0, -88, -6, 7, 0, -100, -32, 10); /* nose */
  balls(l, SKIN, 8, -97, -36, 7, 8, 6);
  rods(l, SKIN, 14, -88, -62, 5, 6, -92, -61, 6); /* lips */
  rods(l, SKIN, 15, -86, -70, 5, 6, -89, -71, 6);
  for (int i = 0; i < 14; i++) { /* ears: a rim of rods */
    float u0 = -1.2f + 0.28f * (float)i, u1 = u0 + 0.28f;
    rods(l, SKIN, 79 + 2 * sinf(u0), 14 - 14 * cosf(u0), -8 + 24 * sinf(u0), 4, 79 + 2 * sinf(u1), 14 - 14 * cosf(u1),
         -8 + 24 * sinf(u1), 4);
  }
  balls(l, SKIN, 77, 12, -12, 5, 11, 16);
  rods(l, MUSCLE, 60, -12, -8, 9, 54, -34, -66, 8); /* masseter and temporal muscle */
  rods(l, MUSCLE, 38, 55, -100, 15, 34, 58, -40, 10);
}

static void head_skull(list *l) {
  ball(l, BONE, 0, 9, 29, 70, 88, 75); /* vault, spongy middle, brain inside */
  ball(l, SPONGY, 0, 9, 29, 67.6f, 85.6f, 72.6f);
  ball(l, BONE, 0, 9, 29, 65.6f, 83.6f, 70.6f);
  ball(l, BONE, 0, -46, -4, 52, 38, 26); /* forehead to cheeks */
  ball(l, BONE, 0, -54, -28, 38, 34, 26);
  ball(l, SPONGY, 0, -52, -28, 34, 30, 22);
  ball(l, FLUID, 0, 9, 30, 63.5f, 81.5f, 68.5f);
  rod(l, BONE, 0, 15, -28, 26, 0, 52, -26, 24); /* skull base */
  rod(l, SPONGY, 0, 15, -28, 22, 0, 52, -26, 20);
  rod(l, FLUID, 0, 40, -60, 8, 0, 36, -10, 9); /* great foramen and canal */
  rods(l, BONE, 62, 6, -22, 9, 58, 12, -46, 5); /* mastoid */
  rods(l, AIR, 72, 8, -14, 2.4f, 46, 10, -13, 2);
  balls(l, BONE, 43, -60, -26, 12, 13, 10); /* cheekbones and their arches */
  for (int i = 0; i < 12; i++) {
    float u0 = (float)i / 12, u1 = (float)(i + 1) / 12;
    rods(l, BONE, 47 + 17 * sinf(2.2f * u0), -62 + 60 * u0, -26 + 6 * u0, 5 - 1.6f * u0, 47 + 17 * sinf(2.2f * u1),
         -62 + 60 * u1, -26 + 6 * u1, 5 - 1.6f * u1);
  }
  rod(l, BONE, 0, -78, 4, 7, 0, -92, -10, 3); /* nose bridge */
}

static void head_cavities(list *l) {
  balls(l, FAT, 31, -66, -6, 18, 32, 15.5f); /* orbits */
  balls(l, SKIN, 31, -90, -6, 17, 5, 12);
  balls(l, FLUID + 10, 31, -76, -7, 12, 12, 12); /* eyes */
  balls(l, 90, 31, -86, -7, 4.5f, 2.5f, 4.5f);   /* lenses */
  rods(l, MUSCLE, 31, -64, -7, 2, 14, -34, -4, 2); /* optic nerves */
  ball(l, SKIN, 0, -88, -28, 12, 10, 15); /* the pear-shaped opening */
  rods(l, AIR, 6, -92, -32, 4.6f, 8, -46, -26, 6); /* nasal cavity, septum between */
  rod(l, AIR, 0, -44, -28, 9, 0, -14, -60, 8);
  rod(l, AIR, 0, -14, -60, 8, 0, -8, -125, 9); /* airway */
  balls(l, AIR, 27, -62, -36, 10, 14, 12);     /* sinuses */
  balls(l, AIR, 9, -72, 16, 7, 4, 8);
  ball(l, MUSCLE, 0, -52, -64, 21, 30, 11); /* tongue */
}

static void head_jaws(list *l) {
  for (int i = 0; i < 20; i++) { /* mandible: a horseshoe, then its branches up to the joint */
    float u0 = -1.25f + 2.5f * (float)i / 20, u1 = -1.25f + 2.5f * (float)(i + 1) / 20;
    rod(l, BONE, 44 * sinf(u0), -38 - 46 * cosf(u0), -78, 7, 44 * sinf(u1), -38 - 46 * cosf(u1), -78, 7);
    rod(l, SPONGY, 44 * sinf(u0), -38 - 46 * cosf(u0), -78, 4.6f, 44 * sinf(u1), -38 - 46 * cosf(u1), -78, 4.6f);
    rod(l, BONE, 34 * sinf(u0), -50 - 34 * cosf(u0), -46, 6, 34 * sinf(u1), -50 - 34 * cosf(u1), -46, 6); /* maxilla */
  }
  rods(l, BONE, 42, -52, -78, 7, 52, -20, -62, 7);
  rods(l, BONE, 52, -20, -62, 7.5f, 55, -4, -28, 5);
  rods(l, BONE, 50, -34, -66, 6, 50, -36, -34, 3.5f);
  for (int row = 0; row < 2; row++)
    for (int i = 0; i < 14; i++) {
      float u = -1.12f + 2.24f * ((float)i + 0.5f) / 14, r = fabsf(u) > 0.62f ? 3.8f : 2.7f;
      float x = (row ? 37.0f : 36.0f) * sinf(u), y = -44 - 40 * cosf(u);
      rod(l, TOOTH, x, y, row ? -63 : -61, r, x, y + 1, row ? -72 : -50, r * 0.6f);
    }
}

static void head_spine(list *l) {
  for (int i = 0; i < 4; i++) {
    float z = -56 - 19 * (float)i;
    rod(l, BONE, 0, 22, z - 5, 12, 0, 22, z + 5, 12);
    rod(l, SPONGY, 0, 22, z - 4, 9.5f, 0, 22, z + 4, 9.5f);
    rods(l, BONE, 10, 28, z, 5, 17, 40, z - 2, 5);
    rods(l, BONE, 17, 40, z - 2, 5, 3, 56, z - 6, 4);
    rod(l, BONE, 0, 56, z - 6, 4, 0, 72, z - 12, 3.2f);
    rods(l, BONE, 16, 30, z, 4, 27, 27, z - 3, 3.4f);
  }
  rod(l, FLUID, 0, 40, -125, 7.5f, 0, 40, -40, 7.5f);
  rod(l, BRAIN, 0, 40, -125, 5, 0, 38, -20, 7); /* cord */
}

static void head_brain(list *l) {
  for (int side = -1; side <= 1; side += 2) {
    float s = (float)side;
    add(l, (tc_shape){.kind = TC_ELLIPSOID,
                      .a = {s * 28, 8, 34},
                      .b = {26, 70, 56},
                      .value = BRAIN + 6,
                      .edge = 1.6f,
                      .wave = 3.0f});
    add(l, (tc_shape){
               .kind = TC_ELLIPSOID, .a = {s * 28, 8, 34}, .b = {20, 62, 46}, .value = WHITE, .edge = 2, .wave = 4.0f});
    rod(l, FLUID, s * 7, -22, 44, 5, s * 10, 12, 48, 6); /* ventricles */
    rod(l, FLUID, s * 10, 12, 48, 6, s * 22, 44, 34, 5);
    rod(l, FLUID, s * 22, 44, 34, 4, s * 30, 8, 18, 2.5f);
    ball(l, BRAIN + 4, s * 16, 6, 34, 9, 16, 8);
    ball(l, BRAIN + 4, s * 24, 62, -2, 24, 22, 17); /* cerebellum */
  }
  ball(l, FLUID, 0, 9, 64, 1.6f, 70, 28); /* the cleft between the halves */
  rod(l, BRAIN, 0, 38, -20, 8, 0, 24, 12, 12);
}

tc_shape *tc_shapes_head(int *count) {
  list l = {.shapes = malloc(MAX_SHAPES * sizeof *l.shapes)};
  head_soft_tissue(&l);
  head_skull(&l);
  head_brain(&l);
  head_jaws(&l);
  head_cavities(&l);
  head_spine(&l);
  *count = l.count;
  return l.shapes;
}

/* ---- vessels: a tree that forks with Murray's law (r^3 = r1^3 + r2^3) ---- */

static float random_unit(uint32_t *state) {
  *state = *state * 1664525u + 1013904223u;
  return (float)(*state >> 8) / 16777216.0f;
}

/* start: position and direction. */
static void branch(list *l, const float start[6], float radius, float length, int depth, uint32_t *state) {
  float p[3] = {start[0], start[1], start[2]}, d[3] = {start[3], start[4], start[5]};
  int pieces = 5;
  for (int i = 0; i < pieces; i++) {
    float q[3], norm = 0;
    for (int k = 0; k < 3; k++) d[k] += 0.35f * (random_unit(state) - 0.5f) - 0.004f * p[k];
    for (int k = 0; k < 3; k++) norm += d[k] * d[k];
    norm = 1 / sqrtf(norm);
    for (int k = 0; k < 3; k++) d[k] *= norm, q[k] = p[k] + d[k] * length / (float)pieces;
    float r0 = radius * (1 - 0.16f * (float)i / (float)pieces),
          r1 = radius * (1 - 0.16f * (float)(i + 1) / (float)pieces);
    add(l, (tc_shape){.kind = TC_CAPSULE, .a = {p[0], p[1], p[2]}, .b = {q[0], q[1], q[2]}, .ra = r0, .rb = r1,
                      .value = 150 + 90 * fminf(radius / 3, 1), .edge = 0.9f});
    for (int k = 0; k < 3; k++) p[k] = q[k];
  }
  if (depth == 0 || radius < 0.3f) return;
  float share = 0.35f + 0.3f * random_unit(state), side[3], norm = 0;
  for (int k = 0; k < 3; k++) side[k] = random_unit(state) - 0.5f;
  float along = side[0] * d[0] + side[1] * d[1] + side[2] * d[2];
  for (int k = 0; k < 3; k++) side[k] -= along * d[k], norm += side[k] * side[k];
  norm = 1 / sqrtf(norm + 1e-9f);
  for (int child = 0; child < 2; child++) {
    float r = 0.84f * radius * cbrtf(child ? share : 1 - share), turn = (child ? 0.75f : -0.55f), end[6];
    for (int k = 0; k < 3; k++) end[k] = p[k], end[3 + k] = d[k] + turn * side[k] * norm;
    branch(l, end, r, length * (0.72f + 0.2f * random_unit(state)), depth - 1, state);
  }
}

tc_shape *tc_shapes_vessels(int *count) {
  list l = {.shapes = malloc(MAX_SHAPES * sizeof *l.shapes)};
  uint32_t state = 20240607;
  const float roots[4][6] = {
      {-14, 4, -62, 0.1f, 0, 1}, {14, 4, -62, -0.1f, 0, 1}, {-6, 26, -62, 0.2f, 0.2f, 1}, {6, 26, -62, -0.2f, 0.2f, 1}};
  for (int i = 0; i < 4; i++) branch(&l, roots[i], i < 2 ? 3.2f : 2.2f, i < 2 ? 34 : 30, 6, &state);
  ball(&l, 235, -20, -10, 12, 5.5f, 5, 6); /* an aneurysm to find */
  *count = l.count;
  return l.shapes;
}
