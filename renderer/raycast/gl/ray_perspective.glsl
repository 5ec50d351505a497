// Perspective rays (rays.h): direction in voxels per mm; eye: position of the eye on the ray in mm from the anchor.
#if SHADED
vec3 to_eye; // unit, LPS
#endif

void set_ray(vec2 pixel, out vec3 anchor, out vec3 direction, out float eye) {
  anchor = fma(vec3(pixel.y), job.rays.anchor_dv.xyz, fma(vec3(pixel.x), job.rays.anchor_du.xyz, job.rays.anchor0.xyz));
  vec3 view = fma(vec3(pixel.y), job.rays.view_dv.xyz, fma(vec3(pixel.x), job.rays.view_du.xyz, job.rays.view0.xyz));
  float distance_mm = length(view);
  view /= distance_mm;
#if SHADED
  to_eye = -view;
#endif
  direction = vec3(dot(job.rays.to_index[0].xyz, view), dot(job.rays.to_index[1].xyz, view), dot(job.rays.to_index[2].xyz, view));
  eye = -distance_mm;
}
