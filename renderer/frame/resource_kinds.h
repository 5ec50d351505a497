/* One row for each tc_resource: what it is made from, how it is built, what it takes. A new resource is a new row, and
 * its place in tc_resource_set; resources.c and the frame loop know no kind by name. Private to resources.c. */
#ifndef TC_RENDERER_RESOURCE_KINDS_H
#define TC_RENDERER_RESOURCE_KINDS_H

#include "renderer/frame/backend.h"
#include "renderer/frame/store.h"

/* What something is built with. */
typedef struct tc_making {
  const tc_frame_job *job;   /* with what it needs (below) */
  const void *like;    /* one of the same kind that is_like() this one, in use last; or NULL */
  tc_pool *pool;       /* and its halt */
  uint64_t budget;     /* bytes of all resources together */
} tc_making;

typedef struct tc_resource_kind {
  tc_store_kind store;
  uint32_t needs; /* 1 << tc_resource of what job->have must hold of the plan's */
  /* Adds all bytes that a thing depends on. Things of equal keys are the same. */
  void (*key)(const tc_frame_job *job, GByteArray *key);
  const tc_volume *(*tied)(const tc_frame_job *job); /* is dropped with this volume; NULL: with none */
  /* Makes it, or begins it where there is go_on(). NULL with *error set. */
  void *(*begin)(const tc_making *m, GError **error);
  /* Goes on until it is whole: true. False with *error set; it may be called again. NULL: begin() makes all of it. */
  bool (*go_on)(void *thing, const tc_making *m, GError **error);
  bool (*is_whole)(const void *thing, const tc_frame_job *job); /* NULL: once go_on() said so */
  void *(*finish)(void *thing);                           /* of a whole one, what is kept instead; NULL: itself */
  int64_t (*steps)(const void *thing);                    /* grows while it is in the making; NULL: in one step */
  size_t (*starts_with)(const tc_frame_job *job);               /* memory it takes when it is begun; NULL: held() */
  size_t (*grows)(const void *thing);                     /* bytes that going on will take, asked for before; NULL: none */
  bool (*is_like)(const void *thing, const void *job);    /* NULL: none is */
  size_t (*held)(const void *thing);                      /* memory it takes now; NULL: bytes() */
  size_t (*bytes)(const void *thing);                     /* memory of what frames read of it */
  /* What is made of a whole one on a thread beside, while frames read it, so that others are quicker. NULL: nothing. */
  size_t (*refines)(const void *thing); /* bytes that this may take; 0: nothing to be done, or it was begun */
  bool (*refine)(void *thing);          /* nobody reads it now: begins; then true where it is done and taken over */
  double (*empty_share)(const void *thing);               /* of the blocks that can be skipped; NULL: says nothing of it */
} tc_resource_kind;

extern const tc_resource_kind tc_resource_kinds[TC_RESOURCE_COUNT];

#endif
