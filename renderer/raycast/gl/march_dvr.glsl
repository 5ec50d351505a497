// Front-to-back compositing of pre-integrated segments. Returns premultiplied colour and opacity.
vec4 march(vec3 anchor, vec3 direction, vec2 span, out uint samples) {
  vec3 entry = fma(vec3(span.x), direction, anchor);
  float length_mm = span.y - span.x;
  float step_mm = job.march.x;
  float front = node(field(entry));
  vec3 color = vec3(0.0);
  float clear = 1.0; // transparency keeps its bits near opaque, opacity would not
  float before = 0.0;
  samples = 1u;
  for (int i = 1;; i++) {
    float t = float(i) * step_mm;
    if (t > length_mm)
      break;
    float back = node(field(fma(vec3(t), direction, entry)));
    vec4 segment = classify(front, back);
    color += clear * segment.rgb;
    clear -= clear * segment.a;
    front = back;
    before = t;
    samples++;
#if TERMINATION
    if (clear < job.background.w)
      return vec4(color, 1.0 - clear);
#endif
  }
  // The last segment is shorter: the full one's transparency to the power of its share, and colour as opacity. It stands
  // behind the loop because software rasterisers pay for both sides of a branch.
  float share = (length_mm - before) / step_mm;
  if (share > 0.0) {
    vec4 segment = classify(front, node(field(fma(vec3(length_mm), direction, entry))));
    float opacity = 1.0 - exp2(share * log2(max(1.0 - segment.a, 1e-30)));
    float scale = segment.a < 1e-4 ? share : opacity / segment.a;
    color += clear * scale * segment.rgb;
    clear -= clear * scale * segment.a;
    samples++;
  }
  return vec4(color, 1.0 - clear);
}
