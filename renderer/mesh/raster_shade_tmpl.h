/* The colours of visible fragments, a lane each. Part of the template, after raster_tmpl.h. */

/* A triangle's corners in view space: mm along right, down, forward. */
typedef struct seen {
  vf a[3], b[3], c[3];       /* forward: relative to the reference depth */
  vf na[2], nb[2], nc[2];    /* normals, octahedral */
} seen;

V_INLINE vf dot(const vf a[3], const vf b[3]) { return (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]; }

V_INLINE void cross(const vf a[3], const vf b[3], vf c[3]) {
  for (int k = 0; k < 3; k++) c[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

V_INLINE void scale_to_unit(vf v[3]) {
  vf inverse = v_set(1) / v_max(v_sqrt(dot(v, v)), v_set(1e-20f));
  for (int k = 0; k < 3; k++) v[k] = v[k] * inverse;
}

V_INLINE void to_camera(const tc_raster_frame *f, bool direction, const vf v[3], vf out[3]) {
  for (int k = 0; k < 3; k++) {
    const float *m = f->rows[k];
    out[k] = (v_set(m[0]) * v[0] + v_set(m[1]) * v[1]) + v_set(m[2]) * v[2];
    if (!direction) out[k] = out[k] + v_set(m[3]);
  }
}

V_INLINE void fetch(const tc_raster_frame *f, const uint32_t *ids, seen *s) {
  const tc_clusters *m = f->mesh;
  float at[9][V_LANES], normal[6][V_LANES];
  for (int lane = 0; lane < V_LANES; lane++) {
    const tc_cluster *k = &m->clusters[ids[lane] / TC_CLUSTER_TRIANGLES];
    const size_t room = tc_cluster_padded(k->n_vertices), corners = tc_cluster_padded(k->n_triangles);
    const uint8_t *corner = m->triangles + 3 * (size_t)k->triangle + ids[lane] % TC_CLUSTER_TRIANGLES;
    for (size_t i = 0; i < 3; i++) {
      const size_t v = corner[i * corners];
      const float *position = m->positions + 3 * (size_t)k->vertex + v;
      for (size_t d = 0; d < 3; d++) at[3 * i + d][lane] = position[d * room];
      if (!m->normals) continue;
      const uint32_t n = m->normals[k->vertex + v];
      normal[2 * i][lane] = (float)(int16_t)(uint16_t)n;
      normal[2 * i + 1][lane] = (float)(int16_t)(uint16_t)(n >> 16);
    }
  }
  vf *const points[3] = {s->a, s->b, s->c}, *const normals[3] = {s->na, s->nb, s->nc};
  for (int i = 0; i < 3; i++) {
    const vf p[3] = {v_load(at[3 * i]), v_load(at[3 * i + 1]), v_load(at[3 * i + 2])};
    to_camera(f, false, p, points[i]);
    for (int d = 0; d < 2 && m->normals; d++) normals[i][d] = v_load(normal[2 * i + d]) * v_set(1 / 32767.0f);
  }
}

V_INLINE vf fold(vf along, vf across) { /* the lower half of the octahedron */
  vf size = v_set(1) - v_abs(across);
  return v_select(v_lt(along, v_set(0)), v_set(0) - size, size);
}

V_INLINE void add_normal(const vf packed[2], vf weight, vf sum[3]) {
  vf z = (v_set(1) - v_abs(packed[0])) - v_abs(packed[1]);
  vm below = v_lt(z, v_set(0));
  vf n[3] = {v_select(below, fold(packed[0], packed[1]), packed[0]),
             v_select(below, fold(packed[1], packed[0]), packed[1]), z};
  scale_to_unit(n);
  for (int k = 0; k < 3; k++) sum[k] = sum[k] + weight * n[k];
}

/* How far along an edge, 0..1, is nearest to a point; both from the edge's start, in the plane. */
V_INLINE vf along_edge(const vf at[2], const vf edge[2]) {
  const vf square = v_max(edge[0] * edge[0] + edge[1] * edge[1], v_set(1e-30f));
  return v_min(v_max((at[0] * edge[0] + at[1] * edge[1]) / square, v_set(0)), v_set(1));
}

/* Holds the weights b and c within the triangle, for samples were found with rounded corners: a part of a pixel is many times
 * a needle's width. Takes the nearest point of an edge that the point is beyond, as seen along the ray. */
V_INLINE void hold(const vf ab[3], const vf ac[3], const vf from[3], const vf ray[3], vf weight[3]) {
  const vf zero = v_set(0), one = v_set(1);
  const vm over_ab = v_lt(weight[2], zero), over_ac = v_lt(weight[1], zero), over_bc = v_lt(one, weight[1] + weight[2]);
  if (m_any(m_or(over_ab, m_or(over_ac, over_bc)))) {
    vf b[2], c[2], bc[2], of_b[2];
    for (int k = 0; k < 2; k++) {
      b[k] = ab[k] - ray[k] * ab[2], c[k] = ac[k] - ray[k] * ac[2];
      bc[k] = c[k] - b[k], of_b[k] = from[k] - b[k];
    }
    const vf on_bc = along_edge(of_b, bc), on_ab = along_edge(from, b), on_ac = along_edge(from, c);
    weight[1] = v_select(over_bc, one - on_bc, weight[1]), weight[2] = v_select(over_bc, on_bc, weight[2]);
    weight[1] = v_select(over_ac, zero, weight[1]), weight[2] = v_select(over_ac, on_ac, weight[2]);
    weight[1] = v_select(over_ab, on_ab, weight[1]), weight[2] = v_select(over_ab, zero, weight[2]);
  }
  weight[1] = v_min(v_max(weight[1], zero), one); /* 0 of what is no number */
  weight[2] = v_min(v_max(weight[2], zero), one - weight[1]);
  weight[0] = one - weight[1] - weight[2];
}

/* A ray from a point at the depth of corner a along `ray`: where it meets the triangle's plane (Moeller and Trumbore,
 * Fast, minimum storage ray-triangle intersection, 1997), held within the triangle. Nothing here is far from the triangle,
 * however far the eye is. */
typedef struct meeting {
  vf weight[3], depth, face[3];
} meeting;

V_INLINE meeting meet(const tc_raster_frame *f, const seen *s, vf across, vf along, const vf ray[3]) {
  vf ab[3], ac[3], from[3], p[3], q[3];
  vf depth = v_set(1);
  if (f->perspective) depth = s->a[2] + v_set(f->reference);
  for (int k = 0; k < 3; k++) ab[k] = s->b[k] - s->a[k], ac[k] = s->c[k] - s->a[k];
  from[0] = across * depth - s->a[0], from[1] = along * depth - s->a[1], from[2] = v_set(0);
  cross(ray, ac, p);
  cross(from, ab, q);
  vf inverse = v_set(1) / dot(ab, p);
  meeting m;
  m.weight[1] = dot(from, p) * inverse;
  m.weight[2] = dot(ray, q) * inverse;
  hold(ab, ac, from, ray, m.weight);
  m.depth = (s->a[2] + v_set(f->reference)) + (m.weight[1] * ab[2] + m.weight[2] * ac[2]);
  cross(ab, ac, m.face);
  return m;
}

/* mirror^shininess for mirror in 0..1; relative error about 1e-6 times shininess. */
V_INLINE vf to_power(vf mirror, float shininess) {
  mirror = v_min(v_max(mirror, v_set(1e-30f)), v_set(1));
  vi bits = v_bits(mirror);
  vf m = v_from_bits(v_ori(v_andi(bits, v_seti(0x007fffff)), v_seti(0x3f800000)));
  vf e = v_float(v_subi(v_sra(bits, 23), v_seti(127)));
  vm high = v_lt(v_set(1.41421356f), m);
  m = v_select(high, m * v_set(0.5f), m), e = v_select(high, e + v_set(1), e);
  vf s = (m - v_set(1)) / (m + v_set(1)), s2 = s * s;
  vf log2 = e + s * (v_set(2.88539008f) + s2 * (v_set(0.96179669f) + s2 * (v_set(0.57707802f) + s2 * v_set(0.41219858f))));
  vf x = v_max(log2 * v_set(shininess), v_set(-126));
  vi whole = v_trunc(x - v_set(0.5f));
  vf r = x - v_float(whole);
  vf p = v_set(0.00961812911f) + r * v_set(0.00133335581f);
  p = v_set(1) + r * (v_set(0.693147181f) + r * (v_set(0.240226507f) + r * (v_set(0.0555041087f) + r * p)));
  return v_from_bits(v_addi(v_bits(p), v_shl(whole, 23)));
}

/* Colour and lighting of each lane's surface. */
V_INLINE void surface_of(const tc_raster_frame *f, const uint32_t *ids, vf color[3], int look[V_LANES]) {
  float of[3][V_LANES];
  for (int lane = 0; lane < V_LANES; lane++) {
    const tc_raster_surface *s = &f->surfaces[f->mesh->n_parts > 1 ? f->mesh->clusters[ids[lane] / TC_CLUSTER_TRIANGLES].part : 0];
    for (int k = 0; k < 3; k++) of[k][lane] = s->color[k];
    look[lane] = s->look;
  }
  for (int k = 0; k < 3; k++) color[k] = v_load(of[k]);
}

/* Interpolates vertex colours by the barycentric weights, in lanes whose surface has them. n: valid lanes. */
static int vertex_colors(const tc_raster_frame *f, const uint32_t *ids, int n, const vf weight[3], vf color[3]) {
  const tc_clusters *m = f->mesh;
  float of[3][3][V_LANES] = {0}, has[V_LANES];
  int found = 0;
  for (int lane = 0; lane < V_LANES; lane++) {
    const tc_cluster *k = &m->clusters[ids[lane] / TC_CLUSTER_TRIANGLES];
    has[lane] = f->surfaces[k->part].colored;
    if (!f->surfaces[k->part].colored) continue;
    const size_t corners = tc_cluster_padded(k->n_triangles);
    const uint8_t *corner = m->triangles + 3 * (size_t)k->triangle + ids[lane] % TC_CLUSTER_TRIANGLES;
    for (size_t i = 0; i < 3; i++)
      for (int c = 0; c < 3; c++) of[c][i][lane] = f->channels[m->colors[k->vertex + corner[i * corners]] >> 8 * c & 255];
    found += lane < n;
  }
  const vm mine = v_lt(v_set(0), v_load(has));
  for (int c = 0; c < 3; c++) {
    vf sum = (weight[0] * v_load(of[c][0]) + weight[1] * v_load(of[c][1])) + weight[2] * v_load(of[c][2]);
    color[c] = v_select(mine, v_min(sum, v_set(1)), color[c]);
  }
  return found;
}

/* Lighting of raycast/shading.h with weight 1. n and eye are unit; q and s are the sums over lights. color: unlit on entry, lit
 * on return. */
static void light(const tc_raster_look *look, const vf n[3], const vf eye[3], vf color[3]) {
  const vf zero = v_set(0), facing = dot(n, eye), turn = v_select(v_lt(facing, zero), v_set(-1), v_set(1));
  vf sum[3] = {zero, zero, zero}, glint[3] = {zero, zero, zero};
  for (int i = 0; i < look->n_lights; i++) {
    const float *to = look->lights[i].to, *of = look->lights[i].color;
    vf lit = v_abs(facing), mirror = lit;
    if (!look->lights[i].at_camera) {
      const vf towards[3] = {v_set(to[0]), v_set(to[1]), v_set(to[2])};
      vf half[3] = {eye[0] + towards[0], eye[1] + towards[1], eye[2] + towards[2]};
      scale_to_unit(half);
      lit = turn * dot(n, towards);
      mirror = turn * dot(n, half);
    }
    vf q = v_max(lit, v_set(look->least)), s = zero;
    if (look->specular > 0) s = v_select(v_lt(zero, lit), v_set(look->specular) * to_power(mirror, look->shininess), zero);
    for (int k = 0; k < 3; k++) sum[k] = sum[k] + v_set(of[k]) * q, glint[k] = glint[k] + v_set(of[k]) * s;
  }
  for (int k = 0; k < 3; k++) {
    vf c = color[k] * (v_set(look->factor[0]) + v_set(look->factor[1]) * sum[k]);
    c = c + (v_set(look->glow[0][k]) + v_set(look->glow[1][k]) * sum[k]) + glint[k];
    color[k] = v_min(v_max(c, zero), v_set(1));
  }
}

/* Lights each lane by its surface's look; neighbouring lanes mostly share one. */
V_INLINE void light_each(const tc_raster_frame *f, const int look[V_LANES], const vf n[3], const vf eye[3], vf color[3]) {
  float of[V_LANES];
  vf unlit[3];
  memcpy(unlit, color, sizeof unlit);
  for (int lane = 0; lane < V_LANES; lane++) of[lane] = (float)look[lane];
  for (int lane = 0; lane < V_LANES; lane++) {
    if (lane && look[lane] == look[lane - 1]) continue;
    vf lit[3];
    memcpy(lit, unlit, sizeof lit);
    if (f->looks[look[lane]].shaded) light(&f->looks[look[lane]], n, eye, lit);
    const vm mine = v_eq(v_load(of), v_set(of[lane]));
    for (int k = 0; k < 3; k++) color[k] = v_select(mine, lit[k], color[k]);
  }
}

static void shade(const tc_raster_frame *f, tc_raster_fragments *fragments) {
  bool shaded = false;
  int look[V_LANES];
  fragments->n_colored = 0;
  for (int i = 0; i < f->n_looks; i++) shaded = shaded || f->looks[i].shaded;
  for (int i = fragments->n; i % V_LANES; i++) fragments->id[i] = fragments->id[0]; /* a valid triangle for the padding lanes */
  for (int i = 0; i < fragments->n; i += V_LANES) {
    seen s;
    fetch(f, fragments->id + i, &s);
    vf across = (v_load(fragments->x + i) - v_set(f->centre[0])) * v_set(f->inverse_scale);
    vf along = (v_load(fragments->y + i) - v_set(f->centre[1])) * v_set(f->inverse_scale);
    vf ray[3] = {f->perspective ? across : v_set(0), f->perspective ? along : v_set(0), v_set(1)}, n[3], eye[3];
    vf length = v_sqrt(dot(ray, ray)), color[3];
    meeting m = meet(f, &s, across, along, ray);
    v_store(fragments->depth + i, m.depth * length);
    surface_of(f, fragments->id + i, color, look);
    if (f->channels) fragments->n_colored += vertex_colors(f, fragments->id + i, fragments->n - i, m.weight, color);
    for (int k = 0; k < 3; k++) {
      eye[k] = v_set(0) - ray[k] / length;
      n[k] = v_set(0);
    }
    if (shaded) {
      if (f->mesh->normals) {
        vf sum[3] = {v_set(0), v_set(0), v_set(0)};
        add_normal(s.na, m.weight[0], sum);
        add_normal(s.nb, m.weight[1], sum);
        add_normal(s.nc, m.weight[2], sum);
        to_camera(f, true, sum, n);
      } else {
        memcpy(n, m.face, sizeof n);
      }
      scale_to_unit(n);
      light_each(f, look, n, eye, color);
    }
    for (int k = 0; k < 3; k++) v_store(fragments->color[k] + i, color[k]);
  }
}
