// Empty-space skipping for MIP and MinIP (skip/bounds.h): one level per block, an upper bound of the field around it.
layout(binding = 2) uniform usamplerBuffer levels;

// The level of the interval of samples that begins at i: the level of the block at its middle. The place of the sample
// before it counts too, because a ray's end lies between two steps.
float level_of(vec3 entry, vec3 direction, int i) {
  float t = (float(i) - 1.0 + 0.5 * float(job.blocks.w)) * job.rays.step_mm;
  vec3 p = clamp(fma(vec3(t), direction, entry), vec3(0.0), vec3(job.dims.xyz - 1));
  // + 0.5 keeps rounding away from the edges of blocks.
  ivec3 block = ivec3((floor(min(p, max(vec3(job.dims.xyz - 2), 0.0))) + 0.5) / float(job.blocks.x));
  return float(texelFetch(levels, block.x + block.y * job.blocks.y + block.z * job.blocks.z).r);
}

// The first sample of the interval with the highest level.
int highest_interval(vec3 entry, vec3 direction, float length_mm) {
  float highest = -1.0;
  int at = 0;
  for (int i = 0; float(i) * job.rays.step_mm < length_mm; i += job.blocks.w) {
    float level = level_of(entry, direction, i);
    if (level > highest) {
      highest = level;
      at = i;
    }
  }
  return at;
}
