/* The wire: bytes <-> typed messages and scenes. No sockets, no pixels.
 *
 * Of the renderer it knows renderer/scene/scene.h and renderer/base/error.h only. JSON values are cJSON; a function
 * that returns cJSON * gives ownership. All functions are pure and may run on any thread. */
#ifndef TC_PROTOCOL_H
#define TC_PROTOCOL_H

#include <cjson/cJSON.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "renderer/base/error.h"
#include "renderer/scene/scene.h"

/* Parses strict JSON of `size` bytes: one value, nesting at most 32, finite numbers, valid UTF-8, no duplicate member
 * names, nothing after it. TC_ERROR_SYNTAX says line and column. */
cJSON *tcp_json_parse(const char *bytes, size_t size, GError **error);

/* RFC 7396. Changes *target in place (it may be replaced by another value when patch is not an object). */
void tcp_merge_patch(cJSON **target, const cJSON *patch);

/* --- scenes ------------------------------------------------------------------------------------ */

/* The full scene as its JSON document (every member of the contract (PROTOCOL.md) that has a meaning now). */
cJSON *tcp_scene_write(const tc_scene *scene);
/* The members of the scene that a reader of the picture must know: mode, background, and those of camera or slice,
 * window, preset and isosurface that the mode uses. At most a few hundred bytes. */
cJSON *tcp_scene_write_shown(const tc_scene *scene);

/* Long lists of a document (knots, label colours, visible labels), read beforehand by a worker, so that applying the
 * document to a scene takes no time. The lists refer to nodes of this document and are valid for no other. */
typedef struct tcp_lists {
  const cJSON *points, *colors, *visible; /* the nodes; NULL: not read */
  tc_scene scene;                         /* holds what was read, shared; else zeros */
} tcp_lists;
/* *lists holds nothing before. The errors are those that tcp_scene_patch() would have. Any thread. */
bool tcp_lists_read(const cJSON *document, tcp_lists *lists, GError **error);
void tcp_lists_clear(tcp_lists *lists);

/* What a document may need to know of the volume it is for, in the volume's unit; lists: of this document, or NULL. */
typedef struct tcp_scene_context {
  double value_min, value_max;
  const tcp_lists *lists;
  const tc_stretch *stretch; /* how presets are fitted to it; NULL: along value_min..value_max */
} tcp_scene_context;

/* Merge patch (RFC 7396) onto *scene: members in `patch` replace, null returns a member to what `defaults` holds. A
 * patch with transferFunction.preset and no points takes the preset's points; one with points and no preset clears the
 * preset's name; points replace points whole; quality.maxError and maxMilliseconds exclude each other. Unknown members,
 * wrong types, values out of range, non-finite numbers, unsorted/duplicate rules etc. are errors (TC_ERROR_INVALID,
 * with an RFC 6901 pointer into the patch and a message that names the mend); *scene is then unchanged. Unsorted knots
 * are sorted stably (equal values keep their order: a jump). Also used for whole documents (PUT, POST): start from a
 * copy of the defaults. */
bool tcp_scene_patch(tc_scene *scene, const cJSON *patch, const tc_scene *defaults, const tcp_scene_context *context,
                     GError **error);

/* Adapts the defaults in *scene, which suit a first picture, to a document: a preset brings its own shading; a
 * document's own points are unshaded, with the table shown and opacity per mm; a document with a mode shows the table
 * too. An isosurface is shaded unless the document says shading.model none, since without light only its outline shows.
 * Call it before tcp_scene_patch(); not for a change of a client's own scene. */
void tcp_scene_light(tc_scene *scene, const cJSON *document);

/* One "--set key=value": key is a dotted path ("camera.fovY"), value is JSON or, failing that, a string. Gives a
 * patch. */
cJSON *tcp_scene_set_expression(const char *expression, GError **error);

/* JSON Schema 2020-12 of a scene, made from the same table the parser uses; and the OpenAPI 3.1 document. */
cJSON *tcp_scene_schema(void);
cJSON *tcp_openapi(const char *version);

/* {"transferFunctions":[...],"windows":[...]} */
cJSON *tcp_presets(void);

/* --- problems (RFC 9457) ------------------------------------------------------------------------ */

/* HTTP status of an error of any domain. */
int tcp_problem_status(const GError *error);
/* {"type","title","status","detail","pointer"?}; type is "urn:tomocast:problem:<code>", e.g. ...:unsupported. */
cJSON *tcp_problem(const GError *error);
/* A problem that is no GError: `name` completes "urn:tomocast:problem:". */
cJSON *tcp_problem_named(int status, const char *name, const char *title, const char *detail);

/* --- WebSocket tomocast.v1 --------------------------------------------------------------------- */

typedef enum tcp_message_type {
  TCP_PATCH,
  TCP_ACK,
  TCP_POINTER,
  TCP_PING,
  TCP_SIZE,
  TCP_CANCEL,
  TCP_MESSAGE_TYPE_COUNT
} tcp_message_type;
typedef struct tcp_message {
  tcp_message_type type;
  uint64_t seq;      /* patch */
  cJSON *scene;      /* patch: the merge patch; owned */
  uint64_t frame;    /* ack */
  bool pointer_down; /* pointer: "start" = true */
  double t;          /* ping */
  int width, height; /* size: 1..TC_MAX_IMAGE_SIDE pixels */
} tcp_message;
/* *message is uninitialised. On failure only `seq` is set, where it could be read. */
bool tcp_message_parse(const char *bytes, size_t size, tcp_message *message, GError **error);
void tcp_message_clear(tcp_message *message);

/* How far surfaces of a picture are off. */
typedef struct tcp_surface_error {
  int surface;         /* number in mesh.surfaces; of all of them, or without such a list, -1 */
  uint32_t label;      /* 0: of no label */
  int both, one;       /* pixels with the surface in picture and reference, and in one of them only */
  double rms, p99, max; /* mm of depth, where both have it */
  double outline;      /* `one` as a share of the pixels measured */
} tcp_surface_error;
enum { TCP_MOST_SURFACES = 32 };

typedef struct tcp_frame_header {
  uint64_t frame, seq;
  int width, height;
  const char *format; /* "jpeg" or "png" */
  int quality;
  bool final;
  int bridged; /* the layer of the volume that stands for a missing slice, from 1; 0: none */
  double queue_ms, tables_ms, render_ms, encode_ms;
  /* What the error meter found of this picture: known when it is sent again. low, high: 95 % interval of rms. */
  bool has_error;
  double rms, low, high, max;
  int pixels;
  tcp_surface_error depth, surfaces[TCP_MOST_SURFACES]; /* of all surfaces; of each that was met */
  int n_surfaces;
  const char *volume;     /* id of the volume it shows; NULL */
  const char *unmeasured; /* why the meter that was asked for cannot measure this picture; NULL */
  const char *scene;      /* JSON text of tcp_scene_write_shown() of the scene it shows; NULL */
  uint64_t others;        /* changes of the scene so far that were not the viewer's; with `scene` */
} tcp_frame_header;
/* {"rms","low","high","max","pixels"} of a header that has an error, and of surfaces "depthRms","depthP99","depthMax",
 * "outline" and for each of "surfaces" the same. */
cJSON *tcp_measured_error(const tcp_frame_header *header);
/* 4-byte little-endian length + JSON text; g_malloc'ed, *size bytes; the image bytes follow it on the wire. */
uint8_t *tcp_frame_header_write(const tcp_frame_header *header, size_t *size);

#endif
