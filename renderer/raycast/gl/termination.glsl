// Early ray termination: a ray ends where its transparency falls below the threshold, job.background.w.

// Opacity has a sum of its own, because thin segments take nothing from a transparency of 1 in single precision. A
// terminated ray is scaled to opacity 1, as if what it did not reach looked like what it passed: an opaque region keeps
// its colour exactly.
vec4 finish(vec4 sum, float clear) {
  bool full = sum.a > 1.0;
#if TERMINATION
  full = full || clear < job.background.w;
#endif
  return full ? sum / sum.a : sum;
}
