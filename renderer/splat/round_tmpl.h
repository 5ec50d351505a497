/* Normals that vary across a kernel: lines are lit as cylinders and single voxels as balls where voxels are larger than pixels.
 * Part of tile_tmpl.h. */

/* Normals of a cylinder or ball: unit vectors towards the eye and across. Times `per_pixel`, an offset in pixels gives the
 * distance across in units of the core's radius. */
typedef struct rounding {
  float front[3], across[2][3], per_pixel[2][2];
} rounding;

/* Sets per_pixel of unit vector `which` of `across`. */
V_INLINE void set_per_pixel(const tc_splat_args *g, const batch *b, int i, rounding *r, int which) {
  float u = 0, v = 0;
  for (int k = 0; k < 3; k++) u += r->across[which][k] * g->right[k], v += r->across[which][k] * g->down[k];
  const float a = b->kernel.a[i], c = b->kernel.c[i], bb = b->kernel.b[i], det = a * c - bb * bb;
  const float reach2 = g->core2 * (c * u * u - 2 * bb * u * v + a * v * v) / det;
  const float scale = reach2 > 0 ? g->shape_blend / sqrtf(reach2) : 0;
  r->per_pixel[which][0] = u * scale, r->per_pixel[which][1] = v * scale;
}

/* False: the splat has the same normal at all pixels. */
V_INLINE bool is_round(const tc_splat_args *g, const batch *b, int i, const orientation *f, rounding *r) {
  const uint32_t splat = b->first + (uint32_t)i, word = b->entry->of->words[splat];
  const unsigned what = b->entry->of->insets[splat] >> 6;
  if (what == TC_SPLAT_SHEET || !(word >> 12 & word >> 13 & 0x15)) return false;
  for (int k = 0; k < 3; k++) r->front[k] = f->normal[k][i];
  memset(r->across, 0, sizeof r->across), memset(r->per_pixel, 0, sizeof r->per_pixel);
  if (what == TC_SPLAT_DOT) {
    memcpy(r->across[0], g->right, sizeof g->right), memcpy(r->across[1], g->down, sizeof g->down);
    set_per_pixel(g, b, i, r, 1);
  } else {
    for (int k = 0; k < 3; k++) {
      const int l = (k + 1) % 3, m = (k + 2) % 3;
      r->across[0][k] = f->line[l][i] * r->front[m] - f->line[m][i] * r->front[l];
    }
  }
  set_per_pixel(g, b, i, r, 0);
  return true;
}

/* The normal in 127ths at dx, dy pixels from the splat's centre. */
V_INLINE void round_normal(const rounding *r, vf dx, vf dy, vi of[3]) {
  const vf one = v_set(1), whole = v_set(12582912); /* 1.5 * 2^23: sums with it are whole */
  vf s = v_fma(dx, v_set(r->per_pixel[0][0]), dy * v_set(r->per_pixel[0][1])), t = v_fma(dx, v_set(r->per_pixel[1][0]), dy * v_set(r->per_pixel[1][1]));
  const vf square = v_fma(s, s, t * t), scale = one / v_sqrt(v_max(square, one));
  const vf ahead = v_sqrt(v_max(one - square, v_set(0)));
  s = s * scale, t = t * scale;
  for (int k = 0; k < 3; k++) {
    const vf n = v_fma(s, v_set(r->across[0][k]), v_fma(t, v_set(r->across[1][k]), ahead * v_set(r->front[k])));
    of[k] = v_trunc(n * v_set(127) + whole - whole);
  }
}
