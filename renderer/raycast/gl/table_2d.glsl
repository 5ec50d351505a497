// The full pre-integration table (classify.h): rows are differences, columns the smaller end; both read linearly.
layout(binding = 1) uniform samplerBuffer table;

float node(float voxel) {
  float at = (voxel - job.nodes.x) * job.nodes.y;
  return at > 0.0 ? min(at, job.nodes.z) : 0.0; // what is no number goes to node 0
}

// (premultiplied colour, opacity) of a full segment between two nodes.
vec4 classify(float front, float back) {
  float row = abs(back - front);
  float column = min(front, back);
  int r = int(row);
  int c = int(column);
  int stride = back < front ? -job.table.x : job.table.x;
  int at = job.table.y + r * stride + c;
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
