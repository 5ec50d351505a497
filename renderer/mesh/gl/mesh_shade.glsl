// Colours of the visible triangles, each once a pixel (mesh/raster.h; equations: shading.h), in raster_shade_tmpl.h's steps.
layout(binding = 3) uniform usampler2DArray triangles; // a layer for each sample; 0xffffffff: nothing
layout(std430, binding = 4) readonly buffer Vertices { uvec4 vertices[]; }; // bits of x, y, z; normal
layout(std430, binding = 5) readonly buffer Indices { uint indices[]; };
layout(std430, binding = 6) readonly buffer Clusters { uvec2 clusters[]; }; // first triangle; surface; behind them colours of corners
struct Light { vec4 to, color; }; // along right, down, forward; w: whether it is at the camera
struct Surface { // raster.h
  vec4 color; // compositing space, opacity
  vec4 glow[2];
  vec2 factor;
  float least, specular, shininess;
  int shaded, n_lights, colored; // colored: 1: by its vertices; 2: by the volume
  Light lights[8];
};
layout(std430, binding = 7) readonly buffer Surfaces { Surface surfaces[]; };
// Of each pixel what translucent layers gave so far: colour and opacity, 1 / mm from the eye to the nearest, how many triangles
// were shaded, and of each sample how much they cover of what is behind.
layout(std430, binding = 8) buffer Layers { float layers[]; };
layout(location = 1) uniform int phase; // 0: nothing is translucent; 1: one more layer; 2: what is opaque, behind all of them
#if DEPTH
layout(std430, binding = 3) writeonly buffer Depth { float depths[]; }; // [h][w] mm from the eye
#endif
const uint NOTHING = 0xffffffffu;

vec3 turned(vec3 v) { return vec3(dot(mesh.right.xyz, v), dot(mesh.down.xyz, v), dot(mesh.depth.xyz, v)); }

vec3 corner(uvec4 vertex) {
  vec4 p = vec4(uintBitsToFloat(vertex.xyz), 1.0);
  return vec3(dot(mesh.right, p), dot(mesh.down, p), dot(mesh.depth, p));
}

vec3 normal(uvec4 vertex) { // octahedral
  vec2 e = vec2(ivec2(vertex.ww << uvec2(16, 0)) >> 16) / 32767.0;
  vec3 n = vec3(e, 1.0 - abs(e.x) - abs(e.y));
  if (n.z < 0.0)
    n.xy = (1.0 - abs(e.yx)) * mix(vec2(1.0), vec2(-1.0), lessThan(e, vec2(0.0)));
  return normalize(n);
}

float held(float x, float most) { return x > 0.0 ? min(x, most) : 0.0; } // 0 of what is no number

uint surface_of(uint triangle) {
  uint lo = 0u, hi = mesh.several != 0 ? uint(mesh.n_clusters) : 0u;
  while (hi - lo > 1u && hi > 0u) {
    uint middle = (lo + hi) / 2u;
    if (clusters[middle].x <= triangle) lo = middle; else hi = middle;
  }
  return mesh.several != 0 ? clusters[lo].y : 0u;
}

vec3 channels(uint triangle, uint corner) {
  uint at = 3u * triangle + corner;
  uvec3 of = uvec3(clusters[uint(mesh.colors) + at / 2u][at & 1u]) >> uvec3(0u, 8u, 16u) & 255u;
  return vec3(mesh.channels[of.x / 4u][of.x & 3u], mesh.channels[of.y / 4u][of.y & 3u], mesh.channels[of.z / 4u][of.z & 3u]);
}

vec3 light_on(vec3 n, vec3 eye, vec3 color, uint s) {
  float facing = dot(n, eye), turn = facing < 0.0 ? -1.0 : 1.0;
  vec3 q = vec3(0.0), glint = vec3(0.0);
  for (int i = 0; i < surfaces[s].n_lights; i++) {
    vec4 to = surfaces[s].lights[i].to;
    float lit = abs(facing), mirror = lit;
    if (to.w == 0.0) {
      vec3 halfway = eye + to.xyz;
      lit = turn * dot(n, to.xyz);
      mirror = turn * dot(n, halfway / max(length(halfway), 1e-20));
    }
    if (surfaces[s].specular > 0.0 && lit > 0.0)
      glint += surfaces[s].lights[i].color.rgb * (surfaces[s].specular * exp2(surfaces[s].shininess * log2(clamp(mirror, 1e-30, 1.0))));
    q += surfaces[s].lights[i].color.rgb * max(lit, surfaces[s].least);
  }
  return clamp(color * (surfaces[s].factor.x + surfaces[s].factor.y * q) +
               (surfaces[s].glow[0].rgb + surfaces[s].glow[1].rgb * q) + glint, 0.0, 1.0);
}

#if SAMPLED // slices (grey_at() of mesh_job.c)
#if SAMPLED == 2
layout(binding = 4) uniform usampler2DArray gaps; // laid out as the volume is

// Whether a voxel that counts in the interpolation has no value; what rounding lets in does not count.
bool in_gap(vec3 p) {
  ivec3 cell = min(ivec3(p), max(job.dims.xyz - 2, 0));
  for (int i = 0; i < 8; i++) {
    ivec3 corner = ivec3(i & 1, i >> 1 & 1, i >> 2), at = cell + corner;
    vec3 weight = mix(1.0 - (p - vec3(cell)), p - vec3(cell), vec3(corner));
    int layer = at.z / job.dims.w;
    if (all(greaterThan(weight, vec3(1e-4))) && texelFetch(gaps, ivec3(at.x, at.y + (at.z - layer * job.dims.w) * job.dims.y, layer), 0).r != 0u)
      return true;
  }
  return false;
}
#endif

// A slice's grey, as the window has it; what has no value is black.
float grey_at(vec3 at) {
  vec4 p = vec4(at, 1.0);
  vec3 index = clamp(vec3(dot(mesh.to_index[0], p), dot(mesh.to_index[1], p), dot(mesh.to_index[2], p)), vec3(0.0), vec3(job.dims.xyz - 1));
#if SAMPLED == 2
  if (in_gap(index))
    return 0.0;
#endif
  float node = clamp((field(index) - job.nodes.x) * job.nodes.y, 0.0, job.nodes.z);
  return decode(clamp((node - job.window.x) * job.window.y + 0.5, 0.0, 1.0));
}
#endif

struct Meeting { // of the ray through a point of the picture and a triangle
  uvec4 v[3];
  vec3 ray, ab, ac;
  float b, c, distance; // weights of the second and third corner; mm from the eye
};

float along_edge(vec2 at, vec2 edge) { return clamp(dot(at, edge) / max(dot(edge, edge), 1e-30), 0.0, 1.0); }

// Weights of the second and third corner, held within the triangle (hold() of raster_shade_tmpl.h). b, c: from the first
// corner, as seen along the ray.
vec2 hold(vec2 weight, vec2 from, vec2 b, vec2 c) {
  if (weight.y < 0.0)
    weight = vec2(along_edge(from, b), 0.0);
  else if (weight.x < 0.0)
    weight = vec2(0.0, along_edge(from, c));
  else if (weight.x + weight.y > 1.0)
    weight = vec2(1.0, 0.0) + along_edge(from - b, c - b) * vec2(-1.0, 1.0);
  float x = held(weight.x, 1.0);
  return vec2(x, held(weight.y, 1.0 - x));
}

Meeting meet(uint triangle, vec2 at) {
  Meeting m;
  vec3 p[3];
  for (int i = 0; i < 3; i++) {
    m.v[i] = vertices[indices[3u * triangle + uint(i)]];
    p[i] = corner(m.v[i]);
  }
  vec2 across = (at - mesh.centre) * mesh.inverse_scale;
  m.ray = vec3(mesh.perspective != 0 ? across : vec2(0.0), 1.0);
  float before = mesh.perspective != 0 ? p[0].z + mesh.reference : 1.0;
  m.ab = p[1] - p[0], m.ac = p[2] - p[0];
  vec3 from = vec3(across * before - p[0].xy, 0.0), side = cross(m.ray, m.ac), other = cross(from, m.ab);
  float inverse = 1.0 / dot(m.ab, side);
  vec2 weight = hold(vec2(dot(from, side), dot(m.ray, other)) * inverse, from.xy, m.ab.xy - m.ray.xy * m.ab.z, m.ac.xy - m.ray.xy * m.ac.z);
  m.b = weight.x, m.c = weight.y;
  m.distance = (p[0].z + mesh.reference + (m.b * m.ab.z + m.c * m.ac.z)) * length(m.ray);
  return m;
}

// The triangle's colour where a ray meets it.
vec3 shade(uint triangle, Meeting m) {
  uvec4 v[3] = m.v;
  float b = m.b, c = m.c;
  uint s = surface_of(triangle);
  vec3 color = surfaces[s].color.rgb;
#if SAMPLED
  if (surfaces[s].colored == 2) {
    vec3 a = uintBitsToFloat(v[0].xyz);
    return vec3(grey_at(a + b * (uintBitsToFloat(v[1].xyz) - a) + c * (uintBitsToFloat(v[2].xyz) - a)));
  }
#endif
  if (surfaces[s].colored == 1)
    color = min((1.0 - b - c) * channels(triangle, 0u) + b * channels(triangle, 1u) + c * channels(triangle, 2u), 1.0);
  if (surfaces[s].shaded == 0)
    return color;
  vec3 n = mesh.normals != 0 ? turned((1.0 - b - c) * normal(v[0]) + b * normal(v[1]) + c * normal(v[2])) : cross(m.ab, m.ac);
  return light_on(n / max(length(n), 1e-20), -m.ray / length(m.ray), color, s);
}

uint seen(ivec2 place, int s) { return texelFetch(triangles, ivec3(place, s), 0).r; }

const float SEEN_THROUGH = 1.0 / 4096.0; // less is nothing (raster.c)

void main() {
  ivec2 place = ivec2(gl_GlobalInvocationID.xy);
  if (any(greaterThanEqual(place, tile.zw)))
    return;
  uint at = uint(place.y * tile.z + place.x), cell = 2u * ((gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x) & 63u);
  uint layer = uint(6 + mesh.n_samples) * at, shades = 0u;
  vec4 sum = vec4(0.0);
  float nearest = uintBitsToFloat(0x7f800000u); // infinite
  for (int s = 0; s < mesh.n_samples; s++) {
    uint triangle = seen(place, s);
    bool before = triangle == NOTHING;
    for (int i = 0; i < s && !before; i++)
      before = seen(place, i) == triangle;
    if (before)
      continue;
    float n = 0.0, share = 0.0, opacity = phase == 1 ? surfaces[surface_of(triangle)].color.a : 1.0;
    vec2 middle = vec2(0.0);
    for (int i = s; i < mesh.n_samples; i++) {
      float left = phase == 0 ? 1.0 : 1.0 - layers[layer + 6u + uint(i)];
      if (left < SEEN_THROUGH || seen(place, i) != triangle)
        continue;
#if DEPTH // the nearest sample's
      if (mesh.n_samples > 1)
        nearest = min(nearest, meet(triangle, vec2(tile.xy + place) + mesh.offsets[i].xy).distance);
#endif
      n++, share += left * opacity / float(mesh.n_samples), middle += mesh.offsets[i].xy;
      if (phase == 1)
        layers[layer + 6u + uint(i)] = 1.0 - left * (1.0 - opacity);
    }
    if (n == 0.0)
      continue;
    Meeting m = meet(triangle, vec2(tile.xy + place) + middle / n);
    sum += share * vec4(shade(triangle, m), 1.0);
    if (mesh.n_samples == 1)
      nearest = min(nearest, m.distance);
    shades++;
  }
  if (phase != 0) {
    shades += uint(layers[layer + 5u]);
    sum += vec4(layers[layer], layers[layer + 1u], layers[layer + 2u], layers[layer + 3u]);
    if (layers[layer + 4u] > 0.0)
      nearest = min(nearest, 1.0 / layers[layer + 4u]);
  }
  if (phase == 1) {
    for (int k = 0; k < 4; k++)
      layers[layer + uint(k)] = sum[k];
    layers[layer + 4u] = sum.a > 0.0 ? 1.0 / nearest : 0.0;
    layers[layer + 5u] = float(shades);
    return;
  }
  if (shades > 0u)
    atomicAdd(counters[cell + 1u].x, shades), atomicAdd(counters[cell + 1u].z, shades);
  write_result(at, sum);
#if DEPTH
  depths[at] = nearest;
#endif
}
