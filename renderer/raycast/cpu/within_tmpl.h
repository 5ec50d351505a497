/* The ray caster (kernels_tmpl.h) for rays cast in parts: the same pieces, but a packet's rays start and end at the
 * spans of within.h. */
#define start_packet start_whole_packet
#include "renderer/raycast/cpu/packet_tmpl.h"
#undef start_packet

/* mm from the eye to the rays' anchors. */
V_INLINE vf anchor_depth(const tc_cpu_args *args, variant v, const place *at) {
  vf i, j, norm = v_set(0);
  if (!args->rays.perspective) return v_set(args->rays.eye_mm);
  ray_places(v, at, &i, &j);
  for (int k = 0; k < 3; k++) {
    vf view =
        v_fma(j, v_set(args->rays.view_dv[k]), v_fma(i, v_set(args->rays.view_du[k]), v_set(args->rays.view0[k])));
    norm = v_fma(view, view, norm);
  }
  return v_sqrt(norm);
}

V_INLINE packet start_packet(const tc_cpu_args *args, variant v, const place *at) {
  const tc_cpu_within *within = (const tc_cpu_within *)args;
  packet p = start_whole_packet(args, v, at);
  float from[V_LANES], until[V_LANES];
  for (int l = 0; l < V_LANES; l++) { /* lanes beyond the picture are not live */
    const int x = at->x + l % V_PACKET_X, y = at->y + l / V_PACKET_X;
    const int column = x < within->width ? x : within->width - 1, row = y < within->height ? y : within->height - 1;
    const float *span = within->spans[(ptrdiff_t)row * within->width + column];
    from[l] = span[0], until[l] = span[1];
  }
  const vf eye = anchor_depth(args, v, at), end = v_min(p.start + p.length, v_load(until) - eye);
  const vf start = v_max(p.start, v_load(from) - eye), later = start - p.start;
  p.live = m_and(p.live, v_lt(start, end));
  for (int k = 0; k < 3; k++) p.entry[k] = v_select(p.live, v_fma(later, p.dir[k], p.entry[k]), p.entry[k]);
  p.start = v_select(p.live, start, v_set(0));
  p.length = v_select(p.live, end - start, v_set(0));
  return p;
}

#include "renderer/raycast/cpu/marches_tmpl.h"

V_INLINE vf4 cast_rays(const tc_cpu_args *args, variant v, const place *at, skip_backoff *backoff,
                       tc_cpu_counts *counts) {
  vf4 c;
  if (v.mode != TC_MODE_DVR)
    cast_extreme(args, v, at, backoff, &c, counts);
  else if (v.back_to_front)
    cast_back_to_front(args, v, at, &c, counts);
  else
    cast_packet(args, v, at, &c, counts);
  return c;
}

#define ROWS(ROW)                                                                                                     \
  ROW(dvr_within, .type = BY_KEY, .filter = BY_KEY, .classification = BY_KEY, .back_to_front = BY_KEY,                \
      .shaded = BY_KEY, .gradient = BY_KEY, .leap = BY_KEY, .labels = BY_KEY,                                         \
      .several = BY_KEY, .jitter = BY_KEY, .subtables = BY_KEY)                                                          \
  ROW(mip_within, .mode = TC_MODE_MIP, .type = BY_KEY, .filter = BY_KEY, .leap = BY_KEY, .labels = BY_KEY,            \
      .several = BY_KEY)

#include "renderer/raycast/cpu/tile_tmpl.h"
