/* Several rays per pixel: where rays pass through their pixel and where their samples lie, the same for
 * every back end.
 *
 * Each of R rays takes samples R steps apart, starting at a different one of the R steps. Together they sample as
 * densely as one ray and cost no more, and because they pass through different points of the pixel, they also
 * antialias edges. Their colours and opacities are averaged. */
#ifndef TC_RAYCAST_SUBPIXEL_H
#define TC_RAYCAST_SUBPIXEL_H

typedef struct tc_subpixel {
  double x, y;  /* pixels from the pixel's centre, to the right and down; within -0.5 .. 0.5 */
  double phase; /* length of the ray's first segment as a share of a full one: above 0, at most 1 */
} tc_subpixel;

/* rays[count], count 1..64. A single ray passes through the centre. Several lie symmetrically about it, each in a
 * column of its own (n-rooks sampling), with rows by the golden ratio, which spreads them evenly in every direction.
 * Each of the phases 1/R .. 1 occurs once. */
void tc_subpixel_rays(int count, tc_subpixel *rays);

#endif
