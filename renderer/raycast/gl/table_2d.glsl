// The full pre-integration table (classify.h): rows are differences, columns the smaller end; both read linearly.
layout(binding = 1) uniform samplerBuffer table;

#if ZOOMED // to the finest window that holds both ends
void enter_window(inout float front, inout float back, inout int start, inout int columns) {
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
}
#endif

// (premultiplied colour, opacity) of a full segment between two nodes.
vec4 look_up(float front, float back) {
  int start = job.table.y;
  int columns = job.table.x;
#if ZOOMED
  enter_window(front, back, start, columns);
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

#if STIFF
// The depth of a whole segment, from the row of depths; nothing cancels in it.
float depth_between(float front, float back) {
  int start = job.table.y, columns = job.table.x, n = int(job.nodes.z) + 1;
#if ZOOMED
  enter_window(front, back, start, columns);
  n = start == job.table.y ? n : columns - 2;
#endif
  float low = min(front, back), high = max(front, back);
  int i = int(low), j = int(high), row = start + (n + 2) * columns;
  float x = low - float(i), y = high - float(j);
  vec4 first = texelFetch(table, row + i), next = texelFetch(table, row + i + 1), last = texelFetch(table, row + j);
  if (i == j)
    return first.z + 0.5 * (x + y) * (first.w - first.z);
  float rest = 0.5 * (1.0 - x) * (first.z + x * (first.w - first.z) + first.w);
  float part = 0.5 * y * (last.z + y * (last.w - last.z) + last.z);
  precise float whole = (last.x - next.x) + (last.y - next.y);
  return (rest + part + whole) / (high - low);
}

// 1/2 - 1/x + 1/(exp(x) - 1), and what it serves: stiff_tmpl.h has the words.
float nearer(float x) {
  float clear = 1.0 - opacity_of_depth(x);
  return x < 0.5 ? x * (1.0 / 12.0 - x * x / 720.0) : 0.5 - 1.0 / x + clear / (1.0 - clear);
}

vec4 shorten_stiff(float front, float back, vec4 segment, float share) {
  if (segment.a <= 0.0)
    return segment;
  vec4 reverse = look_up(back, front);
  float depth = depth_between(front, back), opacity = opacity_of_depth(share * depth);
  float along = 0.5 * min(nearer(share * depth) / max(nearer(depth), 1e-30), 1.0);
  vec3 color = (0.5 + along) / segment.a * segment.rgb + (0.5 - along) / max(reverse.a, 1e-30) * reverse.rgb;
  return vec4(opacity * color, opacity);
}
#endif

vec4 classify(float front, float back, float length_mm, bool is_part) {
  vec4 segment = look_up(front, back);
#if STIFF
  return is_part ? shorten_stiff(front, back, segment, length_mm / job.march.x) : segment;
#else
  return is_part ? shorten(segment, length_mm / job.march.x) : segment;
#endif
}
