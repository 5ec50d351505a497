// The maximum of the turned field along a ray: samples a step apart, and the ray's end. With LEAP whole intervals are left
// out in which the maximum cannot rise; it starts from the interval that promises most, some of the samples to come.
//
// "precise" and fma() fix the rounding, so that variants of this text give the same bits: skipping changes nothing.
vec4 march(vec3 anchor, vec3 direction, vec2 span, inout Counts counts) {
  precise vec3 entry = fma(vec3(span.x), direction, anchor);
  float length_mm = span.y - span.x;
  float best = job.reach.x;
#if LEAP
  best = max(best, sample_turned(entry, direction, 0.0));
  counts.samples++;
  // A short ray has nothing to gain from a guess.
  bool guess = best < job.reach.y && 4.0 * float(job.blocks.w) * job.march.x < length_mm;
  int first = guess ? highest_interval(entry, direction, length_mm) : 0;
  for (int i = first; guess && i < first + job.blocks.w; i++) {
    best = max(best, sample_turned(entry, direction, min(float(i) * job.march.x, length_mm)));
    counts.samples++;
  }
  int look_at = 0;
#endif
  for (int i = 0; best < job.reach.y; i++) {
#if LEAP
    if (i == look_at) {
      look_at += job.blocks.w;
      if (level_of(entry, direction, i) <= (best - job.reach.x) * job.reach.z) {
        counts.leaps++;
        i = look_at - 1;
        if (float(i) * job.march.x >= length_mm)
          break;
        continue;
      }
    }
#endif
    float t = min(float(i) * job.march.x, length_mm);
    best = max(best, sample_turned(entry, direction, t));
    counts.samples++;
    if (t >= length_mm)
      break;
  }
  return grey_of(min(best, job.reach.y)); // rounding beyond stop is not told from it
}
