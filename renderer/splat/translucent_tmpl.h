/* Translucent splats; part of tile_tmpl.h. Sheets of voxels with one coordinate in common are composited front to back (Westover,
 * Footprint evaluation for volume rendering, SIGGRAPH 1990). */

/* Optical depth at the centre of a footprint: the kernel's integral along the ray through its voxel. A widened footprint keeps the
 * same total. */
V_INLINE float mass_of(const tc_splat_args *g, const batch *b, int i, const tc_splat_tile *t) {
  const float x = (b->x[i] + (float)t->x0 - 0.5f * g->width) / g->scale;
  const float y = (b->y[i] + (float)t->y0 - 0.5f * g->height) / g->scale;
  float square = 0, length = g->perspective ? x * x + y * y + 1 : 1;
  for (int k = 0; k < 3; k++) {
    const float *m = g->to_index[k];
    const float step = g->perspective ? m[0] * x + m[1] * y + m[2] : m[2];
    square += step * step;
  }
  return g->mass * sqrtf(length / square) * sqrtf(b->area_ratio2[i]);
}

V_INLINE void add_material(const tc_splat_args *g, const batch *b, int i, const reach *r, const float rgbk[4],
                           tc_splat_tile *t) {
  const float depth = mass_of(g, b, i, t) * rgbk[3];
  for (int x = r->x0; x <= r->x1; x += V_LANES) {
    const columns c = columns_of(b, &b->kernel, i, x);
    int p = r->y0 * TC_TILE_STRIDE + x;
    vf dy = first_dy(b, i, r->y0);
    for (int y = r->y0; y <= r->y1; y++, p += TC_TILE_STRIDE, dy = dy + v_set(1)) {
      const vf q = v_min(v_max(distances(&c, dy), v_set(0)), v_set(1));
      const vf weight = v_float(v_bytes(g->weights, v_trunc(q * v_set(TC_WEIGHT_STEPS)))) * v_set(depth);
      for (int k = 0; k < 4; k++) {
        float *to = t->sums[k] + p;
        v_store(to, v_fma(weight, v_set(k ? rgbk[k - 1] : 1), v_load(to)));
      }
    }
  }
  t->touched[0] = r->x0 < t->touched[0] ? r->x0 : t->touched[0];
  t->touched[1] = r->y0 < t->touched[1] ? r->y0 : t->touched[1];
  t->touched[2] = r->x1 > t->touched[2] ? r->x1 : t->touched[2];
  t->touched[3] = r->y1 > t->touched[3] ? r->y1 : t->touched[3];
}

/* The lanes whose voxels lie in the sheet. */
V_INLINE vm in_sheet(const tc_splat_entry *e, uint32_t first, int axis, int at) {
  vi word = v_bits(v_load((const float *)(const void *)(e->of->words + first)));
  return v_eq(v_float(v_andi(v_sra(word, 4 * axis), v_seti(15))), v_set((float)at));
}

/* Colours and extinctions of the lanes of a batch with here[] > 0, lit where they have normals; extinction 0 for others. */
static void fetch_materials(const tc_splat_args *g, const batch *b, const float *here, const tc_splat_tile *t,
                            float rgbk[V_LANES][4]) {
  float c[3][V_LANES] = {0};
  orientation f;
  for (int i = 0; i < V_LANES; i++) {
    rgbk[i][3] = 0;
    if (!(b->alive >> i & 1) || !(here[i] > 0) || b->z[i] == INFINITY) continue;
    voxel_material(g, b->entry, b->first + (uint32_t)i, rgbk[i]);
    for (int k = 0; k < 3; k++) c[k][i] = rgbk[i][k];
  }
  if (!g->shaded) return;
  find_orientation(g, b, t, &f);
  const vf normal[3] = {v_load(f.normal[0]), v_load(f.normal[1]), v_load(f.normal[2])};
  const lighting l = lighting_at(v_load(b->x) + v_set((float)t->x0), v_load(b->y) + v_set((float)t->y0), g->direction0,
                                 g->direction_du, g->direction_dv, g->shade.light);
  const vf4 lit = shade(&g->shade, &l, normal, normal, (vf4){v_load(c[0]), v_load(c[1]), v_load(c[2]), v_set(1)});
  v_store(c[0], lit.r), v_store(c[1], lit.g), v_store(c[2], lit.b);
  for (int i = 0; i < V_LANES; i++)
    for (int k = 0; k < 3; k++) rgbk[i][k] = c[k][i];
}

static void draw_sheet(const tc_splat_args *g, const tc_splat_entry *e, int axis, int at, tc_splat_tile *t) {
  const uint32_t begin = e->brick.first, end = begin + e->brick.count;
  float here[V_LANES], rgbk[V_LANES][4];
  batch b;
  for (uint32_t first = begin; first < end; first += V_LANES) {
    if (halted(g, (first - begin) / V_LANES, t)) return;
    vm wanted = in_sheet(e, first, axis, at);
    if (!m_any(wanted) || !project(g, e, t, first, &b, NULL)) continue;
    v_store(here, v_select(wanted, v_set(1), v_set(0)));
    fetch_materials(g, &b, here, t, rgbk);
    for (int i = 0; i < V_LANES; i++) {
      if (!(rgbk[i][3] > 0)) continue;
      const reach r = reach_of(b.box, i);
      add_material(g, &b, i, &r, rgbk[i], t);
      t->drawn++;
    }
  }
}

static void compose_sheet(tc_splat_tile *t) {
  const vf zero = v_set(0);
  for (int y = t->touched[1]; y <= t->touched[3]; y++)
    for (int x = t->touched[0]; x <= t->touched[2]; x += V_LANES) {
      const int p = y * TC_TILE_STRIDE + x;
      vf depth = v_load(t->sums[0] + p), clear = exp2_approx(depth * v_set(-1.44269504f)),
         before = v_load(t->depth + p);
      /* The sheet's mean colour times its visible opacity; (1 - clear) / depth has the limit 1. */
      vf share = before * v_select(v_lt(v_set(1e-3f), depth), (v_set(1) - clear) / v_max(depth, v_set(1e-30f)),
                                   v_fnma(v_set(0.5f), depth, v_set(1)));
      for (int k = 0; k < 3; k++) {
        float *light = t->sums[TC_SUM_COLOR + k] + p;
        v_store(light, v_fma(share, v_load(t->sums[1 + k] + p), v_load(light)));
        v_store(t->sums[1 + k] + p, zero);
      }
      v_store(t->depth + p,
              before * v_select(v_lt(v_set(1e-3f), depth), clear, v_fma(v_set(0.5f) * depth, depth, v_set(1) - depth)));
      v_store(t->sums[0] + p, zero);
    }
  t->touched[0] = t->touched[1] = TC_TILE, t->touched[2] = t->touched[3] = -1;
}

static void emit_tile(const tc_splat_tile *t, float *out) {
  for (int y = 0; y < t->height; y++)
    for (int x = 0; x < t->width; x++, out += 4) {
      const int p = y * TC_TILE_STRIDE + x;
      out[3] = 1 - t->depth[p];
      for (int k = 0; k < 3; k++) out[k] = fminf(t->sums[TC_SUM_COLOR + k][p], out[3]);
    }
}
