// Draws the splats of bricks into the tile, as tile_tmpl.h does: a work-group for each brick and band of rows. PASS 1: depths of
// cores. PASS 3: weights and normals of splats that are not occluded. PASS 4, translucent: optical depths and colours of a sheet.
struct Entry { vec4 at, eye; uvec4 words; vec4 starts[5]; }; // splat_entry of splat.c
layout(std430, binding = 3) readonly buffer Table { vec4 table[]; }; // tc_splat_appearance_table()
layout(std430, binding = 4) readonly buffer Words { uint words[]; }; // packed splats: packing of splat.c
layout(std430, binding = 5) readonly buffer Entries { Entry entries[]; };
layout(location = 1) uniform uint first_entry;
layout(location = 2) uniform uint first_appearance; // 0: one colour
layout(location = 4) uniform int rows;         // of the tile, for each work-group of a brick
layout(location = 5) uniform uint first_inset;
layout(location = 6) uniform uint first_rim; // 0: not cut faces
layout(location = 3) uniform uvec2 sheet;      // PASS 4: four times the axis; coordinate along it within the brick

// cut: a plane may clip it; then origin is the surface's position at its centre, in index coordinates from the brick's voxel 0,
// and cut_x and cut_y are the steps on the surface for a pixel along x and y. planes: bits of the planes that clip it. The object's
// surface may clip a cut face: where dot(rim.xyz, position) > rim.w, and at a sheet's other side where it is less than back.
struct Footprint {
  vec2 at; float z; vec3 q; vec2 reach; float area_ratio2; uint word, inset, appearance;
  bool cut; vec3 origin, cut_x, cut_y; vec4 rim; float back; uint planes;
};

uint seen_faces(Entry e, vec3 d) {
  uint seen = 0u;
  vec3 to_eye = e.eye.xyz - d;
  for (int k = 0; k < 3; k++)
    seen |= (to_eye[k] < -0.5 ? 1u << 2 * k : 0u) | (to_eye[k] > 0.5 ? 2u << 2 * k : 0u);
  return seen;
}

// Distance in mm of a position from plane i, positive on the kept side.
float away(Entry e, int i, vec3 d) {
  return fma(d.z, splat.planes[i].z, fma(d.y, splat.planes[i].y, d.x * splat.planes[i].x)) + e.starts[i / 4][i % 4];
}

// planes: bits of the planes to test. beyond: distance in voxels that a position may lie beyond a plane.
bool kept(Entry e, uint planes, vec3 d, float beyond) {
  for (; planes != 0u; planes &= planes - 1u) {
    int i = findLSB(planes);
    if (away(e, i, d) < -beyond * length(splat.planes[i].xyz))
      return false;
  }
  return true;
}

float along(int row, vec3 d, float start) {
  vec3 m = splat.axis[row].xyz;
  return fma(d.z, m.z, fma(d.y, m.y, fma(d.x, m.x, start)));
}

vec3 unfolded(uint word) {
  vec2 e = (vec2(word >> 18 & 127u, word >> 25) - 63.0) / 63.0;
  vec3 n = vec3(e, 1.0 - abs(e.x) - abs(e.y));
  if (n.z < 0.0)
    n.xy = (1.0 - abs(e.yx)) * mix(vec2(1.0), vec2(-1.0), lessThan(e, vec2(0.0)));
  return n * (1.0 / sqrt(dot(n, n)));
}

const float ON_FACE = 1e-3; // TC_SPLAT_ON_FACE
const float FLAT = 0.4, LONG = 1.3, ASLANT = 0.3, OVER = 0.02; // TC_SPLAT_FLAT, TC_SPLAT_LONG, TC_SPLAT_ASLANT, TC_SPLAT_OVER
const uint SHEET = 0u, END = 2u, DOT = 3u; // tc_splat_thin

bool is_thin(uint word) { return (word >> 12 & word >> 13 & 0x15u) != 0u; }

// As in shape_tmpl.h; eye: relative to the voxel, in index coordinates.
struct Shape { vec3 axis; float along, across, middle, surface; bool on_surface, front; };

float core_of(Shape s, vec3 eye) {
  float thick = clamp((abs(dot(eye, s.axis)) / length(eye) - ASLANT) / ASLANT, 0.0, 1.0);
  return mix(s.along, max(min(s.along / FLAT, 1.0), s.along), thick);
}

vec3 axis_of(uint word) {
  vec3 n = unfolded(word);
  return normalize(vec3(dot(splat.covariant[0].xyz, n), dot(splat.covariant[1].xyz, n), dot(splat.covariant[2].xyz, n)));
}

Shape shape_of(uint word, uint stored, vec3 eye, inout vec3 at) {
  Shape s = Shape(axis_of(word), 1.0, 1.0, 0.0, 0.0, is_thin(word) && stored >> 6 == SHEET, false);
  if (stored == 0u)
    return s;
  vec3 way = vec3(dot(splat.axis[0].xyz, s.axis), dot(splat.axis[1].xyz, s.axis), dot(splat.axis[2].xyz, s.axis));
  float thick = float(stored & 63u) / 63.0, surface = (float(stored) - 1.0) * (splat.shape_blend / 254.0), along = FLAT, across = 1.0;
  uint what = stored >> 6;
  if (is_thin(word)) {
    float on = float(stored & 7u) * (LONG / 7.0);
    along = what == SHEET || what == DOT ? thick : what == END ? (on + splat.core_radius) * (0.5 / splat.core_radius) : LONG;
    across = what == SHEET ? 1.0 : what == END ? float(stored >> 3 & 7u) * 0.1 + 0.3 : thick;
    if (what == END)
      s.middle = (on - splat.core_radius) * 0.5 * splat.shape_blend;
  } else {
    s.middle = surface - FLAT * splat.core_radius * splat.shape_blend, s.surface = surface, s.on_surface = true;
  }
  at += way * vec3(s.middle, s.middle, s.surface);
  s.front = s.on_surface && dot(eye, s.axis) > 0.0;
  s.along = fma(along - 1.0, splat.shape_blend, 1.0), s.across = fma(across - 1.0, splat.shape_blend, 1.0);
  if (!is_thin(word) || what == SHEET)
#if PASS == 1
    s.along = core_of(s, eye);
#else
    s.along = splat.coreless_scale > 1.0 ? max(s.along, core_of(s, eye) * splat.core_share) : core_of(s, eye);
#endif
  return s;
}

vec3 stretched(Shape s, vec3 row) { return fma(vec3((s.along - s.across) * dot(row, s.axis)), s.axis, row * s.across); }

// Distance in voxels that a kernel reaches from its voxel.
float clip_reach() { return fma(sqrt(splat.radius2), fma(LONG - 1.0, splat.shape_blend, 1.0), splat.shape_blend); }

// find_cuts() of cut_tmpl.h. rim: of a cut face, else 0.
void set_cut(Entry e, Shape own, vec3 d, vec3 jx, vec3 jy, uint rim, inout Footprint f) {
  vec3 area = cross(jx, jy), normal = splat.axis[2].xyz;
  float facing = dot(own.axis, area);
  if (own.on_surface && dot(area, area) * 0.01 < facing * facing)
    normal = own.axis;
  float inverse = 1.0 / dot(normal, area), shift = own.surface - own.middle;
  f.cut_x = cross(jy, normal) * inverse, f.cut_y = cross(normal, jx) * inverse;
  f.origin = d + own.axis * own.surface - f.cut_x * (dot(jx, own.axis) * shift) - f.cut_y * (dot(jy, own.axis) * shift);
  f.planes = e.words.w;
  for (uint left = first_rim == 0u ? e.words.w : 0u; left != 0u; left &= left - 1u) {
    int i = findLSB(left);
    if (!(away(e, i, d) < clip_reach() * length(splat.planes[i].xyz)))
      f.planes &= ~(1u << i);
  }
  if (first_rim != 0u && !is_thin(f.word)) {
    vec3 place = d + own.axis * (own.surface / splat.shape_blend);
    float least = 1e30;
    for (uint left = e.words.w; left != 0u; left &= left - 1u) {
      int i = findLSB(left);
      least = min(least, abs(away(e, i, place)) / length(splat.planes[i].xyz));
    }
    for (uint left = e.words.w; left != 0u; left &= left - 1u) {
      int i = findLSB(left);
      if (abs(away(e, i, place)) <= (least + ON_FACE) * length(splat.planes[i].xyz))
        f.planes &= ~(1u << i);
    }
  }
  f.rim = vec4(0.0, 0.0, 0.0, 1.0), f.back = -1.0;
  if ((rim & 255u) == 0u)
    return;
  vec3 out_of = axis_of(rim);
  float inset = float(rim & 255u), middle = dot(out_of, d);
  float out_by = is_thin(rim) ? fma(inset / 63.0 - 1.0, splat.shape_blend, 1.0) * splat.core_radius : (inset - 1.0) / 254.0;
  f.rim = vec4(out_of, middle + out_by), f.back = is_thin(rim) ? middle - out_by : -1e30;
}

// False: the splat faces away or does not meet the tile.
bool project(Entry e, uint word, uint stored, uint rim, out Footprint f) {
  vec3 d = vec3(word & 15u, word >> 4 & 15u, word >> 8 & 15u);
  uint own_faces = word >> 12 & 63u, faces = own_faces & ((e.words.z & 256u) != 0u ? seen_faces(e, d) : e.words.z);
  vec3 at = vec3(along(0, d, e.at.x), along(1, d, e.at.y), along(2, d, e.at.z));
  Shape own = Shape(vec3(0.0), 1.0, 1.0, 0.0, 0.0, false, false);
  if (PASS != 4 && splat.shape_blend > 0.0)
    own = shape_of(word, stored, e.eye.xyz - d, at);
  if ((own_faces & e.words.z >> 16) != 0u && (own.front || is_thin(word)))
    faces = own_faces;
  float x = at.x, y = at.y, u = 0.0, v = 0.0, scale = splat.scale;
  f.word = word, f.inset = stored, f.cut = (e.words.z & 512u) != 0u;
  f.z = at.z;
  if ((PASS != 4 && faces == 0u) || !(splat.near_mm < f.z) || (f.cut && first_rim == 0u && !kept(e, e.words.w, d, own.front ? clip_reach() : 0.0)))
    return false;
  if (splat.perspective != 0) {
    float inverse = 1.0 / f.z;
    u = x * inverse, v = y * inverse, scale *= inverse;
    x = u * splat.scale, y = v * splat.scale;
  } else {
    x *= scale, y *= scale;
  }
  f.at = vec2(x, y) + (0.5 * splat.size - vec2(tile.xy));
  vec3 jx = splat.axis[0].xyz - u * splat.axis[2].xyz, jy = splat.axis[1].xyz - v * splat.axis[2].xyz;
#if PASS != 4
  if (f.cut)
    set_cut(e, own, d, jx * scale, jy * scale, rim, f);
#endif
  jx = stretched(own, jx), jy = stretched(own, jy);
  vec3 across = cross(jx, jy);
  scale = scale * scale * splat.radius2;
  float xx = dot(jx, jx) * scale, yy = dot(jy, jy) * scale, xy = dot(jx, jy) * scale, area = dot(across, across) * scale * scale;
  float inverse = 1.0 / fma(splat.pixel_radius2, xx + yy + splat.pixel_radius2, area);
  xx += splat.pixel_radius2, yy += splat.pixel_radius2;
  f.area_ratio2 = area * inverse;
  f.q = vec3(yy, -xy, xx) * inverse;
  f.reach = sqrt(vec2(xx, yy));
#if PASS == 1
  f.reach *= splat.core_share;
#endif
  return all(greaterThan(f.at + f.reach, vec2(0.0))) && all(lessThan(f.at - f.reach, vec2(tile.zw)));
}

bool is_cut(Entry e, Footprint f, vec2 p) {
  vec2 d = p + 0.5 - f.at;
  vec3 place = f.origin + f.cut_x * d.x + f.cut_y * d.y;
  float out_of = dot(f.rim.xyz, place);
  return f.cut && (!kept(e, f.planes, place, OVER) || (first_rim != 0u && (out_of > f.rim.w + OVER || out_of < f.back - OVER)));
}

float distance_at(Footprint f, vec2 p) {
  vec2 d = p + 0.5 - f.at;
  return fma(d.x, fma(d.x, f.q.x, 2.0 * f.q.y * d.y), f.q.z * d.y * d.y);
}

vec3 direction_at(vec2 at) { return splat.direction0.xyz + at.x * splat.direction_du.xyz + at.y * splat.direction_dv.xyz; }

// line_direction() of tile_tmpl.h, of any length.
vec3 line_direction(vec3 n) {
  vec3 way = vec3(0.0);
  for (int k = 0; k < 3; k++)
    way += splat.covariant[k].xyz * dot(splat.covariant[k].xyz, n);
  return way;
}

// find_orientation() of tile_tmpl.h.
vec3 normal_of(Footprint f) {
  vec3 n = unfolded(f.word), eye = -direction_at(f.at + vec2(tile.xy));
  if (!is_thin(f.word))
    return n;
  uint what = f.inset >> 6;
  if (what == SHEET)
    return dot(n, eye) < 0.0 ? -n : n;
  vec3 way = line_direction(n);
  n = what == DOT ? eye : eye - dot(way, eye) / dot(way, way) * way;
  return dot(n, n) > 0.0 ? n / sqrt(dot(n, n)) : n;
}

int weight_at(float q) {
  uint step = uint(max(q, 0.0) * 1024.0);
  return int(splat.weights[step >> 4][step >> 2 & 3u] >> 8 * (step & 3u) & 255u);
}

#if PASS == 1
void draw_footprint(Entry e, Footprint f, ivec2 from, ivec2 to) {
  for (int y = from.y; y <= to.y; y++)
    for (int x = from.x; x <= to.x; x++)
      if (distance_at(f, vec2(x, y)) < splat.core2 && !is_cut(e, f, vec2(x, y)))
        atomicMin(nearest[y * tile.z + x], ordered(f.z));
}
#elif PASS == 4
// mass_of() of translucent_tmpl.h.
float mass_of(Footprint f) {
  vec2 p = (f.at + vec2(tile.xy) - 0.5 * splat.size) / splat.scale;
  float square = 0.0, along = splat.perspective != 0 ? dot(p, p) + 1.0 : 1.0;
  for (int k = 0; k < 3; k++) {
    vec3 m = splat.to_index[k].xyz;
    float step = splat.perspective != 0 ? m.x * p.x + m.y * p.y + m.z : m.z;
    square += step * step;
  }
  return splat.mass * sqrt(along / square) * sqrt(f.area_ratio2);
}

void draw_footprint(Entry e, Footprint f, ivec2 from, ivec2 to) {
  vec4 material = vec4(table[f.appearance & 0xffffu].rgb, table[f.appearance >> 16].a);
  if (any(lessThan(to, from)) || !(material.a > 0.0))
    return;
#if SHADED
  vec2 middle = f.at + vec2(tile.xy);
  vec3 n = f.word >> 25 != 127u ? normal_of(f) : vec3(0.0);
  material.rgb = shade(vec4(material.rgb, 1.0), n, n, -normalize(direction_at(middle))).rgb;
#endif
  float depth = mass_of(f) * material.a;
  for (int y = from.y; y <= to.y; y++)
    for (int x = from.x; x <= to.x; x++) {
      float amount = min(float(weight_at(min(distance_at(f, vec2(x, y)), 1.0))) * depth, splat.most) * SCALE;
      int at = (y * tile.z + x) * splat.stride;
      if (amount < 0.5)
        continue;
      atomicAdd(sums[at], int(amount + 0.5));
      for (int k = 0; k < 3; k++)
        atomicAdd(sums[at + 1 + k], int(amount * material[k] + 0.5));
    }
}
#else
bool hidden(float z, ivec2 from, ivec2 to) {
  for (int y = from.y / BLOCK; y <= to.y / BLOCK; y++)
    for (int x = from.x / BLOCK; x <= to.x / BLOCK; x++)
      if (z <= depth_of(nearest[block_at(x, y)]))
        return false;
  return true;
}

// As in round_tmpl.h.
struct Rounding { vec3 front; mat2x3 across; mat2 per_pixel; }; // per_pixel: a column for each of across

vec2 per_pixel_of(Footprint f, vec3 across) {
  vec2 u = vec2(dot(across, splat.right.xyz), dot(across, splat.down.xyz));
  float det = f.q.x * f.q.z - f.q.y * f.q.y;
  float reach2 = splat.core2 * (f.q.z * u.x * u.x - 2.0 * f.q.y * u.x * u.y + f.q.x * u.y * u.y) / det;
  return reach2 > 0.0 ? u * (splat.shape_blend / sqrt(reach2)) : vec2(0.0);
}

bool is_round(Footprint f, vec3 front, out Rounding r) {
  uint what = f.inset >> 6;
  r = Rounding(front, mat2x3(0.0), mat2(0.0));
  if (!is_thin(f.word) || what == SHEET || !(splat.shape_blend > 0.0))
    return false;
  r.across[0] = splat.right.xyz;
  if (what == DOT)
    r.across[1] = splat.down.xyz, r.per_pixel[1] = per_pixel_of(f, r.across[1]);
  else
    r.across[0] = cross(normalize(line_direction(unfolded(f.word))), front);
  r.per_pixel[0] = per_pixel_of(f, r.across[0]);
  return true;
}

vec3 round_normal(Rounding r, vec2 d) {
  vec2 s = d * r.per_pixel;
  float square = dot(s, s);
  return r.across * (s / sqrt(max(square, 1.0))) + sqrt(max(1.0 - square, 0.0)) * r.front;
}

void draw_footprint(Entry e, Footprint f, ivec2 from, ivec2 to) {
  float z = f.z - splat.window_mm;
  if (any(lessThan(to, from)) || (splat.culling != 0 && hidden(z, from, to)))
    return;
  vec3 normal = normal_of(f);
  Rounding r;
  bool rounded = is_round(f, normal, r);
  ivec3 n = ivec3(roundEven(normal * 127.0)), c = ivec3(0);
  if (first_appearance != 0u)
    c = ivec3(roundEven(table[f.appearance & 0xffffu].rgb * 255.0));
  for (int y = from.y; y <= to.y; y++)
    for (int x = from.x; x <= to.x; x++) {
      float q = distance_at(f, vec2(x, y));
      int at = y * tile.z + x, sum = at * splat.stride;
      float apart = (f.z - depth_of(nearest[at])) / splat.window_mm;
      q = nearest[at] == FAR ? q * splat.coreless_scale : q + apart * apart * apart * apart;
      if (!(q < 1.0) || !(z < depth_of(nearest[at])) || is_cut(e, f, vec2(x, y)))
        continue;
      int weight = weight_at(q);
      if (rounded)
        n = ivec3(roundEven(round_normal(r, vec2(x, y) + 0.5 - f.at) * 127.0));
      atomicAdd(sums[sum], weight);
      for (int k = 0; k < 3; k++)
        atomicAdd(sums[sum + 1 + k], weight * n[k]);
      for (int k = 0; k < 3 && first_appearance != 0u; k++)
        atomicAdd(sums[sum + 4 + k], weight * c[k]);
    }
}
#endif

void main() {
  Entry e = entries[first_entry + gl_WorkGroupID.x];
  for (uint i = gl_LocalInvocationIndex; i < e.words.y; i += 64u) {
    Footprint f;
    uint word = words[e.words.x + i];
    uint inset = words[first_inset + (e.words.x + i >> 2)] >> 8 * (e.words.x + i & 3u) & 255u;
    if ((PASS == 4 && (word >> sheet.x & 15u) != sheet.y) || !project(e, word, inset, first_rim != 0u ? words[first_rim + e.words.x + i] : 0u, f))
      continue;
    f.appearance = first_appearance != 0u ? words[first_appearance + e.words.x + i] : 0u;
    vec2 r = f.reach;
    ivec2 from = ivec2(max(f.at - r + 0.5, vec2(0.0))), to = ivec2(floor(min(f.at + r - 0.5, vec2(tile.zw - 1))));
    int first = int(gl_WorkGroupID.y) * rows;
    draw_footprint(e, f, ivec2(from.x, max(from.y, first)), ivec2(to.x, min(to.y, first + rows - 1)));
  }
}
