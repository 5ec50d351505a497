/* Shading of a segment (equations: raycast/shade.h). */

typedef struct lighting {
  vf eye[3], half[3]; /* unit vectors in LPS: to the eye, and halfway between it and a fixed light */
} lighting;

V_INLINE vf dot(const vf a[3], const vf b[3]) { return v_fma(a[2], b[2], v_fma(a[1], b[1], a[0] * b[0])); }

V_INLINE lighting start_lighting(const tc_cpu_args *args, variant v, const place *at) {
  lighting l;
  vf i, j;
  ray_places(v, at, &i, &j);
  for (int k = 0; k < 3; k++)
    l.eye[k] = v_set(0) - v_fma(j, v_set(args->rays.view_dv[k]), v_fma(i, v_set(args->rays.view_du[k]), v_set(args->rays.view0[k])));
  vf norm = v_sqrt(dot(l.eye, l.eye));
  for (int k = 0; k < 3; k++) {
    l.eye[k] = l.eye[k] / norm;
    l.half[k] = l.eye[k] + v_set(args->shade.light[k]);
  }
  /* the halfway vector of a light straight behind is 0: no highlight */
  norm = v_max(v_sqrt(dot(l.half, l.half)), v_set(1e-20f));
  for (int k = 0; k < 3; k++) l.half[k] = l.half[k] / norm;
  return l;
}

/* front, back: index gradients at the segment's ends. */
V_INLINE vf4 shade(const tc_cpu_args *args, const lighting *l, const vf front[3], const vf back[3], vf4 c) {
  vf sum[3], n[3];
  for (int k = 0; k < 3; k++) sum[k] = front[k] + back[k];
  for (int r = 0; r < 3; r++) {
    const float *m = args->shade.gradient[r];
    n[r] = v_fma(v_set(m[2]), sum[2], v_fma(v_set(m[1]), sum[1], v_set(m[0]) * sum[0]));
  }
  vf size = v_sqrt(dot(n, n)), inverse = v_set(1) / v_max(size, v_set(1e-18f));
  vf x = v_min(v_max((size - v_set(args->shade.flat)) * v_set(args->shade.inverse_steep), v_set(0)), v_set(1));
  vf w = x * x * (v_set(3) - x - x), facing = dot(n, l->eye) * inverse, lit = v_abs(facing), mirror = lit;
  if (!args->shade.head_light) {
    vf towards = v_select(v_lt(facing, v_set(0)), v_set(0) - inverse, inverse);
    lit = towards * v_fma(n[2], v_set(args->shade.light[2]), v_fma(n[1], v_set(args->shade.light[1]), n[0] * v_set(args->shade.light[0])));
    mirror = towards * dot(n, l->half);
  }
  vf glint = v_set(0), q = v_max(lit, v_set(args->shade.least));
  if (args->shade.specular > 0) {
    glint = v_set(args->shade.specular) *
            exp2_approx(v_set(args->shade.shininess) * log2_approx(v_min(v_max(mirror, v_set(1e-30f)), v_set(1))));
    glint = v_select(v_lt(v_set(0), lit), glint, v_set(0));
  }
  vf factor = v_fma(w, v_fma(v_set(args->shade.factor[1]), q, v_set(args->shade.factor[0])) - v_set(1), v_set(1));
  vf add = w * c.a, *channels[3] = {&c.r, &c.g, &c.b};
  for (int k = 0; k < 3; k++) {
    vf glow = v_fma(v_set(args->shade.glow[1][k]), q, v_set(args->shade.glow[0][k])) + glint;
    *channels[k] = v_min(v_max(v_fma(add, glow, *channels[k] * factor), v_set(0)), c.a);
  }
  return c;
}
