// Jitter: each pixel's phase is shifted by interleaved gradient noise, in the integers of jitter.h.
float add_jitter(uvec2 pixel, float phase) {
  uint inner = pixel.x * 288237661u + pixel.y * 25070368u;
  uint noise = inner * 53u - (inner >> 16) * 1119u;
  phase += float((noise >> 8) + 1u) * (1.0 / 16777216.0);
  return phase > 1.0 ? phase - 1.0 : phase;
}
