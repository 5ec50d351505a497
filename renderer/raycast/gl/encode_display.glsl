// Compositing in display space: no conversion.
vec3 encode(vec3 color) {
  return color;
}
