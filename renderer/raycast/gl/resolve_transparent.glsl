// No background: straight alpha, black where alpha is 0.
uint resolve(vec4 premultiplied) {
  vec3 color = premultiplied.a > 0.0 ? premultiplied.rgb / premultiplied.a : vec3(0.0);
  return to_bytes(vec4(encode(color), premultiplied.a));
}
