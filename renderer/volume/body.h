/* The body in a volume without what lies around it: tables, head rests, containers, padding. Which parts go is decided
 * on a coarse grid (body_parts.h). */
#ifndef TC_BODY_H
#define TC_BODY_H

#include "renderer/volume/volume.h"

typedef struct tc_body_options {
  double soft;  /* tables may begin here; no more than ... */
  double dense; /* values from here on are dense, as a body is ... */
  double most;  /* ... up to here; more is padding, which is left out wherever it is */
  bool parts;   /* leave out parts; else padding alone */
  bool strict;  /* values have no unit: a table has to be sure (volume/body_parts.h) */
  double air;   /* what stands in the place of what is left out */
  /* Asked once a slice: false = stop. NULL: goes on. */
  bool (*goes_on)(void *user);
  /* Asked before voxels are allocated: false = not so many. NULL: takes them. */
  bool (*reserve)(void *user, uint64_t bytes);
  void *user;
} tc_body_options;

/* A new volume, sealed, as large as what is left needs, of the same values elsewhere and with the range of `volume`.
 * NULL: nothing is left out, or it was stopped, or there is no memory. Beside the result it takes 8 bytes for each of
 * the coarse grid's cells for a while. Any thread. */
tc_volume *tc_body_of(const tc_volume *volume, const tc_body_options *options);

#endif
