// The span of the ray inside the index box, in mm from the anchor, not before the eye; empty if y <= x.
vec2 clip_to_box(vec3 anchor, vec3 direction, float eye) {
  vec2 span = vec2(eye, job.rays.far_mm);
  for (int k = 0; k < 3; k++) {
    float lo = job.rays.lo[k] - anchor[k];
    float hi = job.rays.hi[k] - anchor[k];
    if (abs(direction[k]) < 1e-12) { // parallel to the faces: entirely inside or outside
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
  uint cell = 2u * ((gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x) & 63u);
  atomicAdd(counters[cell].x, 1u);
  uint before = atomicAdd(counters[cell].y, of.samples);
  if (before + of.samples < before)
    atomicAdd(counters[cell].z, 1u);
#if LEAP
  atomicAdd(counters[cell].w, of.leaps);
#endif
#if SHADED
  before = atomicAdd(counters[cell + 1u].x, of.gradients);
  if (before + of.gradients < before)
    atomicAdd(counters[cell + 1u].y, 1u);
#endif
}

#if DEPTH
layout(std430, binding = 3) writeonly buffer Depth { float depths[]; }; // [h][w] mm from the eye
float nearest; // depth of the pixel's nearest hit
#endif

#if WITHIN
layout(std430, binding = 4) readonly buffer Spans { vec2 spans[]; }; // [h][w] of the picture, mm from the eye
layout(location = 1) uniform int spans_width;
#endif

// The ray through a point of the picture, and its span; eye: mm from the anchor.
vec2 start_ray(vec2 at, out vec3 anchor, out vec3 direction, out float eye) {
  set_ray(at, anchor, direction, eye);
  vec2 span = clip_to_box(anchor, direction, eye);
#if CLIP
  span = clip_to_planes(anchor, direction, span);
#endif
  return span;
}

vec4 trace(ivec2 pixel, int ray) {
  vec3 anchor, direction;
  float eye;
  vec2 at = vec2(pixel) + 0.5;
#if SEVERAL
  at += job.rays.of_pixel[ray].xy;
#endif
  vec2 span = start_ray(at, anchor, direction, eye);
#if WITHIN
  vec2 part = spans[pixel.y * spans_width + pixel.x] + eye;
  span = vec2(max(span.x, part.x), min(span.y, part.y));
#endif
  if (span.y <= span.x)
    return vec4(0.0);
#if PHASE
  lag = lag_of(pixel, job.rays.of_pixel[ray].z);
#endif
#if COHERENT
  skip_mm = skip_of(direction, span);
#endif
  Counts counts = Counts(0u, 0u, 0u);
  vec4 result = march(anchor, direction, span, counts);
  count(counts);
#if DEPTH
  if (result.a > 0.0)
    nearest = min(nearest, span.x + hit_mm - eye);
#endif
  return result;
}

void main() {
  ivec2 place = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(place, tile.zw)))
    return;
  ivec2 pixel = tile.xy + place;
#if COHERENT
  vec3 anchor, direction;
  float eye;
  vec2 span = start_ray(vec2(pixel) + 0.5, anchor, direction, eye);
  clear_span = vec2(0.0, -1.0);
  if (span.y > span.x)
    find_clear_span(anchor, direction, span);
#endif
#if DEPTH
  nearest = uintBitsToFloat(0x7f800000u); // infinite
#endif
#if SEVERAL
  precise vec4 result = vec4(0.0);
  for (int ray = 0; ray < job.rays.count; ray++)
    result += trace(pixel, ray);
  result /= float(job.rays.count);
#else
  vec4 result = trace(pixel, 0);
#endif
  uint at = uint(place.y * tile.z + place.x);
  write_result(at, result);
#if DEPTH
  depths[at] = nearest;
#endif
}
