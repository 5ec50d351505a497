// Elementary segments in single precision, from the pieces of segments.c.
struct Piece { vec4 low, high; }; // at each end: colour, and the depth of the table's full length at that extinction
layout(std430, binding = 0) readonly buffer Pieces { Piece pieces[]; };
layout(std430, binding = 1) readonly buffer Firsts { uint first[]; };

// 1 - exp(-a), a >= 0, with a small relative error even for small a and an inaccurate exp().
float one_minus_exp(float a) {
  a = min(a, 87.0);
  precise float n = floor(0.5 - a * 1.44269504);
  precise float f = (-a - n * 0.693359375) + n * 2.12194440e-4;
  precise float p = f * (1.0 / 720.0 + f * (1.0 / 5040.0));
  p = f * (1.0 + f * (0.5 + f * (1.0 / 6.0 + f * (1.0 / 24.0 + f * (1.0 / 120.0 + p)))));
  float scale = intBitsToFloat((int(n) + 127) << 23);
  precise float w = -(scale * p) - (scale - 1.0);
  return w;
}

// The share of the far end's colour in the opacity w of a piece of depth a, seen from the low end (x) and from the high
// end (y): the integral of u over the opacity, for extinction a (1 + tilt (2u - 1)), expanded in a tilt, |a tilt| <=
// 0.05.
vec2 far_share(float a, float tilt, float w) {
  float x = a * tilt, even, i1, i2;
  if (a < 0.5) { // without the opacity term, so that nothing cancels
    float mean = a * (1.0 / 144.0 - a * (1.0 / 840.0 - a * (1.0 / 5760.0 - a * (1.0 / 45360.0))));
    even = a * (0.5 - a * (1.0 / 3.0 - a * (1.0 / 8.0 - a * (1.0 / 30.0 - mean))));
    i1 = 1.0 / 40.0 - a * (1.0 / 180.0 - a * (1.0 / 1008.0 - a * (1.0 / 6720.0)));
    i1 = 1.0 / 6.0 - a * (1.0 / 12.0 - a * i1);
    i2 = 1.0 / 30.0 - a * (1.0 / 60.0 - a * (1.0 / 210.0 - a * (1.0 / 1008.0)));
  } else {
    a = min(a, 1e7); // keeps powers of a finite
    x = a * tilt;
    float t = 1.0 - w, r = 1.0 / a, r3 = r * r * r;
    even = w * r - t;
    i1 = ((a - 2.0) + (a + 2.0) * t) * r3;
    i2 = 2.0 * ((a * (a - 6.0) + 12.0) - (a * (a + 6.0) + 12.0) * t) * r3 * r * r;
  }
  even += 0.5 * x * x * i2;
  return clamp(vec2(even + x * i1, even - x * i1), 0.0, w);
}

// Part of a piece, with little change of extinction over its depth; share: of the piece's length.
Both stretch(vec4 low, vec4 high, float share) {
  float sum = low.a + high.a, a = 0.5 * sum * share, w = one_minus_exp(a);
  if (low.rgb == high.rgb)
    return Both(vec4(low.rgb * w, w), vec4(low.rgb * w, w));
  vec2 far = far_share(a, sum > 0.0 ? (high.a - low.a) / sum : 0.0, w);
  return Both(vec4(low.rgb * (w - far.x) + high.rgb * far.x, w), vec4(high.rgb * (w - far.y) + low.rgb * far.y, w));
}

// A piece with steep extinction, cut into parts until the front is opaque, seen from `near`.
vec4 parts_of(vec4 near, vec4 far, float share, float parts) {
  Product all = Product(vec4(0.0), vec4(0.0));
  for (float i = 0.0; i < parts && all.sum.a < 1.0 - 1e-7; i += 1.0) {
    vec4 from = mix(near, far, i / parts), to = mix(near, far, (i + 1.0) / parts);
    put_behind(all, stretch(from, to, share / parts).up);
  }
  return all.sum;
}

// Node interval j as a segment of 1 / k of the table's length.
Both elementary(int j, int k) {
  float share = 1.0 / float(k);
  Products all = nothing();
  for (uint i = first[j]; i < first[j + 1]; i++) {
    vec4 low = pieces[i].low, high = pieces[i].high;
    if (low.a + high.a <= 0.0)
      continue;
    float bend = 0.5 * abs(high.a - low.a) * share;
    Both piece;
    if (bend <= 0.05 || low.rgb == high.rgb) {
      piece = stretch(low, high, share);
    } else {
      float parts = min(ceil(sqrt(bend * 20.0)), 1e6);
      piece = Both(parts_of(low, high, share, parts), parts_of(high, low, share, parts));
    }
    add_above(all, piece);
  }
  return Both(all.up.sum, all.down.sum);
}
