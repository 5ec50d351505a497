// rays.h, perspective: direction in voxels per mm; the eye's place on the ray in mm from the anchor.
void set_ray(vec2 pixel, out vec3 anchor, out vec3 direction, out float eye) {
  anchor = job.anchor0.xyz + pixel.x * job.anchor_du.xyz + pixel.y * job.anchor_dv.xyz;
  vec3 view = job.view0.xyz + pixel.x * job.view_du.xyz + pixel.y * job.view_dv.xyz;
  float distance_mm = length(view);
  view /= distance_mm;
  direction = vec3(dot(job.to_index[0].xyz, view), dot(job.to_index[1].xyz, view), dot(job.to_index[2].xyz, view));
  eye = -distance_mm;
}
