/* Internals of protocol/: the table of scene members, and the readers and writers driven by it. */
#ifndef TC_PROTOCOL_INTERNAL_H
#define TC_PROTOCOL_INTERNAL_H

#include "protocol/protocol.h"

typedef struct tcp_member tcp_member;
typedef struct tcp_reader tcp_reader;

typedef enum tcp_kind {
  TCP_NUMBER,  /* double */
  TCP_INTEGER, /* int */
  TCP_BOOLEAN, /* bool */
  TCP_NAME,    /* enum, written as one of `names` */
  TCP_VECTOR,  /* double[count] */
  TCP_TEXT,    /* char[count], NUL-terminated */
  TCP_SPECIAL, /* has its own read and write functions (tcp_special) */
  TCP_KIND_COUNT
} tcp_kind;

typedef enum tcp_flag {
  TCP_ABOVE = 1,  /* min is excluded */
  TCP_BELOW = 2,  /* max is excluded */
  TCP_LIMIT = 4,  /* above max is over a limit (413) instead of invalid (422) */
  TCP_FITTED = 8, /* the default is fitted to the volume */
  TCP_ASKED = 16  /* not written if 0 or "", which mean "not set" */
} tcp_flag;

/* Functions of a special member. */
typedef struct tcp_special {
  bool (*read)(tcp_reader *reader, const tcp_member *member, const cJSON *value);
  cJSON *(*write)(const tcp_member *member, const tc_scene *scene); /* NULL: the member has no meaning now */
  void (*reset)(tcp_reader *reader, const tcp_member *member);      /* restores the default */
  cJSON *(*schema)(const tcp_member *member);
} tcp_special;

/* One member of a scene. The source of parser, writer, JSON Schema and documentation. */
struct tcp_member {
  const char *group; /* "camera"; "" for a member of the scene itself */
  const char *name;
  tcp_kind kind;
  size_t offset; /* in tc_scene (members of a knot: in tc_knot) */
  int count;
  double min, max; /* TCP_NUMBER, TCP_INTEGER, each of TCP_VECTOR */
  unsigned flags;
  const char *const *names; /* NULL ends it; index = enum value */
  const tcp_special *special;
  const char *unit; /* or NULL */
  const char *doc;
};

typedef struct tcp_group {
  const char *name, *doc;
} tcp_group;

/* In the order of reading and writing; the members of a group are adjacent. */
extern const tcp_member tcp_members[];
extern const size_t tcp_member_count;
extern const tcp_group tcp_groups[];
extern const size_t tcp_group_count;

/* Bound on values (not of a volume), so that float arithmetic on them cannot overflow. */
#define TCP_MAX_VALUE 1e30
#define TCP_MAX_COORDINATE 1e9
#define TCP_MAX_LABELS 65536

/* State while a patch is read into `scene`. */
struct tcp_reader {
  tc_scene *scene;
  const tc_scene *defaults;
  const tcp_lists *lists;      /* or NULL */
  double value_min, value_max; /* range for relative presets, unless `stretch` is given */
  const tc_stretch *stretch;   /* how to fit presets; or NULL */
  GString *pointer;            /* JSON pointer (RFC 6901) of the current member */
  GError **error;
  bool preset_given, max_error_given;
};

/* --- reader.c: position and errors ---------------------------------------------------------------- */

/* Appends "/name" (escaped) to the pointer; returns the mark for tcp_leave(). */
size_t tcp_enter(tcp_reader *reader, const char *name);
size_t tcp_enter_index(tcp_reader *reader, int index);
void tcp_leave(tcp_reader *reader, size_t mark);

/* Sets an error at the current member, with its dotted path before the message. Returns false. */
bool tcp_fail(tcp_reader *reader, tc_error_code code, const char *format, ...) G_GNUC_PRINTF(3, 4);
/* Like tcp_fail() at a given pointer; "" is the whole document. */
bool tcp_fail_at(GError **error, tc_error_code code, const char *pointer, const char *format, ...) G_GNUC_PRINTF(4, 5);
/* Error "<what> is wanted, not <kind of value>". */
bool tcp_fail_type(tcp_reader *reader, const char *what, const cJSON *value);

/* Client text for a one-line message: shortened, printable. Caller frees with g_free(). */
char *tcp_quote(const char *text);

/* The candidate (NULL-ended list) most similar to `name`; NULL: none is similar. */
const char *tcp_nearest(const char *name, const char *const *candidates);
/* `; did you mean "x"?` or `; known: a, b, c`. Caller frees with g_free(). */
char *tcp_hint(const char *name, const char *const *candidates);

/* --- leaf.c: plain values ------------------------------------------------------------------------- */

/* Parses value into the field at `base` + member->offset. Not for TCP_SPECIAL. */
bool tcp_leaf_read(tcp_reader *reader, const tcp_member *member, void *base, const cJSON *value);
cJSON *tcp_leaf_write(const tcp_member *member, const void *base);
void tcp_leaf_copy(const tcp_member *member, void *to, const void *from);
bool tcp_number_read(tcp_reader *reader, const tcp_member *member, const cJSON *value, double *number);
/* Parses `count` numbers, each within the member's range. */
bool tcp_vector_read(tcp_reader *reader, const tcp_member *member, const cJSON *value, int count, double *numbers);
cJSON *tcp_vector_write(const double *numbers, int count);
/* Parses an object that is a row of a list into the fields at `base`; sets a bit in *seen for each member found. */
bool tcp_row_read(tcp_reader *reader, const tcp_member *members, int count, const cJSON *object, void *base,
                  unsigned *seen);
/* JSON Schema of such a row, with the members whose bits are set in `those`. */
cJSON *tcp_row_schema(const tcp_member *members, int count, unsigned those, unsigned required);

/* --- special members ------------------------------------------------------------------------------ */

extern const tcp_special tcp_special_background, tcp_special_light, tcp_special_box, tcp_special_planes,
    tcp_special_mpr_center, tcp_special_quality, tcp_special_label_colors, tcp_special_visible, tcp_special_preset,
    tcp_special_points, tcp_special_force, tcp_special_surfaces, tcp_special_lights;

/* Members of a knot: value, color, opacity, extinction. */
extern const tcp_member tcp_knot_members[4];
/* Members of a surface: value, label, mesh, plane (exactly one of these four), color, opacity, visible, twoSided,
 * model, ambient, diffuse, specular, shininess. */
extern const tcp_member tcp_surface_members[13];
extern const tcp_member tcp_light_members[3]; /* direction, color, intensity */

/* Checks the constraints between members of a complete scene; `patch` decides which member to blame. */
bool tcp_scene_check(const tc_scene *scene, const cJSON *patch, GError **error);

/* --- schema.c ------------------------------------------------------------------------------------- */

/* JSON Schema of a plain member. */
cJSON *tcp_leaf_schema(const tcp_member *member);
/* {"type":"array","items":items,"minItems":min,"maxItems":max}; takes items. */
cJSON *tcp_array_schema(cJSON *items, int min, int max);
cJSON *tcp_range_schema(const tcp_member *member, const char *type);
/* Adds a constant name without copying it; deletes `value` when it cannot be added. */
void tcp_add(cJSON *object, const char *constant_name, cJSON *value);

#endif
