// Space leaping (skip/skip.h): per block, the Chebyshev distance in blocks to the nearest that holds something.
layout(binding = 2) uniform usamplerBuffer distances;

// How many whole steps a ray at index position p stays in the cube of blocks known of its place. True: that cube is
// empty and may be leapt; false: the block holds something, and looking again is of no use for that many steps.
// The margin of a hundredth of a voxel is far above the rounding of positions.
bool look_around(vec3 p, vec3 direction, out int steps) {
  p = clamp(p, vec3(0.0), vec3(job.dims.xyz - 1));
  float size = float(job.blocks.x);
  // The half keeps rounding away from the blocks' edges.
  ivec3 block = ivec3((floor(min(p, max(vec3(job.dims.xyz - 2), 0.0))) + 0.5) / size);
  float distance = float(texelFetch(distances, block.x + block.y * job.blocks.y + block.z * job.blocks.z).r);
  float reach = max(distance - 1.0, 0.0) * size;
  vec3 corner = vec3(block) * size;
  float far = 1e9;
  for (int k = 0; k < 3; k++) {
    float wall = direction[k] > 0.0 ? corner[k] + reach + (size - 0.01) : corner[k] - reach + 0.01;
    if (abs(direction[k]) >= 1e-12)
      far = min(far, (wall - p[k]) / direction[k]);
  }
  steps = int(clamp(far * job.rays.inverse_step, 0.0, 1e6));
  return distance > 0.5;
}
