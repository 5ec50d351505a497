// Trilinear field in full precision: slices are layers of a 2-D array in the voxels' own type, so that two gathers
// fetch a cell's eight corners and the interpolation is ours. Filtering by a GPU has 8-bit weights.
layout(binding = 0) uniform VOXELS voxels; // usampler2DArray, isampler2DArray or sampler2DArray

vec4 corners(ivec2 cell, int z) {
#if ATLAS // more slices than a texture has layers: several stand one below the other in each
  int layer = z / job.dims.w;
  cell.y += (z - layer * job.dims.w) * job.dims.y;
#else
  int layer = z;
#endif
  // The point where four texels meet: half a texel away from any doubt which four are meant.
  return vec4(textureGather(voxels, vec3(vec2(cell + 1) * job.texel.xy, float(layer))));
}

float voxel_at(ivec3 at) {
#if ATLAS
  int layer = at.z / job.dims.w;
  at = ivec3(at.x, at.y + (at.z - layer * job.dims.w) * job.dims.y, layer);
#endif
  return float(texelFetch(voxels, at, 0).r);
}

#if SLOPE
vec3 slope; // of the last interpolate(): its exact derivative over index coordinates, from the same corners
#endif

// Trilinear between a cell's corners. Along a flat axis (n = 1) f is 0, and what the gather finds beyond counts nothing.
float interpolate(ivec3 cell, vec3 f) {
  vec4 a = corners(cell.xy, cell.z); // a gather's order in (x, y): (0,1) (1,1) (1,0) (0,0)
  vec4 b = corners(cell.xy, cell.z + 1);
  // Neither mix() nor what a compiler may make of this: x * (1 - f) + y * f does not return x where both are x, and a
  // constant field must stay constant. Hence "precise".
  // All relative to the first corner, whose last bits would be lost three times otherwise.
  precise vec4 rise_z = b - a;
  precise vec4 c = (a - a.w) + rise_z * f.z;
  precise vec2 d = c.wx + (c.zy - c.wx) * f.x;
  precise float e = a.w + (d.x + (d.y - d.x) * f.y);
#if SLOPE
  precise vec2 rise_x = c.zy - c.wx;
  precise vec2 rise = rise_z.wx + (rise_z.zy - rise_z.wx) * f.x;
  slope = vec3(rise_x.x + (rise_x.y - rise_x.x) * f.y, d.y - d.x, rise.x + (rise.y - rise.x) * f.y);
#endif
  return e;
}
