// A frame's constants of mode splat, opaque: splat_block of splat.c, same members, same order; and the buffers of a tile.
layout(std140, binding = 1) uniform Splat {
  vec4 axis[3];       // tc_splat_args (tile.h), whose names these are
  vec4 direction0, direction_du, direction_dv, right, down;
  vec4 planes[18];
  vec4 color;
  vec4 to_index[3];
  uvec4 weights[65];  // four a word
  vec2 size;          // pixels of the picture
  float scale, radius2, least2, near_mm, window_mm, core, core_root, full, open;
  int perspective, culling, n_planes, stride, opaque;
  float mass, most; // translucent: of a splat; the optical depth that one may add
  float move, touch;
  vec4 covariant[3];
} splat;

const int BLOCK = 8;
const float SCALE = 1048576.0; // of optical depths
const uint FAR = 0xff800000u; // ordered(infinite)
layout(std430, binding = 6) buffer Nearest { uint nearest[]; }; // [h][w] of the tile: ordered(depth), mm; then of each block the farthest
layout(std430, binding = 7) buffer Sums { int sums[]; };        // [h][w][stride]: weight; weight times normal, in 127ths; and, where voxels have colours, in 255ths

// Whole numbers that are in the order of the floats.
uint ordered(float z) {
  uint bits = floatBitsToUint(z);
  return (bits & 0x80000000u) != 0u ? ~bits : bits | 0x80000000u;
}
float depth_of(uint key) { return uintBitsToFloat((key & 0x80000000u) != 0u ? key & 0x7fffffffu : ~key); }

int blocks_across() { return (tile.z + BLOCK - 1) / BLOCK; }
uint block_at(int x, int y) { return uint(tile.z * tile.w + y * blocks_across() + x); }
