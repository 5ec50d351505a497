// Mode splat: constants of a frame (splat_block of splat.c, the same members in the same order) and the buffers of a tile.
layout(std140, binding = 1) uniform Splat {
  vec4 axis[3];       // names as in tc_splat_args (tile.h)
  vec4 direction0, direction_du, direction_dv, right, down;
  vec4 planes[18];
  vec4 color;
  vec4 to_index[3];
  uvec4 weights[65];  // four to a word
  vec2 size;          // pixels of the picture
  float scale, radius2, pixel_radius2, near_mm, window_mm, core2, core_share, full_weight, coreless_scale;
  int perspective, culling, n_planes, stride, opaque;
  float mass, most; // translucent; most: largest optical depth of a splat at a pixel
  float shape_blend, core_radius;
  vec4 covariant[3];
} splat;

const int BLOCK = 8;
const float SCALE = 1048576.0; // of optical depths
const uint FAR = 0xff800000u; // ordered(infinite)
layout(std430, binding = 6) buffer Nearest { uint nearest[]; }; // [h][w] of the tile: ordered(depth in mm); then the greatest of each block
layout(std430, binding = 7) buffer Sums { int sums[]; };        // [h][w][stride]: weight; weight times normal in 127ths; with voxel colours also weight times colour in 255ths

// Integers in the same order as the floats.
uint ordered(float z) {
  uint bits = floatBitsToUint(z);
  return (bits & 0x80000000u) != 0u ? ~bits : bits | 0x80000000u;
}
float depth_of(uint key) { return uintBitsToFloat((key & 0x80000000u) != 0u ? key & 0x7fffffffu : ~key); }

int blocks_across() { return (tile.z + BLOCK - 1) / BLOCK; }
uint block_at(int x, int y) { return uint(tile.z * tile.w + y * blocks_across() + x); }
