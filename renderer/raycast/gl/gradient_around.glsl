// Gradient "cell" of isosurfaces: differences between opposite faces of a cube two voxels wide, each face the mean of
// its corners.
vec3 gradient_at(vec3 p) {
  vec3 last = vec3(job.dims.xyz - 1), low = clamp(p - 1.0, vec3(0.0), last), high = clamp(p + 1.0, vec3(0.0), last);
  precise vec3 sum = vec3(0.0);
  for (int i = 0; i < 8; i++) {
    vec3 up = vec3(i & 1, i >> 1 & 1, i >> 2);
    sum += (2.0 * up - 1.0) * field(mix(low, high, up));
  }
  return 0.25 * sum / max(high - low, vec3(1e-20));
}
