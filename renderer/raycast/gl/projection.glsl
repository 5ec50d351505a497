// Projections: the signed voxel w along the ray, and from w to grey (raycast/projection.h).

float sample_signed(vec3 entry, vec3 direction, float t) {
  precise vec3 p = fma(vec3(t), direction, entry);
  precise float w = field(p) * job.grey.sign;
  return w;
}

vec4 grey_of(float w) {
  return vec4(vec3(decode(clamp(fma(w, job.grey.gain, job.grey.offset), 0.0, 1.0))), 1.0);
}
