// The classifications that read 1-D tables (equations and layout: classify/integrals.h). "precise" fixes the rounding,
// so that all variants give the same bits.
layout(binding = 1) uniform samplerBuffer integrals;

// (L tau, tau) in a node interval at x in 0..1.
vec4 interval_at(int interval, float x) {
  vec4 a = texelFetch(integrals, 2 * interval), b = texelFetch(integrals, 2 * interval + 1);
  precise vec4 there = a + (b - a) * x;
  return there;
}

#if POST
vec4 mean_of(float front, float back) {
  int i = int(front);
  return interval_at(i, front - float(i));
}
#else
// Means between two nodes: exact sums over whole node intervals, plus the two ends.
vec4 mean_of(float front, float back) {
  float low = min(front, back), high = max(front, back);
  int i = int(low), j = int(high), p = min(i + 1, j);
  float f = low - float(i), e = high - float(j);
  bool within = i == j;
  vec4 a = interval_at(i, within ? 0.5 * (f + e) : 0.5 * (1.0 + f));
  vec4 b = interval_at(j, 0.5 * e);
  int row = job.table.y + (findMSB(p ^ j) + 1) * job.table.x;
  precise vec4 whole = texelFetch(integrals, row + p) + texelFetch(integrals, row + j);
  float wa = within ? 1.0 : 1.0 - f, wb = within ? 0.0 : e;
  precise vec4 sum = fma(vec4(wa), a, fma(vec4(wb), b, whole));
  precise vec4 mean = sum / (wa + wb + (within ? 0.0 : float(j - p)));
  return mean;
}
#endif

vec4 classify(float front, float back, float length_mm, bool is_part) {
  vec4 mean = mean_of(front, back);
  precise float depth = mean.a * (is_part ? length_mm : job.rays.step_mm);
#if LINEARIZED
  float opacity = min(depth, 1.0);
#else
  float opacity = opacity_of_depth(depth);
#endif
  precise vec4 segment = vec4(mean.rgb * (opacity / max(mean.a, 1e-37)), opacity);
  return segment;
}
