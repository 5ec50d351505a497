// The mean of the field over a ray's length: trapezoids between samples, the last one shorter. Summed as differences to the
// first sample, with what rounding takes off put back: a constant field is exact, a million samples as good as ten.
vec4 march(vec3 anchor, vec3 direction, vec2 span, inout Counts counts) {
  precise vec3 entry = fma(vec3(span.x), direction, anchor);
  float length_mm = span.y - span.x;
  float steps = length_mm * job.rays.inverse_step;
  float base = sample_turned(entry, direction, 0.0);
  float front = base;
  precise float sum = 0.0;
  precise float lost = 0.0;
  counts.samples++;
  for (int i = 0; float(i) * job.rays.step_mm < length_mm; i++) {
    float back = sample_turned(entry, direction, min(float(i + 1) * job.rays.step_mm, length_mm));
    float share = clamp(steps - float(i), 0.0, 1.0);
    precise float add = share * (0.5 * (front - base) + 0.5 * (back - base)) - lost;
    precise float next = sum + add;
    lost = (next - sum) - add;
    sum = next;
    front = back;
    counts.samples++;
  }
  return grey_of(base + sum / max(steps, 1e-30));
}
