// Opacity 1 - exp(-x) of optical depth x >= 0, accurate for small x.
float opacity_of_depth(float x) {
  precise float thin = 1.0;
  for (int n = 7; n > 1; n--)
    thin = 1.0 - min(x, 0.5) / float(n) * thin; // (1 - exp(-x)) / x
  return x < 0.35 ? x * thin : 1.0 - exp2(max(x * -1.44269504, -126.0));
}

// Opacity correction: over a share of the segment, transparency is t^share, and colour is proportional to opacity.
vec4 shorten(vec4 segment, float share) {
  float opacity = 1.0 - exp2(share * log2(max(1.0 - segment.a, 1e-30)));
  return (segment.a < 1e-4 ? share : opacity / segment.a) * segment;
}
