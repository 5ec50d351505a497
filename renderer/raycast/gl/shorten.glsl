// 1 - exp(-x), x >= 0, however small x is.
float opacity_of_depth(float x) {
  precise float thin = 1.0;
  for (int n = 7; n > 1; n--)
    thin = 1.0 - min(x, 0.5) / float(n) * thin; // (1 - exp(-x)) / x
  return x < 0.35 ? x * thin : 1.0 - exp2(max(x * -1.44269504, -126.0));
}

// The same medium over a share of a segment: the full one's transparency to the power of it, and colour as opacity.
vec4 shorten(vec4 segment, float share) {
  float opacity = 1.0 - exp2(share * log2(max(1.0 - segment.a, 1e-30)));
  return (segment.a < 1e-4 ? share : opacity / segment.a) * segment;
}
