// The mean of the field over a ray's length by the trapezoidal rule with a shorter last interval. Differences to the
// first sample are summed with Kahan's compensation: a constant field is exact, and a million samples lose no more
// precision than ten. Intervals whose middle is in a gap of the volume (LABELLED) are ignored.
vec4 march(vec3 anchor, vec3 direction, vec2 span, inout Counts counts) {
  precise vec3 entry = fma(vec3(span.x), direction, anchor);
  float length_mm = span.y - span.x;
  float steps = length_mm * job.rays.inverse_step;
  float base = sample_signed(entry, direction, 0.0);
  float front = base;
  precise float sum = 0.0;
  precise float lost = 0.0;
#if LABELLED
  float total = 0.0;
#else
  float total = steps;
#endif
  counts.samples++;
  for (int i = 0; float(i) * job.rays.step_mm < length_mm; i++) {
    float back = sample_signed(entry, direction, min(float(i + 1) * job.rays.step_mm, length_mm));
    float share = clamp(steps - float(i), 0.0, 1.0);
#if LABELLED
    if (!has_value(fma(vec3((float(i) + 0.5 * share) * job.rays.step_mm), direction, entry)))
      share = 0.0;
    total += share;
#endif
    precise float add = share * (0.5 * (front - base) + 0.5 * (back - base)) - lost;
    precise float next = sum + add;
    lost = (next - sum) - add;
    sum = next;
    front = back;
    counts.samples++;
  }
#if LABELLED
  if (total <= 0.0)
    return vec4(0.0);
#endif
  return grey_of(base + sum / max(total, 1e-30));
}
