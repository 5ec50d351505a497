/* Several rays per pixel, and jitter: rays with a phase, whose first segment is shorter (raycast/subpixel.h). */

V_INLINE bool phased(variant v) { return v.jitter || v.several; }

/* (1 - phase) of a step in mm: samples lie at whole steps from the entry, less this. */
V_INLINE vf lag_of(const tc_cpu_args *args, variant v, const place *at) {
  vf phase = v_set(at->ray->phase);
  if (v.jitter) { /* the integers of tc_jitter_phase() */
    vi x = v_addi(v_seti(at->x), v_trunc(v_lane_x())), y = v_addi(v_seti(at->y), v_trunc(v_lane_y()));
    vi inner = v_addi(v_muli(x, v_seti((int)TC_JITTER_X)), v_muli(y, v_seti((int)TC_JITTER_Y)));
    vi high = v_andi(v_sra(inner, 16), v_seti(0xffff));
    vi noise = v_subi(v_muli(inner, v_seti((int)TC_JITTER_TIMES)), v_muli(high, v_seti((int)TC_JITTER_LESS)));
    noise = v_addi(v_andi(v_sra(noise, 8), v_seti(0xffffff)), v_seti(1));
    phase = phase + v_float(noise) * v_set(0x1p-24f);
    phase = v_select(v_lt(v_set(1), phase), phase - v_set(1), phase);
  }
  return (v_set(1) - phase) * v_set(args->rays.step_mm);
}

/* Distance of sample i from the rays' entries in mm: negative in a lane that still waits. */
V_INLINE vf sample_mm(const tc_cpu_args *args, variant v, const packet *p, int i) {
  vf t = (v_set((float)i) - p->delay) * v_set(args->rays.step_mm);
  return phased(v) ? v_max(t - p->lag, v_set(0)) : t;
}
