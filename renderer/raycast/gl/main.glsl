// The ray's stay in the index box, in mm from the anchor and not before the eye; empty when y <= x.
vec2 clip_to_box(vec3 anchor, vec3 direction, float eye) {
  vec2 span = vec2(eye, job.march.w);
  for (int k = 0; k < 3; k++) {
    float lo = job.box_lo[k] - anchor[k];
    float hi = job.box_hi[k] - anchor[k];
    if (abs(direction[k]) < 1e-12) { // along the faces: in between or never
      if (lo > 0.0 || hi < 0.0)
        span.y = -3.4e38;
    } else {
      float a = lo / direction[k];
      float b = hi / direction[k];
      span = vec2(max(span.x, min(a, b)), min(span.y, max(a, b)));
    }
  }
  return span;
}

void count(Counts of) {
  uint cell = (gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x) & 63u;
  atomicAdd(counters[cell].x, 1u);
  uint before = atomicAdd(counters[cell].y, of.samples);
  if (before + of.samples < before)
    atomicAdd(counters[cell].z, 1u);
#if LEAP
  atomicAdd(counters[cell].w, of.leaps);
#endif
}

void main() {
  ivec2 place = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(place, tile.zw)))
    return;
  vec3 anchor, direction;
  float eye;
  set_ray(vec2(tile.xy + place) + 0.5, anchor, direction, eye);
  vec2 span = clip_to_box(anchor, direction, eye);
#if CLIP
  span = clip_to_planes(anchor, direction, span);
#endif
  vec4 result = vec4(0.0);
  if (span.y > span.x) {
    Counts counts = Counts(0u, 0u);
    result = march(anchor, direction, span, counts);
    count(counts);
  }
  write_result(uint(place.y * tile.z + place.x), result);
}
