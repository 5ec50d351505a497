// Front-to-back compositing with early ray termination and empty-space skipping. Returns premultiplied colour and
// opacity.

vec4 march(vec3 anchor, vec3 direction, vec2 span, inout Counts counts) {
  precise vec3 entry = fma(vec3(span.x), direction, anchor);
  float length_mm = span.y - span.x;
  precise vec4 sum = vec4(0.0);
  precise float clear = 1.0;
  int first = first_sample();
#if COHERENT
  if (sample_mm(first) >= length_mm)
    return vec4(0.0);
#endif
  Sample front = sample_at(entry, direction, sample_mm(first), counts);
#if LEAP
  bool fresh = false; // after a leap there is no segment in front of the next sample
  int next_look = 0;    // the next step at which to read the distance map
#endif
  for (int i = first + 1;; i++) {
    float t = sample_mm(i);
    if (t > length_mm)
      break;
    Sample back = sample_at(entry, direction, t, counts);
    vec4 segment = segment_between(entry, direction, front, back, PHASE == 1 && i == 1, counts);
#if LEAP
    if (fresh)
      segment = vec4(0.0);
    fresh = false;
#endif
    sum = fma(vec4(clear), segment, sum);
    clear = fma(-clear, segment.a, clear);
    front = back;
#if TERMINATION
    if (clear < job.background.w)
      return finish(sum, clear);
#endif
#if LEAP
    int steps;
    if (segment.a > 0.0 || i < next_look)
      continue;
    if (!is_empty_cube(fma(vec3(t), direction, entry), direction, steps)) {
      next_look = i + steps + 1;
    } else if (steps > 1) { // the loop itself adds one
      i += steps - 1;
      fresh = true;
      counts.leaps++;
    }
#endif
  }
#if LEAP
  if (fresh) // the leap left the volume
    return finish(sum, clear);
#endif
  // The last segment is shorter. It is classified after the loop, because software rasterisers execute both sides of a branch.
  if (front.t < length_mm) {
    Sample back = sample_at(entry, direction, length_mm, counts);
    vec4 segment = segment_between(entry, direction, front, back, true, counts);
    sum = fma(vec4(clear), segment, sum);
    clear = fma(-clear, segment.a, clear);
  }
  return finish(sum, clear);
}
