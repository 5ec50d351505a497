#version 450 core
// Building the pre-integration table or a subtable (classify/outline.h): an invocation computes some entries of one
// diagonal k. Neighbouring invocations take neighbouring k and the same positions, so that they read the same pieces.
layout(local_size_x = 64) in;

// x: node intervals, y: columns per row, z: start of row k = 0, w: intervals per block
layout(location = 0) uniform ivec4 axis;
layout(location = 1) uniform vec4 peak; // the largest value of each channel, and 1

// Premultiplied colour and opacity over a stretch of the value axis, towards higher nodes and towards lower ones.
struct Both { vec4 up, down; };

// The over operator, without computing 1 - opacity: for a small opacity that rounds in the same direction for many
// similar segments.
vec4 over(vec4 front, vec4 back) {
  precise vec4 sum = (front - front.a * back) + back;
  return sum;
}

Both join(Both low, Both high) { return Both(over(low.up, high.up), over(high.down, low.down)); }

// A running composite with Kahan summation (reason: segments.h).
struct Product { vec4 sum, lost; };
struct Products { Product up, down; };

void grow(inout Product p, vec4 by) {
  precise vec4 add = by + p.lost;
  precise vec4 sum = p.sum + add;
  precise vec4 lost = add - (sum - p.sum);
  p = Product(sum, lost);
}

void put_before(inout Product p, vec4 front) {
  precise vec4 by = front - front.a * p.sum;
  grow(p, by);
}

void put_behind(inout Product p, vec4 back) {
  precise vec4 by = back - p.sum.a * back;
  grow(p, by);
}

void add_below(inout Products p, Both low) {
  put_before(p.up, low.up);
  put_behind(p.down, low.down);
}

void add_above(inout Products p, Both high) {
  put_behind(p.up, high.up);
  put_before(p.down, high.down);
}

Products nothing() { return Products(Product(vec4(0.0), vec4(0.0)), Product(vec4(0.0), vec4(0.0))); }

// Composites of whole blocks: [block][k - 1].
layout(std430, binding = 2) buffer Totals { Both totals[]; };
