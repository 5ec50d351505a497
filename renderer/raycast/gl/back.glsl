// Back-to-front compositing: the samples and segments of dvr.glsl in reverse. There is no early ray termination,
// because the nearest segment comes last.

// The last sample before the ray's end; the loops correct the rounding of the estimate.
int last_sample(float length_mm) {
#if PHASE
  int i = int((length_mm + lag) * job.rays.inverse_step);
#else
  int i = int(length_mm * job.rays.inverse_step);
#endif
  while (i > 0 && sample_mm(i) >= length_mm)
    i--;
  while (sample_mm(i + 1) < length_mm)
    i++;
  return i;
}

// The over operator as sum + (segment - opacity * sum): thin segments of a long ray lose no more to rounding than in
// front-to-back order.
vec4 composite_over(vec4 segment, vec4 sum) {
  precise vec4 both = sum + fma(vec4(-segment.a), sum, segment);
  return both;
}

vec4 march(vec3 anchor, vec3 direction, vec2 span, inout Counts counts) {
  precise vec3 entry = fma(vec3(span.x), direction, anchor);
  float length_mm = span.y - span.x;
  int first = first_sample(), i = last_sample(length_mm);
  if (first > i)
    return vec4(0.0);
  Sample back = sample_at(entry, direction, length_mm, counts);
  Sample front = sample_at(entry, direction, sample_mm(i), counts);
  bool is_part = length_mm < sample_mm(i + 1) || PHASE == 1 && i == 0;
  vec4 sum = composite_over(segment_between(entry, direction, front, back, is_part, counts), vec4(0.0));
#if LEAP
  bool fresh = false; // after a leap there is no segment behind the next sample
  int next_look = i;    // the next step, downwards, at which to read the distance map
#endif
  while (--i >= first) {
    back = front;
    front = sample_at(entry, direction, sample_mm(i), counts);
    vec4 segment = segment_between(entry, direction, front, back, PHASE == 1 && i == 0, counts);
#if LEAP
    if (fresh)
      segment = vec4(0.0);
    fresh = false;
#endif
    sum = composite_over(segment, sum);
#if LEAP
    int steps;
    if (segment.a > 0.0 || i > next_look)
      continue;
    if (!is_empty_cube(fma(vec3(front.t), direction, entry), -direction, steps)) {
      next_look = i - steps - 1;
    } else if (steps > 1) { // the loop itself adds one
      i -= steps - 1;
      fresh = true;
      counts.leaps++;
    }
#endif
  }
  return sum / max(sum.a, 1.0);
}
