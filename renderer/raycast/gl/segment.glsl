// Samples along a ray and the segments between them, for both orders of compositing.
//
// "precise" and fma() fix the rounding, so that all variants give the same bits: empty-space skipping changes nothing.
struct Sample {
  float t, node; // mm from the entry
#if SLOPE
  vec3 slope;
#endif
};

float node_at(vec3 entry, vec3 direction, float t) {
  precise vec3 p = fma(vec3(t), direction, entry);
  return node(field(p));
}

Sample sample_at(vec3 entry, vec3 direction, float t, inout Counts counts) {
  Sample s;
  s.t = t;
  s.node = node_at(entry, direction, t);
#if SLOPE
  s.slope = slope;
#endif
  counts.samples++;
  return s;
}

// Distance from the entry to sample i in mm.
float sample_mm(int i) {
#if PHASE
  precise float t = max(float(i) * job.rays.step_mm - lag, 0.0);
  return t;
#else
  return float(i) * job.rays.step_mm;
#endif
}

// The first sample of a ray; segments before it are known to be empty.
int first_sample() {
#if COHERENT
  return int(clamp(skip_mm * job.rays.inverse_step, 0.0, 1e9));
#else
  return 0;
#endif
}

#if SECOND_ORDER
// Second-order pre-integration: the linear field with the mean of the quadratic through three samples, and with ends
// within their range (source: segment_tmpl.h).
vec2 linearise(float front, float middle, float back) {
  precise float mean = fma((front - middle) + (back - middle), 1.0 / 6.0, middle); // Simpson's rule; exact for three equal samples
  float least = min(middle, min(front, back)), most = max(middle, max(front, back));
  precise float room = max(min(mean - least, most - mean), 0.0);
  precise float rise = clamp(0.5 * (back - front), -room, room);
  precise vec2 ends = vec2(mean - rise, mean + rise);
#if SUBTABLES // a segment that would skip the inner range of a subtable keeps its sampled ends (segment_tmpl.h)
  vec2 plain = vec2(front, back), gap = abs(ends - plain), low = min(ends, plain), high = max(ends, plain);
  for (int z = 0; z < job.table.z; z++) {
    vec4 subtable = job.subtables[z];
    float lo = subtable.x + subtable.w / subtable.y, hi = subtable.x + (float(job.table.w - 3) - subtable.w) / subtable.y;
    bvec2 wide = greaterThan(gap, vec2(hi - lo));
    if (wide.x && low.x < hi && high.x > lo || wide.y && low.y < hi && high.y > lo)
      return plain;
  }
#endif
  return ends;
}
#endif

// Colour and opacity of the segment between two samples; is_part: a shorter segment, with opacity correction.
vec4 segment_between(vec3 entry, vec3 direction, Sample front, Sample back, bool is_part, inout Counts counts) {
  precise float middle = 0.5 * (front.t + back.t);
  vec2 ends = vec2(front.node, back.node);
#if SECOND_ORDER
  ends = linearise(ends.x, node_at(entry, direction, middle), ends.y);
  counts.samples++;
#endif
  vec4 segment = classify(ends.x, ends.y, back.t - front.t, is_part);
#if LABELLED
  if (segment.a > 0.0) {
    precise vec3 p = fma(vec3(middle), direction, entry);
    segment = label_segment(segment, p);
  }
#endif
#if SHADED
  if (segment.a > 0.0) {
#if SLOPE
    segment = shade(segment, front.slope, back.slope, to_eye);
#else
    precise vec3 place = fma(vec3(middle), direction, entry);
    vec3 gradient = gradient_at(place);
    segment = shade(segment, gradient, gradient, to_eye);
#endif
    counts.gradients++;
  }
#endif
  return segment;
}
