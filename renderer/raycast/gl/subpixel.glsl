// Rays with a phase, because of several rays per pixel (subpixel.h) or jitter (jitter.glsl): samples lie at whole steps
// from the entry minus `lag`, so that the first segment is shorter.
float lag; // mm, of the current ray

float lag_of(ivec2 pixel, float phase) {
#if JITTER
  phase = add_jitter(uvec2(pixel), phase);
#endif
  return (1.0 - phase) * job.rays.step_mm;
}
