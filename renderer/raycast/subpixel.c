#include "renderer/raycast/subpixel.h"

#include <math.h>

static double fraction(double x) { return x - floor(x); }

void tc_subpixel_rays(int count, tc_subpixel *rays) {
  const double golden = 0.61803398874989485, silver = 0.41421356237309505;
  for (int r = 0; r < count; r++) {
    rays[r].x = (r + 0.5) / count - 0.5;
    rays[r].y = count == 1 ? 0 : fraction(0.5 + (r - 0.5 * (count - 1)) * golden) - 0.5;
    int rank = 1; /* rank among the multiples of another irrational number: the phase correlates with neither x nor y */
    for (int other = 0; other < count; other++) rank += fraction(other * silver) < fraction(r * silver);
    rays[r].phase = (double)rank / count;
  }
}
