// Front-to-back compositing of pre-integrated segments. Returns premultiplied colour and opacity.
//
// "precise" and fma() fix the rounding, so that variants of this text give the same bits: a leap changes nothing.

float sample_node(vec3 entry, vec3 direction, float t) {
  precise vec3 p = fma(vec3(t), direction, entry);
  return node(field(p));
}

// Thin segments take nothing from a transparency of 1 in single precision, so that opacity has a sum of its own. What
// lies behind a terminated ray is taken to look like what lies before: an opaque region keeps its colour exactly.
vec4 finish(vec4 sum, float clear) {
  bool full = sum.a > 1.0;
#if TERMINATION
  full = full || clear < job.background.w;
#endif
  return full ? sum / sum.a : sum;
}

// The same medium over a share of a segment: the full one's transparency to the power of it, and colour as opacity.
vec4 shorten(vec4 segment, float share) {
  float opacity = 1.0 - exp2(share * log2(max(1.0 - segment.a, 1e-30)));
  return (segment.a < 1e-4 ? share : opacity / segment.a) * segment;
}

// Mm from the entry to sample i.
float sample_mm(int i) {
#if PHASE
  precise float t = max(float(i) * job.march.x - lag, 0.0);
  return t;
#else
  return float(i) * job.march.x;
#endif
}

vec4 march(vec3 anchor, vec3 direction, vec2 span, inout Counts counts) {
  precise vec3 entry = fma(vec3(span.x), direction, anchor);
  float length_mm = span.y - span.x;
  float step_mm = job.march.x;
  precise vec4 sum = vec4(0.0);
  precise float clear = 1.0;
  int first = 0; // sample at which the ray begins
#if COHERENT
  if (head >= length_mm)
    return vec4(0.0);
  first = int(clamp(head * job.march.z, 0.0, 1e6));
#endif
  float before = sample_mm(first); // where front was sampled, mm
  float front = sample_node(entry, direction, before);
#if SHADED
  vec3 front_slope = slope;
#endif
  counts.samples++;
#if LEAP
  bool fresh = false; // after a leap there is no segment in front of the next sample
  int look_at = 0;    // first step at which looking around may pay
#endif
  for (int i = first + 1;; i++) {
    float t = sample_mm(i);
    if (t > length_mm)
      break;
    float back = sample_node(entry, direction, t);
    counts.samples++;
    vec4 segment = classify(front, back);
#if PHASE
    if (i == 1)
      segment = shorten(segment, t / step_mm);
#endif
#if LABELLED
    if (segment.a > 0.0) {
      precise vec3 middle = fma(vec3(0.5 * (sample_mm(i - 1) + t)), direction, entry);
      segment = label_segment(segment, middle);
    }
#endif
#if SHADED
    if (segment.a > 0.0)
      segment = shade(segment, front_slope, slope, to_eye);
    front_slope = slope;
#endif
#if LEAP
    if (fresh)
      segment = vec4(0.0);
    fresh = false;
#endif
    sum = fma(vec4(clear), segment, sum);
    clear = fma(-clear, segment.a, clear);
    front = back;
    before = t;
#if TERMINATION
    if (clear < job.background.w)
      return finish(sum, clear);
#endif
#if LEAP
    int steps;
    if (segment.a > 0.0 || i < look_at)
      continue;
    if (!look_around(fma(vec3(t), direction, entry), direction, steps)) {
      look_at = i + steps + 1;
    } else if (steps > 1) { // the loop goes on by one itself
      i += steps - 1;
      fresh = true;
      counts.leaps++;
    }
#endif
  }
#if LEAP
  if (fresh) // the leap led out
    return finish(sum, clear);
#endif
  // The last segment is shorter. It stands behind the loop because software rasterisers pay for both sides of a branch.
  float share = (length_mm - before) / step_mm;
  if (share > 0.0) {
    vec4 segment = classify(front, sample_node(entry, direction, length_mm));
    counts.samples++;
#if LABELLED
    segment = label_segment(segment, fma(vec3(0.5 * (before + length_mm)), direction, entry));
#endif
#if SHADED
    segment = shade(segment, front_slope, slope, to_eye);
#endif
    segment = shorten(segment, share);
    sum = fma(vec4(clear), segment, sum);
    clear = fma(-clear, segment.a, clear);
  }
  return finish(sum, clear);
}
