// Central differences at the voxels around an index position (one-sided on a face), interpolated trilinearly.
vec3 rise_at(ivec3 at) {
  ivec3 low = max(at - 1, 0);
  ivec3 high = min(at + 1, job.dims.xyz - 1);
  precise vec3 rise = vec3(voxel_at(ivec3(high.x, at.yz)) - voxel_at(ivec3(low.x, at.yz)),
                           voxel_at(ivec3(at.x, high.y, at.z)) - voxel_at(ivec3(at.x, low.y, at.z)),
                           voxel_at(ivec3(at.xy, high.z)) - voxel_at(ivec3(at.xy, low.z)));
  return rise / max(vec3(high - low), 1.0);
}

vec3 gradient_at(vec3 p) {
  p = clamp(p, vec3(0.0), vec3(job.dims.xyz - 1));
  ivec3 cell = min(ivec3(p), max(job.dims.xyz - 2, 0));
  ivec3 next = min(cell + 1, job.dims.xyz - 1);
  vec3 f = p - vec3(cell);
  precise vec3 z[2];
  for (int k = 0; k < 2; k++) {
    int at = k == 0 ? cell.z : next.z;
    precise vec3 a = rise_at(ivec3(cell.xy, at)), b = rise_at(ivec3(cell.x, next.y, at));
    a += (rise_at(ivec3(next.x, cell.y, at)) - a) * f.x;
    b += (rise_at(ivec3(next.xy, at)) - b) * f.x;
    z[k] = a + (b - a) * f.y;
  }
  precise vec3 gradient = z[0] + (z[1] - z[0]) * f.z;
  return gradient;
}
