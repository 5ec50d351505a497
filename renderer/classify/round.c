/* Rounds entries to a narrower format, to measure the error of smaller tables. */
#include <math.h>

#include "renderer/classify/preintegration.h"

float tc_table_round(float entry, int bits) {
  if (bits == 8) return rintf(entry * 255) / 255;
  if (bits != 16) return entry;
  int exponent;
  frexpf(entry, &exponent); /* entry = m * 2^exponent, 0.5 <= m < 1: a half float keeps 11 bits of m down to 2^-14 */
  float quantum = ldexpf(1, (exponent > -13 ? exponent : -13) - 11);
  return rintf(entry / quantum) * quantum;
}
