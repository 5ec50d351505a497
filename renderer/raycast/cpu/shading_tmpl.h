/* Shading of a segment (equations: raycast/shading.h). */

typedef struct lighting {
  vf eye[3], half[3]; /* unit vectors in LPS: to the eye, and halfway between it and a fixed light */
} lighting;

V_INLINE vf dot(const vf a[3], const vf b[3]) { return v_fma(a[2], b[2], v_fma(a[1], b[1], a[0] * b[0])); }

/* The light at pixel (i, j). direction0 + i direction_du + j direction_dv: direction of the pixel from the eye, LPS. */
V_INLINE lighting lighting_at(vf i, vf j, const float direction0[3], const float direction_du[3],
                              const float direction_dv[3], const float light[3]) {
  lighting l;
  for (int k = 0; k < 3; k++)
    l.eye[k] = v_set(0) - v_fma(j, v_set(direction_dv[k]), v_fma(i, v_set(direction_du[k]), v_set(direction0[k])));
  vf norm = v_sqrt(dot(l.eye, l.eye));
  for (int k = 0; k < 3; k++) {
    l.eye[k] = l.eye[k] / norm;
    l.half[k] = l.eye[k] + v_set(light[k]);
  }
  /* the halfway vector of a light exactly opposite the eye is 0: no highlight */
  norm = v_max(v_sqrt(dot(l.half, l.half)), v_set(1e-20f));
  for (int k = 0; k < 3; k++) l.half[k] = l.half[k] / norm;
  return l;
}

V_INLINE lighting start_lighting(const tc_cpu_args *args, variant v, const place *at) {
  vf i, j;
  ray_places(v, at, &i, &j);
  return lighting_at(i, j, args->rays.view0, args->rays.view_du, args->rays.view_dv, args->shade.light);
}

/* mirror^shininess. mirror: s->least_mirror..1. A whole exponent takes few multiplications. */
V_INLINE vf glint_of(const tc_shade *s, vf mirror) {
  const int whole = (int)s->shininess;
  if ((float)whole != s->shininess || whole >= 128) return exp2_approx(v_set(s->shininess) * log2_approx(mirror));
  vf glint = v_set(1);
  for (int left = whole; left; left >>= 1) {
    if (left & 1) glint = glint * mirror;
    if (left > 1) mirror = mirror * mirror; /* the square after the last factor could be subnormal */
  }
  return glint;
}

/* What a segment's gradient alone decides: how far it counts as a surface (0..1), and the cosines of the angles between its
 * normal and the light, and its normal and the halfway vector. */
typedef struct facet { vf steep, lit, mirror; } facet;

/* sum: of the index gradients at the segment's ends. */
V_INLINE facet facet_of(const tc_shade *s, const lighting *l, const vf sum[3]) {
  vf normal[3];
#pragma GCC unroll 3
  for (int r = 0; r < 3; r++) {
    const float *m = s->gradient[r];
    normal[r] = v_fma(v_set(m[2]), sum[2], v_fma(v_set(m[1]), sum[1], v_set(m[0]) * sum[0]));
  }
  const vf size = v_sqrt(dot(normal, normal)), inverse = v_set(1) / v_max(size, v_set(1e-18f));
  const vf x = v_min(v_max((size - v_set(s->flat)) * v_set(s->inverse_steep), v_set(0)), v_set(1));
  const vf facing = dot(normal, l->eye) * inverse;
  facet f = {x * x * (v_set(3) - x - x), v_abs(facing), v_abs(facing)};
  if (!s->head_light) {
    const vf light[3] = {v_set(s->light[0]), v_set(s->light[1]), v_set(s->light[2])};
    const vf towards = v_select(v_lt(facing, v_set(0)), v_set(0) - inverse, inverse);
    f.lit = towards * dot(normal, light);
    f.mirror = towards * dot(normal, l->half);
  }
  return f;
}

V_INLINE vf4 shade_facet(const tc_shade *s, const facet *f, vf4 c) {
  vf glint = v_set(0), q = v_max(f->lit, v_set(s->least));
  if (s->specular > 0) {
    glint = v_set(s->specular) * glint_of(s, v_min(v_max(f->mirror, v_set(s->least_mirror)), v_set(1)));
    glint = v_select(v_lt(v_set(0), f->lit), glint, v_set(0));
  }
  const vf factor = v_fma(f->steep, v_fma(v_set(s->factor[1]), q, v_set(s->factor[0])) - v_set(1), v_set(1));
  const vf add = f->steep * c.a;
#pragma GCC unroll 3
  for (int r = 0; r < 3; r++) {
    vf *channel = r == 0 ? &c.r : r == 1 ? &c.g : &c.b;
    vf glow = v_fma(v_set(s->glow[1][r]), q, v_set(s->glow[0][r])) + glint;
    *channel = v_min(v_max(v_fma(add, glow, *channel * factor), v_set(0)), c.a);
  }
  return c;
}

/* front, back: index gradients at the segment's ends. */
V_INLINE vf4 shade(const tc_shade *s, const lighting *l, const vf front[3], const vf back[3], vf4 c) {
  const vf sum[3] = {front[0] + back[0], front[1] + back[1], front[2] + back[2]};
  const facet f = facet_of(s, l, sum);
  return shade_facet(s, &f, c);
}
