// Narrows a ray's span to the inside of all clip planes. A ray parallel to a plane is entirely inside or outside.
vec2 clip_to_planes(vec3 anchor, vec3 direction, vec2 span) {
  for (int i = 0; i < job.rays.n_planes; i++) {
    float at = fma(job.rays.planes[i].z, anchor.z, fma(job.rays.planes[i].y, anchor.y, fma(job.rays.planes[i].x, anchor.x, job.rays.planes[i].w)));
    float rate = dot(job.rays.planes[i].xyz, direction);
    if (abs(rate) < 1e-9) {
      if (at < 0.0)
        span.y = -3.4e38;
    } else if (rate > 0.0) {
      span.x = max(span.x, -at / rate);
    } else {
      span.y = min(span.y, -at / rate);
    }
  }
  return span;
}
