// The derivative of the tricubic B-spline of the voxels, computed from differences to one voxel, so that a large common
// value costs no precision.
vec3 gradient_at(vec3 p) {
  p = clamp(p, vec3(0.0), vec3(job.dims.xyz - 1));
  ivec3 cell = min(ivec3(p), max(job.dims.xyz - 2, 0));
  vec3 f = p - vec3(cell);
  vec3 g = 1.0 - f;
  vec3 weight[4] = vec3[](g * g * g / 6.0, 2.0 / 3.0 - f * f * (1.0 - 0.5 * f), 2.0 / 3.0 - g * g * (1.0 - 0.5 * g),
                          f * f * f / 6.0);
  vec3 rise[4] = vec3[](-0.5 * g * g, f * (1.5 * f - 2.0), g * (2.0 - 1.5 * g), 0.5 * f * f);
  float base = voxel_at(cell);
  precise vec3 gradient = vec3(0.0);
  for (int z = 0; z < 4; z++)
    for (int y = 0; y < 4; y++)
      for (int x = 0; x < 4; x++) {
        float v = voxel_at(clamp(cell + ivec3(x, y, z) - 1, ivec3(0), job.dims.xyz - 1)) - base;
        gradient += v * vec3(rise[x].x * weight[y].y * weight[z].z, weight[x].x * rise[y].y * weight[z].z,
                             weight[x].x * weight[y].y * rise[z].z);
      }
  return gradient;
}
