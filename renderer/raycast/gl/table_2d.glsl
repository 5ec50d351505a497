// The full pre-integration table (classify.h): rows are differences, columns the smaller end; both read linearly.
layout(binding = 1) uniform samplerBuffer table;

// (premultiplied colour, opacity) of a full segment between two nodes.
vec4 look_up(float front, float back) {
  int start = job.table.y;
  int columns = job.table.x;
#if ZOOMED // in the finest window that holds both ends
  vec2 ends = vec2(front, back);
  for (int z = 0; z < job.table.z; z++) {
    vec2 at = (ends - job.zooms[z].x) * job.zooms[z].y;
    if (min(at.x, at.y) >= 0.0 && max(at.x, at.y) <= float(job.table.w - 3)) {
      front = at.x;
      back = at.y;
      start = int(job.zooms[z].z);
      columns = job.table.w;
    }
  }
#endif
  float row = abs(back - front);
  float column = min(front, back);
  int r = int(row);
  int c = int(column);
  int stride = back < front ? -columns : columns;
  int at = start + r * stride + c;
  // "precise": rewritten as a mix() this would take the last bit off an opacity of 1.
  vec4 a = texelFetch(table, at), b = texelFetch(table, at + 1);
  precise vec4 near = a + (b - a) * (column - float(c));
  at += stride;
  a = texelFetch(table, at);
  b = texelFetch(table, at + 1);
  precise vec4 far = a + (b - a) * (column - float(c));
  precise vec4 segment = near + (far - near) * (row - float(r));
  return segment;
}

vec4 classify(float front, float back, float length_mm, bool is_part) {
  vec4 segment = look_up(front, back);
  return is_part ? shorten(segment, length_mm / job.march.x) : segment;
}
