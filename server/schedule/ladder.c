#include "server/schedule/ladder.h"

#include <stdbool.h>

static const double rungs[] = {1.0, 0.75, 0.5, 0.35, 0.25};
#define N_RUNGS ((int)(sizeof rungs / sizeof rungs[0]))

/* A step up must leave this much of the target unused, or the next noisy frame steps down again. */
#define UP_MARGIN 0.8
/* Weight of a new measurement: a frame that is slower than thought counts at once in full, because a late frame hurts
 * at once; a faster one is believed gradually. */
#define FASTER_WEIGHT 0.3

void tcs_ladder_measure(tcs_ladder *ladder, double pixels, double render_ms) {
  if (!(pixels > 0) || !(render_ms >= 0)) return;
  const double now = render_ms / pixels;
  if (ladder->ms_per_pixel <= 0 || now > ladder->ms_per_pixel)
    ladder->ms_per_pixel = now;
  else
    ladder->ms_per_pixel += FASTER_WEIGHT * (now - ladder->ms_per_pixel);
}

double tcs_ladder_scale(tcs_ladder *ladder, double full_pixels, double target_ms) {
  int fits = N_RUNGS - 1;
  for (int i = 0; i < N_RUNGS; i++) {
    const double ms = ladder->ms_per_pixel * full_pixels * rungs[i] * rungs[i];
    const bool up = i < ladder->rung;
    if (ms <= target_ms * (up ? UP_MARGIN : 1.0)) {
      fits = i;
      break;
    }
  }
  ladder->rung = fits;
  return rungs[fits];
}
