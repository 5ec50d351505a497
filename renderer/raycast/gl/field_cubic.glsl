// Tricubic B-spline: a weighted mean of 4x4x4 voxels, grouped into eight trilinear interpolations (Sigg and Hadwiger,
// Fast third-order texture filtering, GPU Gems 2, 2005). All weights are positive, so values stay in the range of the
// voxels. Voxels beyond a face repeat the face's voxel.
float field(vec3 p) {
  p = clamp(p, vec3(0.0), vec3(job.dims.xyz - 1));
  ivec3 last = max(job.dims.xyz - 2, 0);
  ivec3 cell = min(ivec3(p), last);
  vec3 f = p - vec3(cell);
  vec3 g = 1.0 - f;
  precise vec3 w1 = 2.0 / 3.0 - f * f * (1.0 - 0.5 * f);
  precise vec3 w3 = f * f * f * (1.0 / 6.0);
  precise vec3 share = 2.0 / 3.0 - g * g * (1.0 - 0.5 * g) + w3;
  precise vec3 near = w1 / (1.0 - share);
  precise vec3 far = w3 / share;
  ivec3 low = max(cell - 1, 0); // the two cells along each axis; near and far are the positions in them
  ivec3 high = min(cell + 1, last);
  near = mix(near, vec3(0.0), lessThan(cell, ivec3(1))); // at a face, its voxel counts twice
  far = mix(far, vec3(greaterThan(job.dims.xyz, ivec3(1))), greaterThan(cell + 1, high));
  precise float z[2];
  for (int k = 0; k < 2; k++) {
    precise float y[2];
    int cz = k == 0 ? low.z : high.z;
    float fz = k == 0 ? near.z : far.z;
    for (int j = 0; j < 2; j++) {
      int cy = j == 0 ? low.y : high.y;
      float fy = j == 0 ? near.y : far.y;
      float a = interpolate(ivec3(low.x, cy, cz), vec3(near.x, fy, fz));
      float b = interpolate(ivec3(high.x, cy, cz), vec3(far.x, fy, fz));
      y[j] = a + (b - a) * share.x;
    }
    z[k] = y[0] + (y[1] - y[0]) * share.y;
  }
  precise float value = z[0] + (z[1] - z[0]) * share.z;
  return value;
}
