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

/* mirror^shininess. mirror: 0..1. A whole exponent takes few multiplications. */
V_INLINE void glints(const tc_shade *s, int n, const vf mirror[], vf glint[]) {
  const int whole = (int)s->shininess;
  if ((float)whole == s->shininess && whole < 128) {
    vf x[2];
    for (int k = 0; k < n; k++) x[k] = mirror[k], glint[k] = v_set(1);
    for (int left = whole; left; left >>= 1) {
      for (int k = 0; k < n; k++) {
        if (left & 1) glint[k] = glint[k] * x[k];
        x[k] = x[k] * x[k];
      }
    }
    return;
  }
  for (int k = 0; k < n; k++)
    glint[k] = exp2_approx(v_set(s->shininess) * log2_approx(v_max(mirror[k], v_set(1e-30f))));
}

/* Shades n <= 2 colours, operation by operation, because one is a chain of dependent operations that leaves the processor
 * idle. sum: of the index gradients at the segment's ends. */
V_INLINE void shade_all(const tc_shade *s, const lighting *l, int n, vf sum[][3], vf4 c[]) {
#define EACH _Pragma("GCC unroll 2") for (int k = 0; k < n; k++)
  vf normal[2][3], size[2], inverse[2], x[2], w[2], facing[2], lit[2], mirror[2], glint[2], q[2], factor[2], add[2];
#pragma GCC unroll 3
  for (int r = 0; r < 3; r++) {
    const float *m = s->gradient[r];
    EACH normal[k][r] = v_fma(v_set(m[2]), sum[k][2], v_fma(v_set(m[1]), sum[k][1], v_set(m[0]) * sum[k][0]));
  }
  EACH size[k] = v_sqrt(dot(normal[k], normal[k]));
  EACH inverse[k] = v_set(1) / v_max(size[k], v_set(1e-18f));
  EACH x[k] = v_min(v_max((size[k] - v_set(s->flat)) * v_set(s->inverse_steep), v_set(0)), v_set(1));
  EACH w[k] = x[k] * x[k] * (v_set(3) - x[k] - x[k]);
  EACH facing[k] = dot(normal[k], l->eye) * inverse[k];
  EACH lit[k] = v_abs(facing[k]), mirror[k] = lit[k];
  if (!s->head_light) {
    const vf light[3] = {v_set(s->light[0]), v_set(s->light[1]), v_set(s->light[2])};
    EACH {
      vf towards = v_select(v_lt(facing[k], v_set(0)), v_set(0) - inverse[k], inverse[k]);
      lit[k] = towards * dot(normal[k], light);
      mirror[k] = towards * dot(normal[k], l->half);
    }
  }
  EACH glint[k] = v_set(0), q[k] = v_max(lit[k], v_set(s->least));
  if (s->specular > 0) {
    EACH mirror[k] = v_min(v_max(mirror[k], v_set(0)), v_set(1));
    glints(s, n, mirror, glint);
    EACH glint[k] = v_select(v_lt(v_set(0), lit[k]), v_set(s->specular) * glint[k], v_set(0));
  }
  EACH factor[k] = v_fma(w[k], v_fma(v_set(s->factor[1]), q[k], v_set(s->factor[0])) - v_set(1), v_set(1));
  EACH add[k] = w[k] * c[k].a;
#pragma GCC unroll 3
  for (int r = 0; r < 3; r++) {
    EACH {
      vf *channel = r == 0 ? &c[k].r : r == 1 ? &c[k].g : &c[k].b;
      vf glow = v_fma(v_set(s->glow[1][r]), q[k], v_set(s->glow[0][r])) + glint[k];
      *channel = v_min(v_max(v_fma(add[k], glow, *channel * factor[k]), v_set(0)), c[k].a);
    }
  }
#undef EACH
}

/* front, back: index gradients at the segment's ends. */
V_INLINE vf4 shade(const tc_shade *s, const lighting *l, const vf front[3], const vf back[3], vf4 c) {
  vf sum[1][3] = {{front[0] + back[0], front[1] + back[1], front[2] + back[2]}};
  shade_all(s, l, 1, sum, &c);
  return c;
}
