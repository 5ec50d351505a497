// The voxel nearest to an index position; 0.001: NEAREST_UP of cpu/filter_tmpl.h.
float field(vec3 p) {
  p = clamp(p, vec3(0.0), vec3(job.dims.xyz - 1));
#if SLOPE
  ivec3 cell = min(ivec3(p), max(job.dims.xyz - 2, 0));
  interpolate(cell, p - vec3(cell)); // only for its slope
#endif
  precise vec3 up = p + (0.5 + 0.001);
  return voxel_at(ivec3(up));
}
