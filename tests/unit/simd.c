/* Every operation of a vector vocabulary against its meaning in one lane (renderer/raycast/cpu/simd.h). Compiled once an
 * instruction set, SIMD_HEADER; passes without a word where the processor lacks it. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#include <cmocka.h>

#include SIMD_HEADER

#ifndef V_BIAS_U8
#define v_corner_u8 v_pair_u8
#define v_corner_i8 v_pair_i8
#define v_corner_u16 v_pair_u16
#define v_corner_i16 v_pair_i16
#define V_BIAS_U8 0
#define V_BIAS_I8 0
#define V_BIAS_U16 0
#define V_BIAS_I16 0
#endif

enum { ROUNDS = 4000, BYTES = 1 << 12, PAD = 3 };

typedef union lanes { float f[V_LANES]; int32_t i[V_LANES]; } lanes;

static uint32_t state = 1;
static uint32_t draw(void) {
  state ^= state << 13, state ^= state >> 17, state ^= state << 5;
  return state;
}

/* Zeros, ones, neighbours of 1, denormals, the largest, infinities, NaN, and half of the time any bits or a number near 1. */
static float draw_float(void) {
  static const float special[] = {0,        -0.0f,     1,        -1,       0x1.fffffep-1f, 0x1.000002p0f, 0x1p-149f, -0x1p-126f,
                                  INFINITY, -INFINITY, 3.4e38f, -3.4e38f, NAN,            0.5f,          0x1p23f,   0x1p31f};
  union { uint32_t u; float f; } any = {.u = draw()};
  switch (draw() % 4) {
  case 0: return any.f;
  case 1: return (float)(int32_t)draw() * 0x1p-31f;
  default: return special[draw() % (sizeof special / sizeof *special)];
  }
}

static int32_t draw_int(void) {
  static const int32_t special[] = {0, 1, -1, INT32_MAX, INT32_MIN, 255, 256, 65535, 1 << 23, 1 << 24};
  return draw() % 2 ? (int32_t)draw() : special[draw() % (sizeof special / sizeof *special)];
}

static lanes floats(void) {
  lanes l;
  for (int k = 0; k < V_LANES; k++) l.f[k] = draw_float();
  return l;
}
static lanes ints(void) {
  lanes l;
  for (int k = 0; k < V_LANES; k++) l.i[k] = draw_int();
  return l;
}
static vi to_vi(const lanes *l) { return v_bits(v_load(l->f)); }
static lanes of_vf(vf v) { lanes l; v_store(l.f, v); return l; }
static lanes of_vi(vi v) { return of_vf(v_from_bits(v)); }
static lanes of_vm(vm m) { return of_vf(v_select(m, v_set(1), v_set(0))); }

static bool same(float x, float y) {
  union { float f; int32_t i; } a = {x}, b = {y};
  return a.i == b.i || (isnan(x) && isnan(y));
}

#define FAIL(name, k, a, b, c, got, wanted)                                                                           \
  fail_msg("%s lane %d: a %a b %a c %a: %a, expected %a", name, k, (double)(a), (double)(b), (double)(c), (double)(got), (double)(wanted))

#define UNARY(name, meaning)                                                                                          \
  for (int k = 0; k < V_LANES; k++) {                                                                                 \
    float a = x.f[k], wanted = meaning, got = of_vf(name(v_load(x.f))).f[k];                                          \
    if (!same(got, wanted)) FAIL(#name, k, a, 0, 0, got, wanted);                                                     \
  }
#define BINARY(name, meaning)                                                                                         \
  for (int k = 0; k < V_LANES; k++) {                                                                                 \
    float a = x.f[k], b = y.f[k], wanted = meaning, got = of_vf(name(v_load(x.f), v_load(y.f))).f[k];                 \
    if (!same(got, wanted)) FAIL(#name, k, a, b, 0, got, wanted);                                                     \
  }
#define FUSED(name, meaning)                                                                                          \
  for (int k = 0; k < V_LANES; k++) {                                                                                 \
    float a = x.f[k], b = y.f[k], c = z.f[k], wanted = meaning;                                                       \
    float got = of_vf(name(v_load(x.f), v_load(y.f), v_load(z.f))).f[k];                                              \
    float once = #name[3] == 'm' && #name[2] == 'f' ? fmaf(a, b, c) : fmaf(-a, b, c);                                 \
    if (!same(got, wanted) && !same(got, once)) FAIL(#name, k, a, b, c, got, wanted);                                 \
  }
#define COMPARE(name, meaning)                                                                                        \
  for (int k = 0; k < V_LANES; k++) {                                                                                 \
    float a = x.f[k], b = y.f[k], wanted = meaning, got = of_vm(name(v_load(x.f), v_load(y.f))).f[k];                 \
    if (got != wanted) FAIL(#name, k, a, b, 0, got, wanted);                                                          \
  }
#define MASK(name, meaning)                                                                                           \
  for (int k = 0; k < V_LANES; k++) {                                                                                 \
    bool a = x.f[k] < y.f[k], b = y.f[k] <= z.f[k], wanted = meaning;                                                 \
    vm p = v_lt(v_load(x.f), v_load(y.f)), q = v_le(v_load(y.f), v_load(z.f));                                        \
    if (of_vm(name(p, q)).f[k] != (float)wanted) FAIL(#name, k, a, b, 0, !wanted, wanted);                            \
  }
#define INTEGER(name, meaning)                                                                                        \
  for (int k = 0; k < V_LANES; k++) {                                                                                 \
    int32_t a = i.i[k], b = j.i[k], wanted = meaning, got = of_vi(name(to_vi(&i), to_vi(&j))).i[k];                   \
    if (got != wanted) FAIL(#name, k, a, b, 0, got, wanted);                                                          \
  }
#define ORDER(name, meaning)                                                                                          \
  for (int k = 0; k < V_LANES; k++) {                                                                                 \
    int32_t a = i.i[k], b = j.i[k];                                                                                   \
    bool wanted = meaning;                                                                                            \
    if (of_vm(name(to_vi(&i), to_vi(&j))).f[k] != (float)wanted) FAIL(#name, k, a, b, 0, !wanted, wanted);            \
  }
#define SHIFT_BY(name, meaning, by)                                                                                   \
  for (int k = 0; k < V_LANES; k++) {                                                                                 \
    enum { n = by };                                                                                                  \
    int32_t a = i.i[k], wanted = meaning, got = of_vi(name(to_vi(&i), n)).i[k];                                       \
    if (got != wanted) FAIL(#name, k, a, n, 0, got, wanted);                                                          \
  }
#define SHIFT(name, meaning)                                                                                          \
  SHIFT_BY(name, meaning, 0) SHIFT_BY(name, meaning, 1) SHIFT_BY(name, meaning, 23) SHIFT_BY(name, meaning, 31)

static void rows_mean_the_same_in_every_lane(void **unused) {
  for (int round = 0; round < ROUNDS; round++) {
    const lanes x = floats(), y = round % 8 ? floats() : x, z = floats(), i = ints(), j = ints();
    SIMD_UNARY(UNARY)
    SIMD_BINARY(BINARY)
    SIMD_FUSED(FUSED)
    SIMD_COMPARE(COMPARE)
    SIMD_MASK(MASK)
    SIMD_INTEGER(INTEGER)
    SIMD_SHIFT(SHIFT)
    SIMD_ORDER(ORDER)
    const vf a = v_load(x.f), b = v_load(y.f);
#define OPERATOR(op)                                                                                                  \
  for (int k = 0; k < V_LANES; k++)                                                                                   \
    if (!same(of_vf(a op b).f[k], x.f[k] op y.f[k])) FAIL(#op, k, x.f[k], y.f[k], 0, of_vf(a op b).f[k], x.f[k] op y.f[k])
    OPERATOR(+);
    OPERATOR(-);
    OPERATOR(*);
    OPERATOR(/);
  }
}

static void lanes_convert_and_reduce(void **unused) {
  for (int k = 0; k < V_LANES; k++) {
    assert_true(of_vf(v_lane_x()).f[k] == (float)(k % V_PACKET_X));
    assert_true(of_vf(v_lane_y()).f[k] == (float)(k / V_PACKET_X));
  }
  for (int round = 0; round < ROUNDS; round++) {
    lanes x = floats(), y = floats(), i = ints();
    int count = 0;
    unsigned bits_set = 0;
    float least = INFINITY;
    for (int k = 0; k < V_LANES; k++) count += x.f[k] < y.f[k], bits_set |= (unsigned)(x.f[k] < y.f[k]) << k;
    vm less = v_lt(v_load(x.f), v_load(y.f));
    assert_int_equal(m_count(less), count);
    assert_int_equal(m_any(less), count > 0);
    assert_int_equal(m_bits(less), bits_set);
    lanes chosen = of_vf(v_select(less, v_load(x.f), v_load(y.f))), number = of_vf(v_float(to_vi(&i)));
    lanes set = of_vf(v_set(x.f[0])), seti = of_vi(v_seti(i.i[0])), bits = of_vi(v_bits(v_load(x.f)));
    for (int k = 0; k < V_LANES; k++) {
      assert_true(same(chosen.f[k], x.f[k] < y.f[k] ? x.f[k] : y.f[k]));
      assert_true(number.f[k] == (float)i.i[k]);
      assert_true(same(set.f[k], x.f[0]) && seti.i[k] == i.i[0] && same(bits.f[k], x.f[k]));
    }
    for (int k = 0; k < V_LANES; k++) {
      if (!(fabsf(x.f[k]) < 0x1p31f)) x.f[k] = (float)k - 2.75f;
      least = fminf(least, x.f[k]);
    }
    lanes whole = of_vi(v_trunc(v_load(x.f)));
    for (int k = 0; k < V_LANES; k++) assert_int_equal(whole.i[k], (int32_t)x.f[k]);
    assert_true(v_least(v_load(x.f)) == least);
  }
}

/* The memory ends PAD bytes after the last element that is asked for, where the address sanitizer looks. */
static void voxels_are_read_exactly(void **unused) {
  uint8_t *memory = malloc(BYTES + PAD);
  for (int k = 0; k < BYTES + PAD; k++) memory[k] = (uint8_t)draw();
#define PAIRS(name, type)                                                                                             \
  for (int round = 0; round < ROUNDS / 4; round++) {                                                                  \
    const int last = BYTES / (int)sizeof(type) - 2;                                                                   \
    lanes off;                                                                                                        \
    for (int k = 0; k < V_LANES; k++) off.i[k] = round ? (int)(draw() % (unsigned)(last + 1)) : last;                 \
    vf a, b, c, d;                                                                                                    \
    const v_places at = v_place(to_vi(&off));                                                                         \
    v_pair_##name(memory, &at, &a, &b);                                                                               \
    CORNER_##name(&c, &d);                                                                                            \
    for (int k = 0; k < V_LANES; k++) {                                                                               \
      const type *p = (const type *)(const void *)memory + off.i[k];                                                  \
      assert_true(same(of_vf(a).f[k], (float)p[0]) && same(of_vf(b).f[k], (float)p[1]));                              \
      assert_true(same(of_vf(c).f[k], (float)p[0]) && same(of_vf(d).f[k], (float)p[1]));                              \
    }                                                                                                                 \
    GATHERED(name)                                                                                                    \
  }
#define CORNER(name, bias, c, d) v_corner_##name(memory, &at, c, d), *(c) = *(c) - v_set(bias), *(d) = *(d) - v_set(bias)
#define CORNER_u8(c, d) CORNER(u8, V_BIAS_U8, c, d)
#define CORNER_i8(c, d) CORNER(i8, V_BIAS_I8, c, d)
#define CORNER_u16(c, d) CORNER(u16, V_BIAS_U16, c, d)
#define CORNER_i16(c, d) CORNER(i16, V_BIAS_I16, c, d)
#define CORNER_f32(c, d) (*(c) = a, *(d) = b)
#ifdef V_GATHERS /* the bits of the pair that is loaded: with the bias again */
#define GATHERED(name)                                                                                                \
  v_gather_corner_##name(memory, &at, &c, &d);                                                                        \
  BIASED_##name(&a, &b);                                                                                              \
  for (int k = 0; k < V_LANES; k++)                                                                                   \
    assert_true(same(of_vf(c).f[k], of_vf(a).f[k]) && same(of_vf(d).f[k], of_vf(b).f[k]));
#define BIASED_u8(a, b) v_corner_u8(memory, &at, a, b)
#define BIASED_i8(a, b) v_corner_i8(memory, &at, a, b)
#define BIASED_u16(a, b) v_corner_u16(memory, &at, a, b)
#define BIASED_i16(a, b) v_corner_i16(memory, &at, a, b)
#define BIASED_f32(a, b) v_pair_f32(memory, &at, a, b)
#else
#define GATHERED(name)
#endif
  SIMD_VOXELS(PAIRS)
  lanes off, words;
  for (int k = 0; k < V_LANES; k++) words.i[k] = k ? (int)(draw() % (BYTES / 4)) : BYTES / 4 - 1;
  lanes gathered = of_vf(v_gather((const float *)(const void *)memory, to_vi(&words)));
  lanes loaded = of_vi(v_load_bytes(memory + BYTES - V_LANES));
  for (int k = 0; k < V_LANES; k++) {
    assert_true(same(gathered.f[k], ((const float *)(const void *)memory)[words.i[k]]));
    assert_int_equal(loaded.i[k], memory[BYTES - V_LANES + k]);
  }
  for (int k = 0; k < V_LANES; k++) off.i[k] = k ? (int)(draw() % BYTES) : BYTES - 1;
  lanes bytes = of_vi(v_bytes(memory, to_vi(&off)));
  for (int k = 0; k < V_LANES; k++) assert_int_equal(bytes.i[k], memory[off.i[k]]);
  free(memory);
}

static void tables_are_looked_up_and_lanes_compacted(void **unused) {
  enum { TABLE = 96 };
  float table[TABLE], room[2 * V_LANES];
  for (int k = 0; k < TABLE; k++) table[k] = (float)k - 0.5f;
  for (int round = 0; round < ROUNDS; round++) {
    lanes at, a, b;
    for (int k = 0; k < V_LANES; k++) at.i[k] = round ? (int)(draw() % TABLE) : TABLE - 1, a.f[k] = (float)(k + 1), b.f[k] = draw() & 1 ? 1 : -1;
    const lanes found = of_vf(v_table(table, to_vi(&at)));
    for (int k = 0; k < V_LANES; k++) assert_true(found.f[k] == table[at.i[k]]);
    const vm set = v_lt(v_set(0), v_load(b.f));
    for (int k = 0; k < 2 * V_LANES; k++) room[k] = -7;
    v_compact(room, set, v_load(a.f));
    int n = 0;
    for (int k = 0; k < V_LANES; k++)
      if (b.f[k] > 0) assert_true(room[n++] == a.f[k]);
    assert_int_equal(n, m_count(set));
    for (int k = V_LANES; k < 2 * V_LANES; k++) assert_true(room[k] == -7);
  }
}

#ifdef V_NEAR
#define V_BIAS_F32 0
/* In memory that holds nothing beside: the voxels, rows and slices of random lengths between. */
static void neighbourhoods_hold_their_voxels(void **unused) {
#define NEAR(name, NAME, type)                                                                                        \
  for (int round = 0; round < ROUNDS / 8; round++) {                                                                  \
    const int w = V_NEAR_##NAME, row = w + (int)(draw() % 9), slice = 3 * row + w + (int)(draw() % 30);               \
    const int count = 3 * slice + 3 * row + w, more = w * (round % 2 + 4 * (round / 2 % 2));                         \
    type *memory = malloc((size_t)count * sizeof *memory);                                                            \
    for (int k = 0; k < count; k++) memory[k] = (type)(int)draw();                                                    \
    const v_near_##name n = v_near_load_##name(memory, row, slice);                                                   \
    lanes at;                                                                                                         \
    vf a, b;                                                                                                          \
    for (int k = 0; k < V_LANES; k++)                                                                                 \
      at.i[k] = (int)(draw() % (unsigned)(w - 1)) + w * (int)(draw() % 3) + 4 * w * (int)(draw() % 3);                \
    v_near_pair_##name(&n, to_vi(&at), more, &a, &b);                                                                 \
    lanes first = of_vf(a - v_set(V_BIAS_##NAME)), second = of_vf(b - v_set(V_BIAS_##NAME));                          \
    for (int k = 0; k < V_LANES; k++) {                                                                               \
      for (int pair = 0; pair < 2; pair++) {                                                                          \
        int e = at.i[k] + more + pair;                                                                                \
        float wanted = (float)memory[e % w + e / w % 4 * row + e / w / 4 * slice];                                    \
        float got = pair ? second.f[k] : first.f[k];                                                                  \
        if (!same(got, wanted)) FAIL("v_near_pair_" #name, k, at.i[k], pair, 0, got, wanted);                         \
      }                                                                                                               \
    }                                                                                                                 \
    free(memory);                                                                                                     \
  }
  NEAR(u8, U8, uint8_t)
  NEAR(i8, I8, int8_t)
  NEAR(u16, U16, uint16_t)
  NEAR(i16, I16, int16_t)
  NEAR(f32, F32, float)
}

/* In memory that holds little beside. The differences of voxels of 16 bits are within 16 bits. */
static void neighbourhoods_hold_their_slopes(void **unused) {
#define SLOPES(name, type, cells, rows, slices)                                                                       \
  for (int round = 0; round < ROUNDS / 8; round++) {                                                                  \
    const int row = 8 + (int)(draw() % 9), slice = 7 * row + (int)(draw() % 30), first = slice + 1;                   \
    const int count = first + slices * slice + (rows - 1) * row + cells + 2, along[] = {1, row, slice};               \
    type *memory = malloc((size_t)count * sizeof *memory);                                                            \
    for (int k = 0; k < count; k++)                                                                                   \
      memory[k] = (type)((type)-1 < 0 ? -0x4000 : 0x8000) + (type)(draw() % 4 ? draw() & 0x7fff : draw() % 2 * 0x7fff); \
    const v_slopes_##name n = v_slopes_load_##name(memory + first, row, slice, rows, slices);                         \
    const int which = round % 3, y = (int)(draw() % 2), z = (int)(draw() % 2);                                        \
    lanes at, f;                                                                                                      \
    int voxel[V_LANES];                                                                                               \
    for (int k = 0; k < V_LANES; k++) {                                                                               \
      const int c[] = {(int)(draw() % cells), (int)(draw() % (rows - 1)), (int)(draw() % (slices - 1))};              \
      at.i[k] = c[0] + (cells == 3 ? 4 * c[1] + 16 * c[2] : 8 * c[1] + 32 * c[2]);                                    \
      f.f[k] = draw() % 4 ? (float)(draw() % 0x1000000) / 0x1p24f : (float)(draw() % 2) * (1 - 0x1p-24f);             \
      voxel[k] = first + c[0] + (c[1] + y) * row + (c[2] + z) * slice;                                                \
    }                                                                                                                 \
    const lanes got = of_vf(v_slope_##name(&n, which, to_vi(&at), y, z, v_load(f.f)));                                \
    for (int k = 0; k < V_LANES; k++) {                                                                               \
      double slope[2], share = cells == 3 ? (double)f.f[k] : floor((double)f.f[k] * V_SLOPE_SHARES);                  \
      for (int e = 0; e < 2; e++) {                                                                                   \
        const type *v = memory + voxel[k] + e;                                                                        \
        slope[e] = (double)((float)v[along[which]] - (float)v[-along[which]]);                                        \
      }                                                                                                               \
      const float wanted = (float)(cells == 3 ? slope[0] + share * (double)(float)(slope[1] - slope[0])               \
                                              : V_SLOPE_SHARES * slope[0] + share * (slope[1] - slope[0]));           \
      if (!same(got.f[k], wanted)) FAIL("v_slope_" #name, k, at.i[k], which, 0, got.f[k], wanted);                    \
    }                                                                                                                 \
    free(memory);                                                                                                     \
  }
#define SLOPES_OF_INTEGERS(name, type)                                                                                \
  SLOPES(name, type, 5, 4, 4) SLOPES(name, type, 5, 4, 5) SLOPES(name, type, 5, 5, 5)
  SLOPES_OF_INTEGERS(u8, uint8_t)
  SLOPES_OF_INTEGERS(i8, int8_t)
  SLOPES_OF_INTEGERS(u16, uint16_t)
  SLOPES_OF_INTEGERS(i16, int16_t)
  SLOPES(f32, float, 3, 4, 4)
}
#else
static void neighbourhoods_hold_their_voxels(void **unused) {}
static void neighbourhoods_hold_their_slopes(void **unused) {}
#endif

#ifdef V_TAPS
/* Elements exactly; weighed pairs as differences, because the constant added to each cancels. */
static void rows_of_four_are_loaded_and_weighed(void **unused) {
#define TAPS(name, type)                                                                                              \
  for (int round = 0; round < ROUNDS / 8; round++) {                                                                  \
    enum { COUNT = 500 };                                                                                             \
    type memory[COUNT];                                                                                               \
    lanes at, upper, weights;                                                                                         \
    for (int k = 0; k < COUNT; k++) memory[k] = (type)(draw() % 4 ? draw() : draw() % 2 ? (uint64_t)-1 : 0);          \
    for (int k = 0; k < V_LANES; k++) {                                                                               \
      at.i[k] = (int)(draw() % (COUNT - 3));                                                                          \
      upper.i[k] = draw() % 4 ? (int)(draw() % V_SLOPE_SHARES) : (int)(draw() % 2) * V_SLOPE_SHARES;                  \
      weights.i[k] = (V_SLOPE_SHARES - upper.i[k]) | upper.i[k] << 16;                                                \
    }                                                                                                                 \
    const v_places places = v_place(to_vi(&at));                                                                      \
    const v_taps four = v_taps_##name(memory, &places);                                                               \
    vf row[4];                                                                                                        \
    v_row_##name(memory, &places, row);                                                                               \
    for (int e = 0; e < 4; e++)                                                                                       \
      for (int k = 0; k < V_LANES; k++) {                                                                             \
        const float got = of_vf(row[e]).f[k], wanted = (float)memory[at.i[k] + e];                                    \
        if (!same(got, wanted)) FAIL("v_row_" #name, k, at.i[k], e, 0, got, wanted);                                  \
      }                                                                                                               \
    const vi single = v_weigh(v_tap_pair_##name(memory, &places), to_vi(&weights));                                   \
    for (int pair = 0; pair < 3; pair++) {                                                                            \
      const lanes got = of_vi(v_subi(v_weigh(four.pair[pair], to_vi(&weights)), single));                             \
      for (int k = 0; k < V_LANES; k++) {                                                                             \
        const type *v = memory + at.i[k], *w = v + pair;                                                              \
        const int64_t wanted = ((int64_t)w[0] - v[0]) * (V_SLOPE_SHARES - upper.i[k]) +                               \
                               ((int64_t)w[1] - v[1]) * upper.i[k];                                                   \
        assert_int_equal(got.i[k], wanted);                                                                           \
      }                                                                                                               \
    }                                                                                                                 \
  }
  TAPS(u8, uint8_t)
  TAPS(i8, int8_t)
  TAPS(u16, uint16_t)
  TAPS(i16, int16_t)
}
#else
static void rows_of_four_are_loaded_and_weighed(void **unused) {}
#endif

/* Of packets whose rows are `row` pixels apart; memory between them keeps its values. */
static void pixels_are_stored_in_place(void **unused) {
  enum { ROW = V_PACKET_X + 3, COUNT = 4 * ROW * V_PACKET_Y };
  lanes l[4];
  float out[COUNT];
  for (int c = 0; c < 4; c++)
    for (int k = 0; k < V_LANES; k++) l[c].f[k] = (float)(100 * k + c);
  for (int i = 0; i < COUNT; i++) out[i] = -1;
  v_store_pixels(out, ROW, (vf4){v_load(l[0].f), v_load(l[1].f), v_load(l[2].f), v_load(l[3].f)});
  for (int i = 0; i < COUNT; i++) {
    const int x = i / 4 % ROW, y = i / 4 / ROW;
    const float wanted = x < V_PACKET_X ? (float)(100 * (V_PACKET_X * y + x) + i % 4) : -1;
    if (!same(out[i], wanted)) FAIL("v_store_pixels", i / 4, x, y, i % 4, out[i], wanted);
  }
}

static void prefetching_reads_nothing(void **unused) {
  lanes off = ints();
  const v_places at = v_place(to_vi(&off));
  v_prefetch(NULL, &at, 4);
}

static void bilinear_is_exact_at_entries_and_near_between(void **unused) {
  enum { ENTRIES = 64 };
  float *table = malloc(ENTRIES * 4 * sizeof *table);
  for (int k = 0; k < ENTRIES * 4; k++) table[k] = (float)(int32_t)draw() * 0x1p-31f;
  for (int k = 0; k < 8; k++) table[k] = table[ENTRIES * 4 - 8 + k] = (float)(k % 4) / 3; /* two equal entries at either end */
  for (int round = 0; round < ROUNDS; round++) {
    lanes row[2], f[2];
    for (int k = 0; k < V_LANES; k++)
      for (int s = 0; s < 2; s++) {
        row[s].i[k] = round % 4 == 0 ? (ENTRIES - 2) * (s ^ (k & 1)) : (int)(draw() % (ENTRIES - 1));
        f[s].f[k] = round % 4 == 1 ? 0 : (float)(draw() >> 8) * 0x1p-24f;
      }
    vf4 got = v_bilinear(table, to_vi(&row[0]), to_vi(&row[1]), v_load(f[0].f), v_load(f[1].f));
    vf channels[4] = {got.r, got.g, got.b, got.a};
    for (int k = 0; k < V_LANES; k++)
      for (int c = 0; c < 4; c++) {
        const float *p = table + 4 * row[0].i[k] + c, *q = table + 4 * row[1].i[k] + c;
        double x = f[0].f[k], y = f[1].f[k], a = p[0] + y * ((double)q[0] - p[0]), b = p[4] + y * ((double)q[4] - p[4]);
        double off = fabs((double)of_vf(channels[c]).f[k] - (a + x * (b - a)));
        if (round % 4 < 2) assert_true(of_vf(channels[c]).f[k] == p[0]);
        assert_true(off <= 6 * 0x1p-24); /* six roundings of numbers up to 2, each half an ulp */
      }
  }
  free(table);
}

__attribute__((noinline)) static int run(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(rows_mean_the_same_in_every_lane), cmocka_unit_test(lanes_convert_and_reduce),
      cmocka_unit_test(voxels_are_read_exactly), cmocka_unit_test(tables_are_looked_up_and_lanes_compacted),
      cmocka_unit_test(bilinear_is_exact_at_entries_and_near_between),
      cmocka_unit_test(rows_of_four_are_loaded_and_weighed),
      cmocka_unit_test(neighbourhoods_hold_their_voxels), cmocka_unit_test(neighbourhoods_hold_their_slopes),
      cmocka_unit_test(prefetching_reads_nothing),
      cmocka_unit_test(pixels_are_stored_in_place)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}

int main(void) {
  __builtin_cpu_init();
  if (!(SIMD_RUNS)) return printf("%s: not on this processor\n", SIMD_HEADER) < 0;
  return run();
}
