// Orthographic rays (rays.h): one direction for all; the eye plane lies eye_mm before the anchors.
#if SHADED
vec3 to_eye; // unit, LPS
#endif

void set_ray(vec2 pixel, out vec3 anchor, out vec3 direction, out float eye) {
  anchor = fma(vec3(pixel.y), job.rays.anchor_dv.xyz, fma(vec3(pixel.x), job.rays.anchor_du.xyz, job.rays.anchor0.xyz));
  vec3 view = job.rays.view0.xyz;
#if SHADED
  to_eye = -view;
#endif
  direction = vec3(dot(job.rays.to_index[0].xyz, view), dot(job.rays.to_index[1].xyz, view), dot(job.rays.to_index[2].xyz, view));
  eye = -job.rays.eye_mm;
}
