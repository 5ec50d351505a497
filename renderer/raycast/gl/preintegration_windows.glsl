// Entries of a diagonal: sliding windows of k intervals, as products without subtraction, hence without cancellation. A
// window consists of the end of its first block, whole blocks, and the beginning of its last. With blocks of about the
// square root of the table's side, the number of compositions per entry is bounded (builder.h).
layout(rgba32f, binding = 0) uniform imageBuffer table;

// Colour and opacity round separately: clamps colour to opacity times peak, and both to their bounds.
vec4 held(vec4 entry) {
  entry = clamp(entry, vec4(0.0), peak);
  return min(entry, entry.a * peak);
}

// Windows `start` to `start + count - 1` of k intervals, count <= block <= k.
void slide(int k, int start, int block, int count) {
  int up = axis.z + k * axis.y, down = axis.z - k * axis.y;
  Products rest = nothing(), middle = nothing();
  for (int j = block - 1; j >= 0; j--) { // suffixes of the first block, stored where the entries go
    add_below(rest, elementary(start + j, k));
    if (j < count) {
      imageStore(table, up + start + j, rest.up.sum);
      imageStore(table, down + start + j, rest.down.sum);
    }
  }
  int j = start + block;
  for (; j + block <= start + k; j += block)
    add_above(middle, totals[j / block * axis.x + k - 1]);
  for (; j < start + k; j++)
    add_above(middle, elementary(j, k));
  for (int i = start; i < start + count; i++) {
    if (i > start)
      add_above(middle, elementary(i + k - 1, k));
    Both first = Both(imageLoad(table, up + i), imageLoad(table, down + i));
    Both entry = join(first, Both(middle.up.sum, middle.down.sum));
    imageStore(table, up + i, held(entry.up));
    imageStore(table, down + i, held(entry.down));
  }
}

void main() {
  int k = 1 + int(gl_GlobalInvocationID.x), from = int(gl_GlobalInvocationID.y) * axis.w;
  if (k > axis.x)
    return;
  int end = min(from + axis.w, axis.x - k + 1), block = min(k, axis.w);
  for (int start = from; start < end; start += block)
    slide(k, start, block, min(block, end - start));
}
