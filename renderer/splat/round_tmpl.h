/* Normals across lines and dots of one voxel, which are drawn as cylinders and balls where voxels are larger than
 * pixels: part of tile_tmpl.h. */

/* Normals of a line, as of a cylinder, or of a dot, as of a ball: unit vectors towards the eye and across, and of a
 * place (pixels from the splat's) its share of the way across to the core's rim. */
typedef struct rounding {
  float front[3], across[2][3], way[2][2];
} rounding;

/* way: of unit vector `across`, how far it goes in the picture over how far the core does. */
V_INLINE void set_way(const tc_splat_args *g, const batch *b, int i, rounding *r, int which) {
  float u = 0, v = 0;
  for (int k = 0; k < 3; k++) u += r->across[which][k] * g->right[k], v += r->across[which][k] * g->down[k];
  const float a = b->kernel.a[i], c = b->kernel.c[i], bb = b->kernel.b[i], det = a * c - bb * bb;
  const float reach2 = g->core * (c * u * u - 2 * bb * u * v + a * v * v) / det;
  const float scale = reach2 > 0 ? g->move / sqrtf(reach2) : 0;
  r->way[which][0] = u * scale, r->way[which][1] = v * scale;
}

/* False: the splat's normal is that of all its pixels. */
V_INLINE bool is_round(const tc_splat_args *g, const batch *b, int i, const facing *f, rounding *r) {
  const uint32_t splat = b->first + (uint32_t)i, word = b->entry->of->words[splat];
  const unsigned what = b->entry->of->insets[splat] >> 6;
  if (what == TC_SPLAT_SHEET || !(word >> 12 & word >> 13 & 0x15)) return false;
  for (int k = 0; k < 3; k++) r->front[k] = f->normal[k][i];
  memset(r->across, 0, sizeof r->across), memset(r->way, 0, sizeof r->way);
  if (what == TC_SPLAT_DOT) {
    memcpy(r->across[0], g->right, sizeof g->right), memcpy(r->across[1], g->down, sizeof g->down);
    set_way(g, b, i, r, 1);
  } else {
    for (int k = 0; k < 3; k++) {
      const int l = (k + 1) % 3, m = (k + 2) % 3;
      r->across[0][k] = f->way[l][i] * r->front[m] - f->way[m][i] * r->front[l];
    }
  }
  set_way(g, b, i, r, 0);
  return true;
}

/* In 127ths, at pixels dx, dy from the splat. */
V_INLINE void round_normal(const rounding *r, vf dx, vf dy, vi of[3]) {
  const vf one = v_set(1), whole = v_set(12582912); /* 1.5 * 2^23: sums with it are whole */
  vf s = v_fma(dx, v_set(r->way[0][0]), dy * v_set(r->way[0][1])), t = v_fma(dx, v_set(r->way[1][0]), dy * v_set(r->way[1][1]));
  const vf square = v_fma(s, s, t * t), scale = one / v_sqrt(v_max(square, one));
  const vf ahead = v_sqrt(v_max(one - square, v_set(0)));
  s = s * scale, t = t * scale;
  for (int k = 0; k < 3; k++) {
    const vf n = v_fma(s, v_set(r->across[0][k]), v_fma(t, v_set(r->across[1][k]), ahead * v_set(r->front[k])));
    of[k] = v_trunc(n * v_set(127) + whole - whole);
  }
}
