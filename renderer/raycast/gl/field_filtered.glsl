// Trilinear field by the texture unit: one fetch, but on GPUs with 8 bits of weight between two voxels.
layout(binding = 0) uniform sampler3D voxels; // normalised for integer voxels: job.unpack gives the voxel back

// Voxel value (not rescaled) at an index position; the texture's edge clamp serves what lies outside and flat axes.
float field(vec3 p) {
  return textureLod(voxels, (p + 0.5) * job.texel.xyz, 0.0).r * job.unpack.x + job.unpack.y;
}
