// Isosurfaces: the first hit (isosurface.h). A ray traverses cells; the t of each cell wall is computed and not
// accumulated, so that empty-space skipping changes no bit.
#if LEAP
layout(binding = 2) uniform usamplerBuffer distances; // skip/distance_map.h
#endif

const float NEVER = 1e30;

// entry: index position; direction: voxels per mm; inverse: 1 / direction; front: 1 along axes on which the ray goes
// up, else 0.
struct Ray { vec3 entry, direction, inverse, front; };

struct Cell {
  float w[8];        // at the corners: +x bit 0, +y bit 1, +z bit 2
  vec3 start, delta; // the ray's entry, and exit - entry, within the cell: 0..1
};

vec3 wall_times(Ray r, vec3 walls, float never) {
  precise vec3 t = (walls - r.entry) * r.inverse;
  return mix(t, vec3(never), lessThan(abs(r.direction), vec3(1e-12)));
}

vec3 place_at(Ray r, float t) {
  precise vec3 p = fma(vec3(t), r.direction, r.entry);
  return clamp(p, vec3(0.0), vec3(job.dims.xyz - 1));
}

// The cell that the ray is in at t, with all walls up to t crossed.
ivec3 find_cell(Ray r, float t) {
  vec3 c = floor(place_at(r, t)), steps = 2.0 * r.front - 1.0;
  vec3 behind = wall_times(r, c + 1.0 - r.front, -NEVER);
  bvec3 early = lessThan(vec3(t), behind); // rounding may misplace the ray: the t of the wall decides
  c = mix(c, c - steps, early);
  vec3 before = wall_times(r, c + r.front, NEVER);
  bvec3 late = lessThanEqual(before, vec3(t));
  c = mix(c, c + steps, bvec3(late.x && !early.x, late.y && !early.y, late.z && !early.z));
  return ivec3(c);
}

void fetch_cell(ivec3 cell, out float w[8]) {
  for (int z = 0; z < 2; z++) {
    vec4 c = (corners(cell.xy, cell.z + (job.dims.z > 1 ? z : 0)) - job.surface.x) * job.surface.y;
    // textureGather's order in (x, y): (0,1) (1,1) (1,0) (0,0); along a flat axis texels beyond are ignored.
    w[4 * z] = c.w;
    w[4 * z + 1] = job.dims.x > 1 ? c.z : c.w;
    w[4 * z + 2] = job.dims.y > 1 ? c.x : c.w;
    w[4 * z + 3] = job.dims.x > 1 ? (job.dims.y > 1 ? c.y : c.z) : w[4 * z + 2];
  }
}

#if LABELLED // the volume's gaps
// True if one of the cell's corners is a gap: such a cell has no surface.
bool is_blank(ivec3 cell) {
  ivec4 a = label_corners(cell.xy, cell.z), b = label_corners(cell.xy, cell.z + (job.dims.z > 1 ? 1 : 0));
  ivec4 any = a | b; // textureGather's order in (x, y): (0,1) (1,1) (1,0) (0,0)
  return (any.w | (job.dims.x > 1 ? any.z : 0) | (job.dims.y > 1 ? any.x : 0) | (job.dims.x > 1 && job.dims.y > 1 ? any.y : 0)) != 0;
}
#endif

float field_in(Cell c, float u) {
  precise vec3 f = fma(vec3(u), c.delta, c.start);
  precise vec4 x = fma(vec4(f.x), vec4(c.w[1] - c.w[0], c.w[3] - c.w[2], c.w[5] - c.w[4], c.w[7] - c.w[6]),
                       vec4(c.w[0], c.w[2], c.w[4], c.w[6]));
  precise vec2 y = fma(vec2(f.y), x.yw - x.xz, x.xz);
  precise float e = fma(f.z, y.y - y.x, y.x);
  return e;
}

void place_in_cell(Ray r, ivec3 cell, float from, float until, inout Cell c) {
  vec3 last = vec3(job.dims.xyz - 1);
  vec3 a = clamp(place_at(r, from) - vec3(cell), 0.0, 1.0);
  vec3 b = clamp(place_at(r, until) - vec3(cell), 0.0, 1.0);
  a = mix(a, 1.0 - r.front, lessThanEqual(vec3(from), wall_times(r, vec3(cell) + 1.0 - r.front, -NEVER)));
  b = mix(b, r.front, lessThanEqual(wall_times(r, vec3(cell) + r.front, NEVER), vec3(until)));
  a = mix(a, vec3(0.0), equal(last, vec3(0.0)));
  b = mix(b, vec3(0.0), equal(last, vec3(0.0)));
  c.start = a;
  c.delta = b - a;
}

// Along the ray the field is a cubic in u; x + y u + z u^2 is its derivative.
vec3 derive(Cell c) {
  vec4 a0 = vec4(c.w[0], c.w[2], c.w[4], c.w[6]);
  vec4 rise = vec4(c.w[1], c.w[3], c.w[5], c.w[7]) - a0;
  precise vec4 a = fma(rise, vec4(c.start.x), a0);
  precise vec4 b = rise * c.delta.x;
  precise vec2 da = a.yw - a.xz, db = b.yw - b.xz;
  precise vec2 e = fma(da, vec2(c.start.y), a.xz);
  precise vec2 h = fma(db, vec2(c.start.y), fma(da, vec2(c.delta.y), b.xz));
  precise vec2 i = db * c.delta.y;
  float de = e.y - e.x, dh = h.y - h.x, di = i.y - i.x;
  precise vec3 d = vec3(fma(dh, c.start.z, fma(de, c.delta.z, h.x)), 2.0 * fma(di, c.start.z, fma(dh, c.delta.z, i.x)),
                        3.0 * di * c.delta.z);
  return d;
}

// The u in 0..1 at which the field first changes sides; -1: never.
float first_change(Cell c, bool side) {
  vec3 d = derive(c);
  float bends[4] = float[4](0.0, 1.0, 1.0, 1.0);
  precise float half_b = 0.5 * d.y;
  precise float disc = fma(half_b, half_b, -d.x * d.z);
  if (disc >= 0.0) {
    float q = -(half_b + (half_b < 0.0 ? -sqrt(disc) : sqrt(disc)));
    float r0 = d.z != 0.0 ? q / d.z : 1.0, r1 = q != 0.0 ? d.x / q : 1.0;
    r0 = r0 > 0.0 && r0 < 1.0 ? r0 : 1.0;
    r1 = r1 > 0.0 && r1 < 1.0 ? r1 : 1.0;
    bends[1] = min(r0, r1);
    bends[2] = max(r0, r1);
  }
  float a = 0.0, b = -1.0, fa = 0.0, fb = 0.0;
  for (int i = 0; i < 4; i++) {
    float f = field_in(c, bends[i]);
    if ((f >= 0.0) != side) {
      b = bends[i];
      fb = f;
      break;
    }
    a = bends[i];
    fa = f;
  }
  if (b <= a) // no change, or a change at the entry
    return b;
  float x = fma(b - a, fa / (fa - fb), a);
  for (int n = 0; n < 32; n++) {
    float f = field_in(c, x), slope_u = fma(x, fma(x, d.z, d.y), d.x);
    if ((f >= 0.0) != side)
      b = x;
    else
      a = x;
    float next = slope_u != 0.0 ? x - f / slope_u : -1.0;
    if (!(next > a && next < b))
      next = 0.5 * (a + b);
    bool done = abs(next - x) <= 2e-7;
    x = next;
    if (done)
      break;
  }
  return x;
}

#if LEAP
// True in an empty block: moves t to the end of the empty cube around the block.
bool leap_ahead(Ray r, ivec3 cell, inout float t) {
  float size = float(job.blocks.x);
  ivec3 block = ivec3((vec3(cell) + 0.5) / size);
  float distance = float(texelFetch(distances, block.x + block.y * job.blocks.y + block.z * job.blocks.z).r);
  if (distance < 0.5)
    return false;
  vec3 reach = mix(vec3(1.0 - distance), vec3(distance), r.front) * size;
  vec3 times = wall_times(r, fma(vec3(block), vec3(size), reach), NEVER);
  t = max(t, min(times.x, min(times.y, times.z)));
  return true;
}
#endif

// Distance from the entry to the hit in mm; -1: none.
float find_hit(Ray r, float length_mm, inout Counts counts) {
  ivec3 cell_last = max(job.dims.xyz - 2, 0), steps = ivec3(2.0 * r.front - 1.0);
  ivec3 cell = clamp(find_cell(r, 0.0), ivec3(0), cell_last); // rounding may place the entry outside
  bool side = false, fresh = true;
  float t = 0.0;
  while (t < length_mm && all(greaterThanEqual(cell, ivec3(0))) && all(lessThanEqual(cell, cell_last))) {
#if LEAP
    if (!fresh && leap_ahead(r, cell, t)) {
      counts.leaps++;
      cell = find_cell(r, t);
      continue;
    }
#endif
    Cell c;
    fetch_cell(cell, c.w);
    counts.samples++;
    vec3 passed = wall_times(r, vec3(cell) + r.front, NEVER);
    float until = max(min(passed.x, min(passed.y, passed.z)), t);
    float least = c.w[0], most = c.w[0];
    for (int i = 1; i < 8; i++) {
      least = min(least, c.w[i]);
      most = max(most, c.w[i]);
    }
    bool mixed = least < 0.0 && most >= 0.0;
    if (mixed || fresh || (least >= 0.0) != side) {
      float end = min(until, length_mm);
      place_in_cell(r, cell, t, end, c);
      if (fresh)
        side = mixed ? field_in(c, 0.0) >= 0.0 : least >= 0.0;
      fresh = false;
#if LABELLED // behind a gap the ray's side is that at the gap's end
      bool blank = is_blank(cell);
      if (blank)
        side = mixed ? field_in(c, 1.0) >= 0.0 : least >= 0.0;
      float u = blank ? -1.0 : first_change(c, side);
#else
      float u = first_change(c, side);
#endif
      if (u >= 0.0)
        return fma(u, end - t, t);
    }
    bvec3 goes = lessThanEqual(passed, vec3(until));
    cell += ivec3(goes) * steps;
    t = until;
  }
  return -1.0;
}

#if DEPTH
float hit_mm; // distance from the entry to the hit of the last ray
#endif

vec4 march(vec3 anchor, vec3 direction, vec2 span, inout Counts counts) {
  precise vec3 entry = fma(vec3(span.x), direction, anchor);
  bvec3 single = equal(job.dims.xyz, ivec3(1)); // an axis of one voxel has no walls
  entry = mix(entry, vec3(0.0), single);
  direction = mix(direction, vec3(0.0), single);
  vec3 divisor = mix(direction, vec3(1.0), lessThan(abs(direction), vec3(1e-12)));
  Ray r = Ray(entry, direction, 1.0 / divisor, vec3(greaterThan(direction, vec3(0.0))));
  float t = find_hit(r, span.y - span.x, counts);
  if (t < 0.0)
    return vec4(0.0);
#if DEPTH
  hit_mm = t;
#endif
  vec4 color = vec4(job.surface_color.rgb, 1.0);
#if SHADED
  precise vec3 p = fma(vec3(t), direction, entry);
  vec3 gradient = gradient_at(p);
  counts.gradients++;
  color = shade(color, gradient, gradient, to_eye);
#endif
  return color;
}
