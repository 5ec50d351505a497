/* PLY, ASCII and binary of either byte order: vertices (x y z, nx ny nz, red green blue) and faces; all other
 * elements and properties are skipped. */
#include <string.h>

#include "renderer/import/helper/build.h"
#include "renderer/import/helper/format.h"
#include "renderer/import/helper/stream.h"
#include "renderer/import/reader.h"

enum { MOST_ELEMENTS = 64, MOST_PROPERTIES = 256, MOST_LIST = 65536 };

/* Meaning of a property for the mesh. */
typedef enum role { NOTHING, X, Y, Z, NX, NY, NZ, RED, GREEN, BLUE, CORNERS, ROLES } role;

typedef struct property {
  bool list;
  tc_element type, count; /* count: type of a list's length */
  role role;
} property;

typedef struct element {
  bool vertices, faces;
  uint64_t n;
  GArray *properties;
} element;

typedef struct ply {
  tc_stream stream;
  tc_build build;
  bool ascii, big;
  GArray *elements;
  double of[ROLES]; /* values of the last row */
  GArray *corners;       /* uint32_t, of the last row; valid vertex indices */
  bool has_normals, has_colors;
  double brightest[3]; /* value of a colour's type that means 1 */
} ply;

/* ---- header ---- */

static bool bad(const ply *p, GError **error, const char *what) {
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "header line %zu: %s", p->stream.line, what);
  return false;
}

static bool type_of(const char *name, tc_element *type) {
  static const struct {
    const char *names;
    tc_element type;
  } types[] = {{"char int8", TC_ELEMENT_I8},     {"uchar uint8", TC_ELEMENT_U8},    {"short int16", TC_ELEMENT_I16},
               {"ushort uint16", TC_ELEMENT_U16}, {"int int32", TC_ELEMENT_I32},     {"uint uint32", TC_ELEMENT_U32},
               {"float float32", TC_ELEMENT_F32}, {"double float64", TC_ELEMENT_F64}};
  for (size_t i = 0; i < G_N_ELEMENTS(types); i++) {
    const char *short_name = types[i].names, *long_name = strchr(short_name, ' ') + 1;
    *type = types[i].type;
    if (strcmp(name, long_name) == 0) return true;
    if (*name && strlen(name) == (size_t)(long_name - short_name) - 1 && g_str_has_prefix(short_name, name)) return true;
  }
  return false;
}

static role role_of(const element *e, const char *name, bool list) {
  static const char *const names[] = {[X] = "x", [Y] = "y", [Z] = "z", [NX] = "nx", [NY] = "ny", [NZ] = "nz",
                                      [RED] = "red", [GREEN] = "green", [BLUE] = "blue"};
  if (list) return e->faces && (!strcmp(name, "vertex_indices") || !strcmp(name, "vertex_index")) ? CORNERS : NOTHING;
  if (g_str_has_prefix(name, "diffuse_")) name += strlen("diffuse_"); /* early writers' colours */
  for (role r = X; e->vertices && r <= BLUE; r++)
    if (strcmp(name, names[r]) == 0) return r;
  return NOTHING;
}

static bool read_format(ply *p, char *line, GError **error) {
  const char *name = tc_line_word(&line), *version = tc_line_word(&line);
  p->ascii = strcmp(name, "ascii") == 0;
  p->big = strcmp(name, "binary_big_endian") == 0;
  if (strcmp(version, "1.0") == 0 && (p->ascii || p->big || strcmp(name, "binary_little_endian") == 0)) return true;
  return bad(p, error, "format: ascii, binary_little_endian or binary_big_endian 1.0 expected");
}

static void clear_element(void *item) { g_array_unref(((element *)item)->properties); }

static bool read_element(ply *p, char *line, GError **error) {
  const char *name = tc_line_word(&line), *number = tc_line_word(&line);
  int64_t n;
  if (p->elements->len == MOST_ELEMENTS) return bad(p, error, "too many elements");
  if (!tc_text_integer(number, 0, INT64_C(1) << 40, &n)) return bad(p, error, "element: a name and a number expected");
  if (n && (!strcmp(name, "tristrips") || !strcmp(name, "tristrip")))
    return bad(p, error, "triangle strips are not read: save the mesh with faces");
  const element e = {.vertices = strcmp(name, "vertex") == 0, .faces = strcmp(name, "face") == 0, .n = (uint64_t)n,
                     .properties = g_array_new(FALSE, FALSE, sizeof(property))};
  g_array_append_val(p->elements, e);
  return true;
}

static bool read_property(ply *p, char *line, GError **error) {
  property it = {0};
  const char *type = tc_line_word(&line);
  if (!p->elements->len) return bad(p, error, "a property of no element");
  const element *e = &g_array_index(p->elements, element, p->elements->len - 1);
  it.list = strcmp(type, "list") == 0;
  if (it.list) {
    if (!type_of(tc_line_word(&line), &it.count) || it.count >= TC_ELEMENT_F32)
      return bad(p, error, "a list's length has no known type of whole numbers");
    type = tc_line_word(&line);
  }
  if (!type_of(type, &it.type)) return bad(p, error, "a property has no known type");
  if (e->properties->len == MOST_PROPERTIES) return bad(p, error, "too many properties");
  it.role = role_of(e, tc_line_word(&line), it.list);
  g_array_append_val(e->properties, it);
  return true;
}

static bool has(const element *e, role r) {
  for (guint i = 0; i < e->properties->len; i++)
    if (g_array_index(e->properties, property, i).role == r) return true;
  return false;
}

/* The value that means 1 in colours of this type; 0: the type cannot hold colours. */
static double brightest_of(tc_element type) {
  switch (type) {
  case TC_ELEMENT_U8: return 255;
  case TC_ELEMENT_U16: return 65535;
  case TC_ELEMENT_F32:
  case TC_ELEMENT_F64: return 1;
  case TC_ELEMENT_I8:
  case TC_ELEMENT_I16:
  case TC_ELEMENT_I32:
  case TC_ELEMENT_U32:
  case TC_ELEMENT_I64:
  case TC_ELEMENT_U64:
  case TC_ELEMENT_COUNT: break;
  }
  return 0;
}

static void find_colors(ply *p, const element *e) {
  for (guint i = 0; i < e->properties->len; i++) {
    const property *it = &g_array_index(e->properties, property, i);
    if (it->role >= RED && it->role <= BLUE) p->brightest[it->role - RED] = brightest_of(it->type);
  }
  p->has_colors = p->brightest[0] > 0 && p->brightest[1] > 0 && p->brightest[2] > 0;
}

static bool check_header(ply *p, bool ended, GError **error) {
  bool seen = false;
  if (!ended) return bad(p, error, "the header has no end_header; the file is cut short");
  for (guint i = 0; i < p->elements->len; i++) {
    const element *e = &g_array_index(p->elements, element, i);
    if (e->vertices && (seen || !has(e, X) || !has(e, Y) || !has(e, Z)))
      return bad(p, error, "vertices want x, y and z, once");
    if (e->faces && (!seen || !has(e, CORNERS)))
      return bad(p, error, "faces want vertex_indices, and vertices before them");
    seen |= e->vertices;
    if (e->vertices) p->has_normals = has(e, NX) && has(e, NY) && has(e, NZ), find_colors(p, e);
  }
  return true;
}

static bool read_header(ply *p, GError **error) {
  bool ended = false, good = true;
  GError *trouble = NULL;
  for (char *line; good && !ended && (line = tc_stream_line(&p->stream, &trouble));) {
    char *rest = g_strstrip(line);
    const char *word = tc_line_word(&rest);
    if (p->stream.line == 1 && strcmp(word, "ply") != 0) good = bad(p, error, "\"ply\" expected");
    else if (strcmp(word, "format") == 0) good = read_format(p, rest, error);
    else if (strcmp(word, "element") == 0) good = read_element(p, rest, error);
    else if (strcmp(word, "property") == 0) good = read_property(p, rest, error);
    else if (strcmp(word, "comment") == 0) p->build.ras |= tc_build_says_ras(rest, strlen(rest));
    else ended = strcmp(word, "end_header") == 0;
    if (p->stream.line > 10000) good = bad(p, error, "the header is endless");
  }
  if (trouble) g_propagate_error(error, trouble);
  return good && !trouble && check_header(p, ended, error);
}

/* ---- rows ---- */

static bool short_line(const ply *p, GError **error) {
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "line %zu: fewer numbers than the header says", p->stream.line);
  return false;
}

/* Reads the next number, from a line or from the stream's bytes. */
static bool next_number(ply *p, tc_element type, char **line, double *number, GError **error) {
  if (p->ascii) return tc_line_number(line, number) || short_line(p, error);
  const size_t size = tc_element_size(type);
  const uint8_t *bytes = tc_stream_take(&p->stream, size, error);
  if (!bytes) return false;
  tc_reader r;
  tc_reader_init(&r, bytes, size, p->big);
  switch (type) {
  case TC_ELEMENT_I8: *number = (int8_t)tc_reader_u8(&r); break;
  case TC_ELEMENT_U8: *number = tc_reader_u8(&r); break;
  case TC_ELEMENT_I16: *number = tc_reader_i16(&r); break;
  case TC_ELEMENT_U16: *number = tc_reader_u16(&r); break;
  case TC_ELEMENT_I32: *number = tc_reader_i32(&r); break;
  case TC_ELEMENT_U32: *number = tc_reader_u32(&r); break;
  case TC_ELEMENT_F32: *number = tc_reader_f32(&r); break;
  case TC_ELEMENT_F64: *number = tc_reader_f64(&r); break;
  case TC_ELEMENT_I64:
  case TC_ELEMENT_U64:
  case TC_ELEMENT_COUNT: break;
  }
  return true;
}

/* Adds a corner of a face if the vertex exists. */
static bool take_corner(ply *p, double number, GError **error) {
  const uint32_t corner = number >= 0 && number < (double)p->build.n_vertices ? (uint32_t)number : UINT32_MAX;
  g_array_append_val(p->corners, corner);
  if (corner != UINT32_MAX) return true;
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "it names vertex %.0f of %zu, numbered from 0; save the mesh anew", number,
               p->build.n_vertices);
  return false;
}

static bool read_list(ply *p, const property *it, char **line, GError **error) {
  double n, number;
  if (!next_number(p, it->count, line, &n, error)) return false;
  if (!(n >= 0 && n <= MOST_LIST)) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "a list has %g entries; 0 to %d are read", n, MOST_LIST);
    return false;
  }
  if (it->role == CORNERS) g_array_set_size(p->corners, 0);
  for (int i = 0; i < (int)n; i++)
    if (!next_number(p, it->type, line, &number, error) || (it->role == CORNERS && !take_corner(p, number, error)))
      return false;
  return true;
}

static bool read_row(ply *p, const element *e, GError **error) {
  GError *trouble = NULL;
  char *line = NULL;
  while (p->ascii && (line = tc_stream_line(&p->stream, &trouble)) && !line[strspn(line, " \t")]) continue;
  if (p->ascii && !line) {
    if (!trouble) tc_set_error(&trouble, TC_ERROR_FORMAT, NULL, "the file is cut short: fetch it again");
    g_propagate_error(error, trouble);
    return false;
  }
  for (guint i = 0; i < e->properties->len; i++) {
    const property *it = &g_array_index(e->properties, property, i);
    if (!(it->list ? read_list(p, it, &line, error) : next_number(p, it->type, &line, &p->of[it->role], error)))
      return false;
  }
  return true;
}

static bool take_vertex(ply *p, GError **error) {
  double rgb[3];
  for (int c = 0; c < 3 && p->has_colors; c++) rgb[c] = p->of[RED + c] / p->brightest[c];
  return tc_build_vertex(&p->build, &p->of[X], error) &&
         (!p->has_normals || tc_build_normal(&p->build, &p->of[NX], error)) &&
         (!p->has_colors || tc_build_color(&p->build, rgb, error));
}

static bool take_face(ply *p, GError **error) {
  const uint32_t *corners = (const uint32_t *)(const void *)p->corners->data;
  return tc_build_polygon(&p->build, corners, corners, p->corners->len, error);
}

static bool read_rows(ply *p, const element *e, GError **error) {
  for (uint64_t i = 0; e->properties->len && i < e->n; i++) {
    if (read_row(p, e, error) && (!e->vertices || take_vertex(p, error)) && (!e->faces || take_face(p, error))) continue;
    g_prefix_error(error, "%s %" G_GUINT64_FORMAT " of %" G_GUINT64_FORMAT ": ",
                   e->vertices ? "vertex" : e->faces ? "face" : "row", i + 1, e->n);
    return false;
  }
  return true;
}

static bool read_ply(const tc_input *input, const tc_order *order, GError **error) {
  ply p = {0};
  if (!tc_stream_open(&p.stream, input, order, error)) return false;
  p.elements = g_array_new(FALSE, FALSE, sizeof(element));
  g_array_set_clear_func(p.elements, clear_element);
  p.corners = g_array_new(FALSE, FALSE, sizeof(uint32_t));
  tc_build_init(&p.build, "ply", order);
  bool ok = read_header(&p, error);
  for (guint i = 0; ok && i < p.elements->len; i++) ok = read_rows(&p, &g_array_index(p.elements, element, i), error);
  tc_stream_close(&p.stream);
  g_array_unref(p.elements);
  g_array_unref(p.corners);
  ok = ok && tc_build_send(&p.build, error);
  tc_build_clear(&p.build);
  return ok;
}

static bool is_ply(const uint8_t *head, size_t size) {
  return size >= 4 && memcmp(head, "ply", 3) == 0 && (head[3] == '\n' || head[3] == '\r' || head[3] == ' ');
}

const tc_format tc_format_ply = {"PLY", ".ply|.ply.gz|.ply.bz2", is_ply, read_ply};
