// Multiplanar reformats (MPR): one sample per pixel, or a slab's maximum, minimum or mean, mapped to grey by the
// window. SLAB: 0 slice, 1 maximum, 2 minimum, 3 mean. Returns grey with opacity 1. Samples in a volume's gaps (GAPS)
// are ignored, as are intervals of the mean whose middle is in a gap; opacity is 0 if nothing remains.
#define GAPS (LABELLED == 2)

float sample_slice(vec3 entry, vec3 direction, float t) {
  vec3 p = fma(vec3(t), direction, entry);
  return clamp((field(p) - job.nodes.x) * job.nodes.y, 0.0, job.nodes.z);
}

bool met = true; // at least one sample or interval counted

#if SLAB
// Samples lie on the plane, at whole steps from it, and at both ends of the ray.
float cast_slab(vec3 entry, vec3 direction, vec2 span, float front, inout Counts counts) {
  float length_mm = span.y - span.x;
  float first = floor(span.x * job.rays.inverse_step) + 1.0;
  float value = front, sum = 0.0, before = 0.0, total = 0.0;
#if GAPS
  if (!met)
    value = SLAB == 2 ? job.nodes.z : 0.0;
#endif
  for (int i = 0; before < length_mm; i++) {
    float t = clamp((first + float(i)) * job.rays.step_mm - span.x, 0.0, length_mm);
    float back = sample_slice(entry, direction, t);
    counts.samples++;
    bool counted = true;
#if GAPS
    counted = has_value(fma(vec3(SLAB == 3 ? 0.5 * (before + t) : t), direction, entry));
    met = met || counted;
#endif
    if (counted) {
#if SLAB == 1
      value = max(value, back);
#elif SLAB == 2
      value = min(value, back);
#else
      sum += (t - before) * 0.5 * (front + back);
#endif
      total += t - before;
    }
    front = back;
    before = t;
  }
#if SLAB == 3
#if !GAPS
  total = length_mm;
#endif
  value = total > 1e-30 ? sum / total : value;
#endif
  return value;
}
#endif

vec4 march(vec3 anchor, vec3 direction, vec2 span, inout Counts counts) {
  vec3 entry = fma(vec3(span.x), direction, anchor);
  float value = sample_slice(entry, direction, 0.0);
  counts.samples++;
#if GAPS
  met = has_value(entry);
#endif
#if SLAB
  value = cast_slab(entry, direction, span, value, counts);
#endif
  float grey = clamp((value - job.window.x) * job.window.y + 0.5, 0.0, 1.0);
  if (!met)
    return vec4(0.0);
#if LABELLED == 1 // on the slice plane, or at the point of the ray nearest to the plane
  return vec4(label_slice(grey, fma(vec3(clamp(-span.x, 0.0, span.y - span.x)), direction, entry)), 1.0);
#else
  return vec4(vec3(grey), 1.0);
#endif
}
