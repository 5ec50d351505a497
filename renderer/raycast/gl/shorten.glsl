// The same medium over a share of a segment: the full one's transparency to the power of it, and colour as opacity.
vec4 shorten(vec4 segment, float share) {
  float opacity = 1.0 - exp2(share * log2(max(1.0 - segment.a, 1e-30)));
  return (segment.a < 1e-4 ? share : opacity / segment.a) * segment;
}
