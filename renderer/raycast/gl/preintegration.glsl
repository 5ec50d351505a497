// Look-up in the full pre-integration table (preintegration.h), bilinear: the row is the difference of the segment's
// ends in nodes, the column the smaller end.
layout(binding = 1) uniform samplerBuffer table;

// A segment's ends in nodes of a window; start of the window's row k = 0, entries per row, and its row of depths.
struct Window {
  float front, back;
  int start, columns, depths;
};

// The finest window that contains both ends; cut: a finer one has just one of them, near its knots.
Window enter_window(float front, float back, out bool cut) {
  Window w = Window(front, back, job.table.y, job.table.x, int(job.nodes.z) + 3);
  cut = false;
#if SUBTABLES
  vec2 ends = vec2(front, back);
  for (int z = 0; z < job.table.z; z++) {
    vec2 at = (ends - job.subtables[z].x) * job.subtables[z].y;
    float last = float(job.table.w - 3), rim = job.subtables[z].w;
    bvec2 inside = equal(at, clamp(at, 0.0, last)), close = equal(at, clamp(at, rim, last - rim));
    cut = cut || any(close) && inside.x != inside.y;
    if (all(inside))
      w = Window(at.x, at.y, int(job.subtables[z].z), job.table.w, job.table.w);
  }
#endif
  return w;
}

// Premultiplied colour and opacity of a full segment.
vec4 look_up(Window w) {
  float row = abs(w.back - w.front);
  float column = min(w.front, w.back);
  int r = int(row);
  int c = int(column);
  int stride = w.back < w.front ? -w.columns : w.columns;
  int at = w.start + r * stride + c;
  // "precise": a compiler's mix() would lose the last bit of an opacity of 1.
  vec4 a = texelFetch(table, at), b = texelFetch(table, at + 1);
  precise vec4 near = a + (b - a) * (column - float(c));
  at += stride;
  a = texelFetch(table, at);
  b = texelFetch(table, at + 1);
  precise vec4 far = a + (b - a) * (column - float(c));
  precise vec4 segment = near + (far - near) * (row - float(r));
  return segment;
}

#if STIFF || SUBTABLES
// Optical depth of a full segment from the row of depths, without cancellation.
float depth_in(Window w) {
  float low = min(w.front, w.back), high = max(w.front, w.back);
  int i = int(low), j = int(high), row = w.start + w.depths * w.columns;
  float x = low - float(i), y = high - float(j);
  vec4 first = texelFetch(table, row + i), next = texelFetch(table, row + i + 1), last = texelFetch(table, row + j);
  if (i == j)
    return first.z + 0.5 * (x + y) * (first.w - first.z);
  float rest = 0.5 * (1.0 - x) * (first.z + x * (first.w - first.z) + first.w);
  float part = 0.5 * y * (last.z + y * (last.w - last.z) + last.z);
  precise float whole = (last.x - next.x) + (last.y - next.y);
  return (rest + part + whole) / (high - low);
}

// Cuts segments at the edges of subtables that contain one end (subtable_tmpl.h explains it).
float depth_between(float front, float back) {
  float parts = 0.0, rest = 1.0;
#if SUBTABLES
  float span = max(abs(back - front), 1e-30);
  for (int z = job.table.z - 1; z >= 0; z--) {
    vec4 subtable = job.subtables[z];
    vec2 at = (vec2(front, back) - subtable.x) * subtable.y, held = clamp(at, 0.0, float(job.table.w - 3));
    bvec2 inside = equal(at, held);
    if (inside.x == inside.y)
      continue;
    float edge = (inside.x ? held.y : held.x) / subtable.y + subtable.x, length_nodes = abs(edge - (inside.x ? front : back));
    parts += min(length_nodes / span, 1.0) * depth_in(Window(held.x, held.y, int(subtable.z), job.table.w, job.table.w));
    if (inside.x)
      front = edge;
    else
      back = edge;
  }
  if (parts > 0.0)
    rest = abs(back - front) / span;
#endif
  bool cut;
  return parts + rest * depth_in(enter_window(front, back, cut));
}
#endif

vec4 classify_full(float front, float back) {
  bool cut;
  vec4 segment = look_up(enter_window(front, back, cut));
#if SUBTABLES
  if (cut && segment.a > 0.0) {
    float opacity = opacity_of_depth(depth_between(front, back));
    return vec4(opacity / segment.a * segment.rgb, opacity);
  }
#endif
  return segment;
}

#if STIFF
// 1/2 - 1/x + 1/(exp(x) - 1): front_excess() of opacity_correction_tmpl.h.
float nearer(float x) {
  float clear = 1.0 - opacity_of_depth(x);
  return x < 0.5 ? x * (1.0 / 12.0 - x * x / 720.0) : 0.5 - 1.0 / x + clear / (1.0 - clear);
}

vec4 shorten_stiff(float front, float back, vec4 segment, float share) {
  if (segment.a <= 0.0)
    return segment;
  vec4 reverse = classify_full(back, front);
  float depth = depth_between(front, back), opacity = opacity_of_depth(share * depth);
  float along = 0.5 * min(nearer(share * depth) / max(nearer(depth), 1e-30), 1.0);
  vec3 color = (0.5 + along) / segment.a * segment.rgb + (0.5 - along) / max(reverse.a, 1e-30) * reverse.rgb;
  return vec4(opacity * color, opacity);
}
#endif

vec4 classify(float front, float back, float length_mm, bool is_part) {
  vec4 segment = classify_full(front, back);
#if STIFF
  return is_part ? shorten_stiff(front, back, segment, length_mm / job.rays.step_mm) : segment;
#else
  return is_part ? shorten(segment, length_mm / job.rays.step_mm) : segment;
#endif
}
