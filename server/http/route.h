/* Matching of a method and a path against a table of routes. Pure. */
#ifndef TCS_HTTP_ROUTE_H
#define TCS_HTTP_ROUTE_H

#include <stdbool.h>
#include <stddef.h>

#include "server/access/role.h"

#define TCS_MAX_PARAMS 2
#define TCS_PARAM_SIZE 128

typedef struct tcs_request tcs_request;

/* Cost of a reply, which decides what is refused under load or during shutdown. */
typedef enum tcs_cost {
  TCS_COST_LOOKUP, /* a few microseconds on the I/O thread */
  TCS_COST_VOLUME, /* walks over voxels or folders, on a worker */
  TCS_COST_RENDER, /* waits for the renderer */
  TCS_COST_STREAM, /* stays open */
  TCS_COST_COUNT
} tcs_cost;

typedef enum tcs_body {
  TCS_BODY_NONE,  /* discarded */
  TCS_BODY_JSON,  /* application/json */
  TCS_BODY_PATCH, /* application/merge-patch+json or application/json */
  TCS_BODY_FILE,  /* any type, streamed to disk */
  TCS_BODY_COUNT
} tcs_body;

typedef struct tcs_route {
  const char *method;  /* "GET", which answers HEAD too, "POST" ... */
  const char *pattern; /* "/v1/volumes/{id}": a segment in braces matches one segment of any text */
  void (*handler)(tcs_request *request);
  tcs_cost cost;
  tcs_body body;
  tcs_role role; /* least role; TCS_ROLE_NONE: every caller, from any page */
} tcs_route;

typedef struct tcs_match {
  const tcs_route *route;                      /* NULL: no match */
  bool path_known;                             /* the path exists, with other methods */
  char allow[64];                              /* if path_known: the methods, as "GET, HEAD, PUT" */
  char params[TCS_MAX_PARAMS][TCS_PARAM_SIZE]; /* matched segments, in order; longer ones do not match */
} tcs_match;

/* `routes` ends with a NULL method. The first match wins. */
void tcs_route_match(const tcs_route *routes, const char *method, const char *path, tcs_match *match);

#endif
