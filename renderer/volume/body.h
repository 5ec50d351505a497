/* Removes from a volume what lies around the body: tables, head rests, containers, padding. body_parts.h decides on a
 * coarse grid which parts to remove. */
#ifndef TC_BODY_H
#define TC_BODY_H

#include "renderer/volume/volume.h"

typedef struct tc_body_options {
  double soft;  /* smallest value of a table; <= dense */
  double dense; /* smallest value of the body */
  double most;  /* largest value of the body; larger values are padding and are removed everywhere */
  bool parts;   /* remove parts and padding; false: padding alone */
  bool strict;  /* values have no unit: remove parts only if a table is certain (volume/body_parts.h) */
  double air;   /* value of removed voxels */
  /* Called once per slice; false stops the work. NULL: never stops. */
  bool (*goes_on)(void *user);
  /* Reserves bytes before the result is allocated; false: refused. NULL: unbounded. */
  bool (*reserve)(void *user, uint64_t bytes);
  void *user;
} tc_body_options;

/* A new sealed volume, cropped to the body: removed voxels have the value of air, all others keep theirs, and the value
 * range is that of `volume`. The caller unrefs. NULL: nothing to remove, stopped, or out of memory. Needs 8 bytes per
 * cell of the coarse grid temporarily. Any thread. */
tc_volume *tc_body_of(const tc_volume *volume, const tc_body_options *options);

#endif
