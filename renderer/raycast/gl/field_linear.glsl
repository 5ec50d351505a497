// The voxel value (not rescaled) at an index position, clamped to the volume.
float field(vec3 p) {
  p = clamp(p, vec3(0.0), vec3(job.dims.xyz - 1));
  ivec3 cell = min(ivec3(p), max(job.dims.xyz - 2, 0));
  return interpolate(cell, p - vec3(cell));
}
