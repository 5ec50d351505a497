// Compositing in linear light: the sRGB curve (IEC 61966-2-1).
vec3 encode(vec3 color) {
  color = clamp(color, 0.0, 1.0);
  vec3 curve = 1.055 * pow(max(color, vec3(1e-6)), vec3(1.0 / 2.4)) - 0.055;
  return mix(curve, 12.92 * color, lessThanEqual(color, vec3(0.0031308)));
}
