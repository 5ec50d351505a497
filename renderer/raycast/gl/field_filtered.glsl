// Voxels by the texture unit: one fetch a cell, but on GPUs with 8 bits of weight between two voxels.
layout(binding = 0) uniform sampler3D voxels; // normalised for integer voxels: job.unpack gives the voxel back

float voxel_at(ivec3 at) {
  return texelFetch(voxels, at, 0).r * job.unpack.x + job.unpack.y;
}

// Trilinear between a cell's corners; the texture's edge clamp serves what lies outside and flat axes.
float interpolate(ivec3 cell, vec3 f) {
  return textureLod(voxels, (vec3(cell) + f + 0.5) * job.texel.xyz, 0.0).r * job.unpack.x + job.unpack.y;
}
