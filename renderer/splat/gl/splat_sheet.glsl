// Translucent. PASS 5: composites the current sheet behind the earlier ones and clears it. A pixel has eight numbers: the sheet's
// optical depth and colours, in units of 1 / SCALE; and colours and opacity of all sheets, as bits of floats.
void main() {
  ivec2 p = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(p, tile.zw)))
    return;
  int at = (p.y * tile.z + p.x) * splat.stride;
  if (sums[at] == 0)
    return;
  float depth = float(uint(sums[at])) / SCALE, before = 1.0 - intBitsToFloat(sums[at + 7]);
  bool thin = depth <= 1e-3; // (1 - clear) / depth has the limit 1
  float clear = thin ? 1.0 - depth + 0.5 * depth * depth : exp(-depth);
  float share = before * (thin ? 1.0 - 0.5 * depth : (1.0 - clear) / depth);
  for (int k = 0; k < 3; k++)
    sums[at + 4 + k] = floatBitsToInt(intBitsToFloat(sums[at + 4 + k]) + share * float(uint(sums[at + 1 + k])) / SCALE);
  sums[at + 7] = floatBitsToInt(1.0 - before * clear);
  for (int k = 0; k < 4; k++)
    sums[at + k] = 0;
}
