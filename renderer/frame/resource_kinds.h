/* One row for each tc_resource: its key, how it is built, its size. A new resource is a new row and a new member of
 * tc_resource_set; resources.c and the frame loop know no kind by name. Private to resources.c. */
#ifndef TC_RENDERER_RESOURCE_KINDS_H
#define TC_RENDERER_RESOURCE_KINDS_H

#include "renderer/frame/backend.h"
#include "renderer/frame/store.h"

/* The inputs of a build. */
typedef struct tc_making {
  const tc_frame_job *job; /* job->have holds what the kind needs (below) */
  const void *like;        /* the most recently used resource of this kind for which is_like() is true, or NULL */
  tc_pool *pool;           /* with the halt */
  uint64_t budget;         /* bytes of all resources together */
} tc_making;

typedef struct tc_resource_kind {
  tc_store_kind store;
  uint32_t needs; /* bit set: 1 << tc_resource of those that must be built earlier, if in the plan */
  /* Appends every input of the build: resources with equal keys are equal. */
  void (*key)(const tc_frame_job *job, GByteArray *key);
  const tc_volume *(*tied)(const tc_frame_job *job); /* the resource is dropped with this volume; NULL: none */
  /* Builds the resource, or starts the build if there is a go_on(). NULL with *error set. */
  void *(*begin)(const tc_making *m, GError **error);
  /* Continues the build: true once complete. False with *error set; may be called again. NULL: begin() builds all. */
  bool (*go_on)(void *thing, const tc_making *m, GError **error);
  bool (*is_whole)(const void *thing, const tc_frame_job *job); /* NULL: complete once go_on() says so */
  void *(*finish)(void *thing);                   /* turns a complete build into the stored resource; NULL: unchanged */
  int64_t (*steps)(const void *thing);            /* progress of an unfinished build; NULL: built in one step */
  size_t (*unfinished_held)(const void *thing);   /* bytes an unfinished build has allocated; NULL: as held() */
  size_t (*grows)(const void *thing);             /* bytes that go_on() may allocate, reserved in advance; NULL:
                                                     unknown */
  bool (*is_like)(const void *thing, const void *job); /* true if a build can reuse parts of this one; NULL: never */
  size_t (*held)(const void *thing);              /* bytes allocated now; NULL: bytes() */
  size_t (*bytes)(const void *thing);             /* bytes that frames read */
  /* Refinement on a separate thread while frames read the resource, so that later frames are faster. NULL: none. */
  size_t (*refines)(const void *thing); /* bytes that refining may allocate; 0: nothing to refine, or already started */
  bool (*refine)(void *thing);          /* called between frames: starts it; a later call takes over the result: true */
  double (*empty_share)(const void *thing);       /* share of blocks that can be skipped; NULL: unknown */
} tc_resource_kind;

extern const tc_resource_kind tc_resource_kinds[TC_RESOURCE_COUNT];

#endif
