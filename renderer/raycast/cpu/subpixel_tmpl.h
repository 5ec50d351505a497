/* Rays with a phase, because of several rays per pixel or jitter: their first segment is shorter
 * (raycast/subpixel.h). */

V_INLINE bool phased(variant v) { return v.jitter || v.several; }

/* (1 - phase) of a step in mm: samples lie at whole steps from the entry minus this lag. */
V_INLINE vf lag_of(const tc_cpu_args *args, variant v, const place *at) {
  vf phase = v_set(at->ray->phase);
  if (v.jitter) phase = add_jitter(at, phase);
  return (v_set(1) - phase) * v_set(args->rays.step_mm);
}

/* Distance of sample i from the rays' entries in mm: negative in a lane that still waits. */
V_INLINE vf sample_mm(const tc_cpu_args *args, variant v, const packet *p, int i) {
  vf t = (v_set((float)i) - p->delay) * v_set(args->rays.step_mm);
  return phased(v) ? v_max(t - p->lag, v_set(0)) : t;
}
