// The maximum of the turned field along a ray: samples a step apart, the ray's end, and what lies close to the greatest
// of them (grey.h). With LEAP whole intervals are left out in which the maximum cannot rise; it starts from the interval
// that promises most, some of the samples to come.
//
// "precise" and fma() fix the rounding, so that variants of this text give the same bits: skipping changes nothing.
float best, at; // the greatest sample, and where that is, mm: the first place of several

float climb(vec3 entry, vec3 direction, float length_mm) {
  float value = best, middle = at, away = 0.5 * job.rays.step_mm;
  for (int round = 0; round < PEAK_ROUNDS; round++, away *= 0.5) {
    float from = middle;
    for (int side = 0; side < 2; side++, away = -away) {
      float t = clamp(from - away, 0.0, length_mm), w = sample_turned(entry, direction, t);
      if (w > value) {
        value = w;
        middle = t;
      }
    }
  }
  return value;
}

// Blocks that hold an equal to the greatest sample are never left out (skip/bounds.h), and so the first one is the first
// with and without.
void take_sample(vec3 entry, vec3 direction, float t, inout Counts counts) {
  float w = sample_turned(entry, direction, t);
  counts.samples++;
  if (w > best || (w == best && t < at)) {
    best = w;
    at = t;
  }
}

vec4 march(vec3 anchor, vec3 direction, vec2 span, inout Counts counts) {
  precise vec3 entry = fma(vec3(span.x), direction, anchor);
  float length_mm = span.y - span.x;
  best = job.grey.low;
  at = -1.0;
#if LEAP
  take_sample(entry, direction, 0.0, counts);
  // A short ray has nothing to gain from a guess.
  bool guess = best < job.grey.stop && 4.0 * float(job.blocks.w) * job.rays.step_mm < length_mm;
  int first = guess ? highest_interval(entry, direction, length_mm) : 0;
  for (int i = first; guess && i < first + job.blocks.w; i++)
    take_sample(entry, direction, min(float(i) * job.rays.step_mm, length_mm), counts);
  int look_at = 0;
#endif
  for (int i = 0; best < job.grey.stop; i++) {
#if LEAP
    if (i == look_at) {
      look_at += job.blocks.w;
      if (level_of(entry, direction, i) <= (best - job.grey.low) * job.level_scale.x) {
        counts.leaps++;
        i = look_at - 1;
        if (float(i) * job.rays.step_mm >= length_mm)
          break;
        continue;
      }
    }
#endif
    float t = min(float(i) * job.rays.step_mm, length_mm);
    take_sample(entry, direction, t, counts);
    if (t >= length_mm)
      break;
  }
  if (best > job.grey.low && best < job.grey.stop) {
    best = climb(entry, direction, length_mm);
    counts.samples += 2 * PEAK_ROUNDS;
  }
  return grey_of(min(best, job.grey.stop)); // rounding beyond stop is not told from it
}
