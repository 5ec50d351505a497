// Empty-space skipping by the distance map (skip/distance_map.h): for each block, the Chebyshev distance to the nearest
// occupied block.
layout(binding = 2) uniform usamplerBuffer distances;

// steps: number of whole steps that a ray at index position p stays in the cube of blocks that the distance map
// describes. True: the cube is empty and may be skipped. False: the block is occupied, and the map need not be read
// again for that many steps. The margin of a hundredth of a voxel is far above the rounding of positions.
bool is_empty_cube(vec3 p, vec3 direction, out int steps) {
  p = clamp(p, vec3(0.0), vec3(job.dims.xyz - 1));
  float size = float(job.blocks.x);
  // + 0.5 keeps rounding away from the edges of blocks.
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
