// PASS 2: the greatest depth of each block of pixels.
void main() {
  ivec2 block = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(block * BLOCK, tile.zw)))
    return;
  uint far = 0u;
  for (int y = block.y * BLOCK; y < min((block.y + 1) * BLOCK, tile.w); y++)
    for (int x = block.x * BLOCK; x < min((block.x + 1) * BLOCK, tile.z); x++)
      far = max(far, nearest[y * tile.z + x]);
  nearest[block_at(block.x, block.y)] = far;
}
