// Background behind the picture; alpha 255.
uint resolve(vec4 premultiplied) {
  vec3 color = premultiplied.rgb + (1.0 - premultiplied.a) * job.background.rgb;
  return to_bytes(vec4(encode(color), 1.0));
}
