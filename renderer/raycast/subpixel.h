/* Several rays per pixel: their positions in the pixel and the phases of their samples, the same for every back end.
 *
 * The samples of each of R rays are R steps apart, and each ray starts at a different one of R phases. Together they
 * sample as densely as one ray at the same cost, and because they pass through different points of the pixel, they also
 * antialias edges. Their colours and opacities are averaged. */
#ifndef TC_RAYCAST_SUBPIXEL_H
#define TC_RAYCAST_SUBPIXEL_H

typedef struct tc_subpixel {
  double x, y;  /* pixels from the pixel's centre, to the right and down; within -0.5 .. 0.5 */
  double phase; /* length of the ray's first segment as a share of a full one: above 0, at most 1 */
} tc_subpixel;

/* Fills rays[count], count 1..64. A single ray passes through the centre. Several are symmetric about the centre, each
 * in a different column (n-rooks sampling), with rows by the golden ratio, which spreads them evenly in every
 * direction. Each of the phases 1/R .. 1 occurs once. */
void tc_subpixel_rays(int count, tc_subpixel *rays);

#endif
