// Rays whose samples lie before whole steps from the entry (subpixel.h); the first segment is shorter for it.
float lag; // mm, of the ray that is marched

#if JITTER
// tc_jitter_phase(): whole numbers, so that every back end has the same.
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
