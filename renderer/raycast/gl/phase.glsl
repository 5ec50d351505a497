// Several rays per pixel, and jitter (subpixel.h): samples lie at whole steps from the entry, less `lag`, so that the
// first segment is shorter.
float lag; // mm, of the current ray

#if JITTER
// tc_jitter_phase(), in integers, so that every back end has the same phase.
float jitter_phase(uvec2 pixel) {
  uint inner = pixel.x * 288237661u + pixel.y * 25070368u;
  uint noise = inner * 53u - (inner >> 16) * 1119u;
  return float((noise >> 8) + 1u) * (1.0 / 16777216.0);
}
#endif

float lag_of(ivec2 pixel, float phase) {
#if JITTER
  phase += jitter_phase(uvec2(pixel));
  phase = phase > 1.0 ? phase - 1.0 : phase;
#endif
  return (1.0 - phase) * job.rays.step_mm;
}
