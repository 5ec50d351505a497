// 0..1 to 8 bits, round to nearest; red in the low byte.
uint to_bytes(vec4 color) {
  uvec4 b = uvec4(clamp(color, 0.0, 1.0) * 255.0 + 0.5);
  return b.r | b.g << 8 | b.b << 16 | b.a << 24;
}
