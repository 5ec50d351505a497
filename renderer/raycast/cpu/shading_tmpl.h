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

/* front, back: index gradients at the segment's ends. */
V_INLINE vf4 shade(const tc_shade *s, const lighting *l, const vf front[3], const vf back[3], vf4 c) {
  vf sum[3], n[3];
  for (int k = 0; k < 3; k++) sum[k] = front[k] + back[k];
  for (int r = 0; r < 3; r++) {
    const float *m = s->gradient[r];
    n[r] = v_fma(v_set(m[2]), sum[2], v_fma(v_set(m[1]), sum[1], v_set(m[0]) * sum[0]));
  }
  vf size = v_sqrt(dot(n, n)), inverse = v_set(1) / v_max(size, v_set(1e-18f));
  vf x = v_min(v_max((size - v_set(s->flat)) * v_set(s->inverse_steep), v_set(0)), v_set(1));
  vf w = x * x * (v_set(3) - x - x), facing = dot(n, l->eye) * inverse, lit = v_abs(facing), mirror = lit;
  if (!s->head_light) {
    vf towards = v_select(v_lt(facing, v_set(0)), v_set(0) - inverse, inverse);
    lit = towards * v_fma(n[2], v_set(s->light[2]), v_fma(n[1], v_set(s->light[1]), n[0] * v_set(s->light[0])));
    mirror = towards * dot(n, l->half);
  }
  vf glint = v_set(0), q = v_max(lit, v_set(s->least));
  if (s->specular > 0) {
    glint = v_set(s->specular) *
            exp2_approx(v_set(s->shininess) * log2_approx(v_min(v_max(mirror, v_set(1e-30f)), v_set(1))));
    glint = v_select(v_lt(v_set(0), lit), glint, v_set(0));
  }
  vf factor = v_fma(w, v_fma(v_set(s->factor[1]), q, v_set(s->factor[0])) - v_set(1), v_set(1));
  vf add = w * c.a, *channels[3] = {&c.r, &c.g, &c.b};
  for (int k = 0; k < 3; k++) {
    vf glow = v_fma(v_set(s->glow[1][k]), q, v_set(s->glow[0][k])) + glint;
    *channels[k] = v_min(v_max(v_fma(add, glow, *channels[k] * factor), v_set(0)), c.a);
  }
  return c;
}
