// The trilinear field in full precision. Slices are layers of a 2-D array texture in the voxels' own type: two gathers
// fetch a cell's eight corners, and the shader interpolates, because texture filtering of GPUs has only 8-bit weights.
layout(binding = 0) uniform VOXELS voxels; // usampler2DArray, isampler2DArray or sampler2DArray

vec4 corners(ivec2 cell, int z) {
#if ATLAS // more slices than texture layers: each layer holds several, one below the other
  int layer = z / job.dims.w;
  cell.y += (z - layer * job.dims.w) * job.dims.y;
#else
  int layer = z;
#endif
  // The common corner of the four texels, which leaves half a texel of tolerance for the choice of the gathered four.
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
vec3 slope; // set by interpolate(): the exact derivative over index coordinates
#endif

// Trilinear interpolation of a cell's corners. Along a flat axis (n = 1) f is 0, so that texels beyond it have no
// weight.
float interpolate(ivec3 cell, vec3 f) {
  vec4 a = corners(cell.xy, cell.z); // textureGather's order in (x, y): (0,1) (1,1) (1,0) (0,0)
  vec4 b = corners(cell.xy, cell.z + 1);
  // A constant field must stay constant: "precise" keeps the compiler from rewriting this as x * (1 - f) + y * f, which
  // mix() allows. Differences to the first corner, whose last bits would otherwise be lost three times.
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
