/* The wire format: bytes <-> typed messages and scenes. No sockets, no pixels.
 *
 * Depends on renderer/scene/scene.h and renderer/base/error.h only. JSON values are cJSON; the caller owns every
 * returned cJSON *. All functions are pure and may run on any thread. */
#ifndef TC_PROTOCOL_H
#define TC_PROTOCOL_H

#include <cjson/cJSON.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "renderer/base/error.h"
#include "renderer/scene/scene.h"

/* Parses strict JSON of `size` bytes: one value, nesting depth at most 32, finite numbers, valid UTF-8, no duplicate
 * member names, no trailing text. TC_ERROR_SYNTAX gives line and column. Freed with cJSON_Delete(). */
cJSON *tcp_json_parse(const char *bytes, size_t size, GError **error);

/* Merge patch, RFC 7396. Changes *target in place (replaces it if patch is not an object). */
void tcp_merge_patch(cJSON **target, const cJSON *patch);

/* --- scenes ------------------------------------------------------------------------------------ */

/* Writes the full scene as JSON: every member of the contract (PROTOCOL.md) that has a meaning in this scene. */
cJSON *tcp_scene_write(const tc_scene *scene);
/* Writes the members needed to interpret the picture: mode, background, and those of camera or slice, window, preset
 * and isosurface that the mode uses. At most a few hundred bytes. */
cJSON *tcp_scene_write_shown(const tc_scene *scene);

/* Long lists of a document (knots, label colours, visible labels), parsed beforehand by a worker, so that applying the
 * document to a scene is fast. The lists refer to nodes of this document and are valid only for it. */
typedef struct tcp_lists {
  const cJSON *points, *colors, *visible; /* nodes of the document; NULL: not parsed */
  tc_scene scene;                         /* holds the parsed lists, shared; other members are 0 */
} tcp_lists;
/* *lists is uninitialised before. The errors are those of tcp_scene_patch(). Any thread. */
bool tcp_lists_read(const cJSON *document, tcp_lists *lists, GError **error);
void tcp_lists_clear(tcp_lists *lists);

/* The volume's properties that a document may depend on, in the volume's unit. */
typedef struct tcp_scene_context {
  double value_min, value_max;
  const tcp_lists *lists;
  const tc_stretch *stretch; /* how to fit presets to the volume; NULL: along value_min..value_max */
} tcp_scene_context;

/* Applies a merge patch (RFC 7396) to *scene: members in `patch` replace, null restores the value of `defaults`. A
 * patch with transferFunction.preset and no points takes the preset's points; one with points and no preset clears the
 * preset's name. Points are replaced as a whole; quality.maxError and maxMilliseconds exclude each other. Unknown
 * members, wrong types, values out of range, non-finite numbers, duplicates etc. are errors (TC_ERROR_INVALID, with a
 * JSON pointer (RFC 6901) into the patch and a message that says how to fix it); *scene is then unchanged. Unsorted
 * knots are sorted stably (equal values keep their order and make a jump). Also for whole documents (PUT, POST),
 * starting from a copy of the defaults. */
bool tcp_scene_patch(tc_scene *scene, const cJSON *patch, const tc_scene *defaults, const tcp_scene_context *context,
                     GError **error);

/* Adapts the defaults in *scene, which suit a first picture, to a document: a preset sets its own shading. A document
 * with its own points is unshaded, with the table shown and opacity per mm; a document with a mode also shows the
 * table. An isosurface is shaded unless the document sets shading.model none, since without light only its outline
 * shows. Call before tcp_scene_patch(), not for changes of a client's existing scene. */
void tcp_scene_light(tc_scene *scene, const cJSON *document);

/* Parses one "--set key=value": key is a dotted path ("camera.fovY"), value is JSON, or else a string. Returns a patch.
 */
cJSON *tcp_scene_set_expression(const char *expression, GError **error);

/* JSON Schema 2020-12 of a scene, from the table that drives the parser; and the OpenAPI 3.1 document. */
cJSON *tcp_scene_schema(void);
cJSON *tcp_openapi(const char *version);

/* {"transferFunctions":[...],"windows":[...]} */
cJSON *tcp_presets(void);

/* --- problems (RFC 9457) ------------------------------------------------------------------------ */

/* HTTP status for an error of any domain. */
int tcp_problem_status(const GError *error);
/* {"type","title","status","detail","pointer"?}; type is "urn:tomocast:problem:<code>", e.g. ...:unsupported. */
cJSON *tcp_problem(const GError *error);
/* A problem without a GError: `name` completes "urn:tomocast:problem:". */
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
/* *message is uninitialised before. On failure only `seq` is set, if it could be read. */
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
enum { TCP_MOST_SURFACES = 32, TCP_MOST_LAYERS = 4 };

typedef struct tcp_frame_header {
  uint64_t frame, seq;
  int width, height;
  const char *format; /* "jpeg" or "png" */
  int quality;
  bool final;
  int bridged; /* layer of the volume interpolated for a missing slice, from 1; 0: none */
  double queue_ms, tables_ms, render_ms, encode_ms;
  /* Result of the error meter, known when the picture is sent again. low, high: 95 % interval of rms. */
  bool has_error;
  double rms, low, high, max;
  int pixels;
  tcp_surface_error depth, surfaces[TCP_MOST_SURFACES]; /* of all surfaces; of each surface that rays hit */
  int n_surfaces;
  tcp_surface_error layers[TCP_MOST_LAYERS]; /* of the first surfaces along rays, in order */
  int n_layers;
  const char *volume;     /* id of the volume shown; or NULL */
  const char *unmeasured; /* why the requested meter cannot measure this picture; or NULL */
  const char *scene;      /* JSON text of tcp_scene_write_shown() of the scene shown; or NULL */
  uint64_t others;        /* changes of the scene by others so far; only with `scene` */
} tcp_frame_header;
/* {"rms","low","high","max","pixels"} of a header with an error; with surfaces also "depthRms","depthP99","depthMax",
 * "outline", and the same for each of "surfaces" and "layers". */
cJSON *tcp_measured_error(const tcp_frame_header *header);
/* 4-byte little-endian length and JSON text, g_malloc'ed, *size bytes; followed by the image on the wire. */
uint8_t *tcp_frame_header_write(const tcp_frame_header *header, size_t *size);

#endif
