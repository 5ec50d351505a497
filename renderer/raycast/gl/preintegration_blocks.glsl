// Composites of whole blocks of intervals, for the diagonals that are longer than a block.
void main() {
  int k = 1 + int(gl_GlobalInvocationID.x), block = int(gl_GlobalInvocationID.y);
  if (k > axis.x || k < 2 * axis.w)
    return;
  Products all = nothing();
  for (int j = block * axis.w; j < (block + 1) * axis.w; j++)
    add_above(all, elementary(j, k));
  totals[block * axis.x + k - 1] = Both(all.up.sum, all.down.sum);
}
