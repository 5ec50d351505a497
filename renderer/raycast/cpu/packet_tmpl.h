/* A packet: one ray for each of V_LANES neighbouring pixels, clipped to the volume and the clip planes
 * (raycast/rays.h). */

#include "renderer/raycast/cpu/clip_tmpl.h"

/* Compiled once per instruction set and called, not inlined into every kernel. */
#define V_ONCE static __attribute__((noinline, unused))

/* The options of a kernel: rows of the table of variants (kernels_tmpl.h). A member BY_KEY is read from the plan's key
 * at run time. */
#define VARIANT_MEMBERS(MEMBER)                                                                                       \
  MEMBER(mode)           /* tc_mode; mip stands for minip too */                                                      \
  MEMBER(type)           /* tc_voxel_type */                                                                          \
  MEMBER(filter)         /* tc_filter */                                                                              \
  MEMBER(slab)           /* mpr: as in tc_plan_key */                                                                 \
  MEMBER(classification) /* tc_classification */                                                                      \
  MEMBER(back_to_front)                                                                                               \
  MEMBER(shaded)                                                                                                      \
  MEMBER(gradient) /* tc_gradient */                                                                                  \
  MEMBER(leap)     /* empty-space skipping */                                                                         \
  MEMBER(labels)                                                                                                      \
  MEMBER(several) /* rays per pixel (subpixel_tmpl.h) */                                                              \
  MEMBER(jitter)                                                                                                      \
  MEMBER(subtables) /* the pre-integration table has subtables (classify/preintegration.h) */
#define BY_KEY -1

/* The type of the volume's voxels, as a constant before anything is inlined where the translation unit has kernels of one type alone:
 * code for the others is then dropped before it is copied into every kernel. Not for the type of any other array, such as labels. */
#ifdef TC_VOXELS
#define VOXELS(type) ((int)CONCATENATED(TYPE_, TC_VOXELS))
#else
#define VOXELS(type) (type)
#endif
#define CONCATENATED(a, b) CONCATENATED_NOW(a, b)
#define CONCATENATED_NOW(a, b) a##b

typedef struct variant {
#define MEMBER(name) int8_t name;
  VARIANT_MEMBERS(MEMBER)
#undef MEMBER
  bool any_type; /* `type` is read from the key: samples are loaded by functions, so that the kernel compiles fast */
} variant;

typedef struct packet {
  vf entry[3], dir[3]; /* index coordinates; voxels per mm */
  vf inverse[3];       /* 1 / dir */
  vf start, length;    /* mm from the anchor to the entry; mm inside the volume, 0 for a ray that misses */
  vf forward;          /* mm of depth per mm of the ray (skip/cover.h) */
  vm live;
  vf delay;         /* steps that a lane waits before its first sample (neighbourhood_tmpl.h) */
  float most_delay; /* largest delay of a lane */
  vf lag; /* mm: samples lie at whole steps from the entry minus lag; set in dvr with several rays or jitter */
} packet;

/* The packet's pixels, V_PACKET_X by V_PACKET_Y from (x, y), limited by (x1, y1), and the number of the ray to cast. */
typedef struct place {
  int x, y, x1, y1;
  const tc_subpixel_single *ray;
} place;

/* The positions of the rays on the picture, in pixels. */
V_INLINE void ray_places(variant v, const place *at, vf *i, vf *j) {
  *i = v_set((float)at->x + 0.5f) + v_lane_x();
  *j = v_set((float)at->y + 0.5f) + v_lane_y();
  if (v.several) *i = *i + v_set(at->ray->x), *j = *j + v_set(at->ray->y);
}

V_INLINE packet start_packet(const tc_cpu_args *args, variant v, const place *at) {
  packet p;
  vf i, j, anchor[3], view[3], norm = v_set(0);
  ray_places(v, at, &i, &j);
#pragma GCC unroll 3
  for (int k = 0; k < 3; k++) {
    anchor[k] = v_fma(j, v_set(args->rays.anchor_dv[k]),
                      v_fma(i, v_set(args->rays.anchor_du[k]), v_set(args->rays.anchor0[k])));
    view[k] =
        v_fma(j, v_set(args->rays.view_dv[k]), v_fma(i, v_set(args->rays.view_du[k]), v_set(args->rays.view0[k])));
    norm = v_fma(view[k], view[k], norm);
  }
  norm = v_sqrt(norm);
  vf s0 = v_set(0) - (args->rays.perspective ? norm : v_set(args->rays.eye_mm)), s1 = v_set(args->rays.far_mm);
#pragma GCC unroll 3
  for (int k = 0; k < 3; k++) {
    vf d = view[0] * v_set(args->rays.to_index[k][0]);
    d = v_fma(view[1], v_set(args->rays.to_index[k][1]), d);
    p.dir[k] = v_fma(view[2], v_set(args->rays.to_index[k][2]), d) / norm;
    p.inverse[k] = v_set(1) / v_select(v_lt(v_abs(p.dir[k]), v_set(1e-12f)), v_set(1), p.dir[k]);
    clip_axis(anchor[k], p.dir[k], p.inverse[k], v_set(args->rays.lo[k]), v_set(args->rays.hi[k]), &s0, &s1);
  }
  for (int c = 0; c < args->rays.n_planes; c++) clip_plane(args->rays.planes[c], anchor, p.dir, &s0, &s1);
  vm inside = m_and(v_lt(i, v_set((float)at->x1)), v_lt(j, v_set((float)at->y1)));
  p.live = m_and(inside, v_lt(s0, s1));
  s0 = v_select(p.live, s0, v_set(0));
  p.start = s0;
  p.delay = v_set(0);
  p.most_delay = 0;
  p.forward = v_set(1);
  if (args->rays.perspective) p.forward = v_set((float)args->cover.view_depth) / norm;
  p.length = v_select(p.live, s1 - s0, v_set(0));
#pragma GCC unroll 3
  for (int k = 0; k < 3; k++) p.entry[k] = v_fma(s0, p.dir[k], anchor[k]);
  return p;
}

/* Exponential back-off of empty-space skipping, for the packets of a tile. Where little can be skipped, the test costs
 * more than it saves: after a packet that gained nothing, the next packets march without the test, twice as many each
 * time. No bit of the picture depends on it. */
typedef struct skip_backoff {
  int wait; /* packets still to march without the test */
  int last; /* number of such packets last time */
} skip_backoff;

/* Without the attribute cold: GCC would take the loops around the calls for cold, too, and compile them for size. */
static __attribute__((noinline)) bool poll_halt(const tc_cpu_args *args, tc_cpu_counts *counts) {
  counts->left = counts->left || tc_halt_within(args->halt);
  counts->until_poll = counts->left ? 1 : TC_CPU_POLL_STEPS; /* once interrupted, every march of the unit ends */
  return counts->left;
}

#define POLL_STRIDE 16 /* steps are counted 16 at a time: counting each one costs some percent of a frame */

/* Called before step number `step` of every march: false once no ray is live, or the halt interrupts the unit. */
V_INLINE bool keep_marching(const tc_cpu_args *args, vm live, tc_cpu_counts *counts, int step) {
  if (__builtin_expect(step % POLL_STRIDE == 0, 0) && (counts->until_poll -= POLL_STRIDE) <= 0 &&
      poll_halt(args, counts))
    return false;
  return m_any(live);
}

/* Called before a run of `steps` that calls no keep_marching(): false if the halt interrupts the unit. */
V_INLINE bool keep_polling(const tc_cpu_args *args, int steps, tc_cpu_counts *counts) {
  return __builtin_expect((counts->until_poll -= steps) > 0, 1) || !poll_halt(args, counts);
}

/* Writes the packet's pixels before x1 and y1; `out` is its first pixel. */
V_INLINE void store_packet(vf4 c, const place *at, float *out, ptrdiff_t stride) {
  if (at->x + V_PACKET_X <= at->x1 && at->y + V_PACKET_Y <= at->y1) {
    v_store_pixels(out, stride, c);
    return;
  }
  float lanes[4][V_LANES];
  v_store(lanes[0], c.r);
  v_store(lanes[1], c.g);
  v_store(lanes[2], c.b);
  v_store(lanes[3], c.a);
  for (int l = 0; l < V_LANES; l++) {
    int px = l % V_PACKET_X, py = l / V_PACKET_X;
    if (at->x + px >= at->x1 || at->y + py >= at->y1) continue;
    float *pixel = out + (py * stride + px) * 4;
    for (int k = 0; k < 4; k++) pixel[k] = lanes[k][l];
  }
}

/* Reads back what store_packet() wrote: the sums of rays so far. */
V_ONCE vf4 load_packet(const place *at, const float *out, ptrdiff_t stride) {
  float lanes[4][V_LANES] = {{0}};
  for (int l = 0; l < V_LANES; l++) {
    int px = l % V_PACKET_X, py = l / V_PACKET_X;
    if (at->x + px >= at->x1 || at->y + py >= at->y1) continue;
    const float *pixel = out + (py * stride + px) * 4;
    for (int k = 0; k < 4; k++) lanes[k][l] = pixel[k];
  }
  return (vf4){v_load(lanes[0]), v_load(lanes[1]), v_load(lanes[2]), v_load(lanes[3])};
}
