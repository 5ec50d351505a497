// The full pre-integration table (classify.h): rows are differences, columns the smaller end; both read linearly.
layout(binding = 1) uniform samplerBuffer table;

float node(float voxel) {
  return clamp((voxel - job.nodes.x) * job.nodes.y, 0.0, job.nodes.z);
}

// (premultiplied colour, opacity) of a full segment between two nodes.
vec4 classify(float front, float back) {
  float row = abs(back - front);
  float column = min(front, back);
  int r = int(row);
  int c = int(column);
  int stride = back < front ? -job.table.x : job.table.x;
  int at = job.table.y + r * stride + c;
  vec4 low = mix(texelFetch(table, at), texelFetch(table, at + 1), column - float(c));
  at += stride;
  vec4 high = mix(texelFetch(table, at), texelFetch(table, at + 1), column - float(c));
  return mix(low, high, row - float(r));
}
