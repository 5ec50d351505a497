/* Shading of dvr and isosurfaces: the effect of gradient and light on a colour, the same for every back end.
 *
 * At each point of a ray the transfer function's colour L (compositing space) becomes, per channel c,
 *   shade(L) = min(1, L * (1 + w (F0 + F1 q - 1)) + w (specular * s + G0[c] + G1[c] q))
 * where
 *   g   gradient of the field in value units per mm: slope * to_index^T * (gradient over index coordinates), the
 *       transformation of a covector, correct for any spacing and for sheared axes;
 *   w   weight, 0 where the field is flat (noise has no surface, so L is kept) and 1 where it is steep: smooth step of
 *       |g| * smallest spacing / value range, from TC_SHADE_FLAT to TC_SHADE_STEEP;
 *   n   g / |g|, flipped towards the eye: surfaces are lit on the visible side, whichever side is dense (as in VTK),
 *       so that the sign of the slope does not matter either;
 *   l   unit direction to the light: to the eye (head light), or fixed in LPS;
 *   q   max(n.l, least), s = max(n.h, least_mirror)^shininess where n.l > 0, else 0; h halfway between l and the
 *       direction to the eye.
 * Models are numbers of this one form:
 *   Lambert, Blinn-Phong   F0 ambient, F1 diffuse, G 0, least 0; Lambert has no specular;
 *   Gooch                  from cool (n.l = -1) to warm (n.l = 1): F = mix(ambient, diffuse), G = mix(blue, yellow);
 *                          F0, F1 = (diffuse +- ambient) / 2 and G0, G1 = (yellow +- blue) / 2, least -1.
 *                          Gooch, Gooch, Shirley and Cohen, A non-photorealistic lighting model, SIGGRAPH 1998.
 *
 * A segment is shaded once. Gradient "cell" takes the mean of the gradients at the segment's two samples, from corners
 * that interpolation fetches anyway; other gradients are computed at the segment's middle. shade() is affine in L
 * before the clamp, so it applies to the premultiplied colour C and opacity a from the pre-integration table: C' =
 * min(a, C f + a e). As the step goes to 0 this converges to the integral of the shaded colour, and C' <= a holds for
 * each segment, hence for the picture. */
#ifndef TC_RAYCAST_SHADING_H
#define TC_RAYCAST_SHADING_H

#include "renderer/scene/scene.h"
#include "renderer/volume/volume.h"

#define TC_SHADE_FLAT 0.005 /* share of the value range per smallest spacing: no shading below this gradient */
#define TC_SHADE_STEEP 0.02 /* full shading above this gradient */
#define TC_SHADE_FAINT 1e6  /* isosurfaces: full shading from TC_SHADE_STEEP / TC_SHADE_FAINT on, starting at 0 */

/* In the layout of the structure Shade of head.glsl (std140). */
typedef struct tc_shade {
  float gradient[3][4]; /* rows give LPS x, y, z: from the sum of two samples' gradients (voxel units per index step) to
                           their mean as |g| * least spacing / (value range * TC_SHADE_STEEP); 0 for flat axes; [3] unused */
  float light[3];       /* unit, LPS; to the light */
  int32_t head_light;   /* bool */
  float glow[2][4];     /* G0, G1; [3] unused */
  float factor[2];      /* F0, F1 */
  float least;          /* of q */
  float flat;           /* TC_SHADE_FLAT in the gradient's unit: full weight is at 1 */
  float inverse_steep;  /* 1 / (1 - flat) */
  float specular, shininess;
  float least_mirror; /* 1e-30^(1/shininess), at least 1e-30: products stay above 1e-38. A smaller one is subnormal, and its
                         multiplication took 38 ns instead of 0.3 on an Intel Xeon with AVX-512 */
} tc_shade;

/* volume: the scene's, which gives the value range; field: the sampled volume (its B-spline coefficients, or itself).
 * The scene was validated (tc_plan_check), and shading.model is not none. Pure. */
void tc_shade_set_up(tc_shade *shade, const tc_volume *volume, const tc_volume *field, const tc_scene *scene);

#endif
