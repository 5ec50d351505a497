// Early ray termination: a ray ends where its transparency falls below the threshold, job.background.w.

// Opacity is summed separately, because in single precision thin segments do not change a transparency of 1. A
// terminated ray is scaled to opacity 1, as if the rest of the ray looked like the part before: an opaque region keeps
// its colour exactly.
vec4 finish(vec4 sum, float clear) {
  bool full = sum.a > 1.0;
#if TERMINATION
  full = full || clear < job.background.w;
#endif
  return full ? sum / sum.a : sum;
}
