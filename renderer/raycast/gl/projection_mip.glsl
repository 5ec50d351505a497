// MIP and MinIP: the maximum of the signed field along a ray, from samples one step apart, a sample at the ray's end,
// and peak refinement around the maximum (projection.h). With LEAP, empty-space skipping skips intervals that cannot
// raise the maximum. The interval with the highest level is sampled first, since a march would sample it anyway.
//
// Samples in a volume's gaps (LABELLED) are ignored.
//
// "precise" and fma() fix the rounding, so that all variants give the same bits: skipping changes nothing.
float best, at; // the greatest sample, and its position in mm; the first of several equal ones
#if LABELLED
bool met = false; // a sample was taken
#endif

float refine_peak(vec3 entry, vec3 direction, float length_mm) {
  float value = best, middle = at, offset = 0.5 * job.rays.step_mm;
  for (int round = 0; round < PEAK_ROUNDS; round++, offset *= 0.5) {
    float from = middle;
    for (int side = 0; side < 2; side++, offset = -offset) {
      float t = clamp(from - offset, 0.0, length_mm), w = sample_signed(entry, direction, t);
#if LABELLED
      if (!has_value(fma(vec3(t), direction, entry)))
        continue;
#endif
      if (w > value) {
        value = w;
        middle = t;
      }
    }
  }
  return value;
}

// The first of equal maxima counts, with and without skipping, because blocks that contain a sample equal to the
// maximum are never skipped (skip/bounds.h).
void take_sample(vec3 entry, vec3 direction, float t, inout Counts counts) {
  float w = sample_signed(entry, direction, t);
  counts.samples++;
#if LABELLED
  if (!has_value(fma(vec3(t), direction, entry)))
    return;
  met = true;
#endif
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
  // Short rays gain nothing from skipping. Steps longer than a block serve no interval.
  bool skips = job.blocks.w > 0;
  bool guess = skips && best < job.grey.stop && 4.0 * float(job.blocks.w) * job.rays.step_mm < length_mm;
  int first = guess ? highest_interval(entry, direction, length_mm) : 0;
  for (int i = first; guess && i < first + job.blocks.w; i++)
    take_sample(entry, direction, min(float(i) * job.rays.step_mm, length_mm), counts);
  int next_look = skips ? 0 : -1;
#endif
  for (int i = 0; best < job.grey.stop; i++) {
#if LEAP
    if (i == next_look) {
      next_look += job.blocks.w;
      if (level_of(entry, direction, i) <= (best - job.grey.low) * job.level_scale.x) {
        counts.leaps++;
        i = next_look - 1;
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
    best = refine_peak(entry, direction, length_mm);
    counts.samples += 2 * PEAK_ROUNDS;
  }
#if LABELLED
  if (!met)
    return vec4(0.0);
#endif
  return grey_of(min(best, job.grey.stop)); // a finished ray may exceed stop, which has the same grey
}
