/* Wavefront OBJ: vertices, with colours ("v x y z r g b", 0 to 1, as MeshLab and Blender write them), normals and
 * faces. Textures, groups, materials and curves are ignored, and no other file is opened. */
#include <string.h>

#include "renderer/import/helper/build.h"
#include "renderer/import/helper/format.h"
#include "renderer/import/helper/stream.h"

#define NONE UINT32_MAX
/* Marks the number of a duplicate of a vertex with a second normal; duplicates follow the file's vertices. */
#define EXTRA UINT32_C(0x80000000)

typedef struct obj {
  tc_stream stream;
  tc_build build;
  float (*normals)[3];    /* "vn" */
  uint32_t *normal_of;    /* [n_vertices]: number of the vertex's normal, or NONE */
  uint32_t (*extras)[3];  /* vertex, normal, 0 */
  GArray *corners;        /* uint32_t, of a face */
  GArray *places;         /* uint32_t: the corners' vertices; a duplicate's is its original */
  size_t n_normals, normal_room, normal_of_room, n_extras, extra_room;
  tc_weld weld;
  bool bare; /* a corner without a normal was read, so the mesh gets no normals */
} obj;

static bool bad(const obj *o, const char *what, GError **error) {
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "line %zu: %s", o->stream.line, what);
  return false;
}

static bool read_three(char **line, double to[3]) {
  return tc_line_number(line, &to[0]) && tc_line_number(line, &to[1]) && tc_line_number(line, &to[2]);
}

static bool read_vertex(obj *o, char *line, GError **error) {
  double at[3], rgb[3];
  tc_build *b = &o->build;
  if (!read_three(&line, at)) return bad(o, "a vertex wants three numbers", error);
  if (!tc_build_grow(b, &o->normal_of, &o->normal_of_room, b->n_vertices + 1, sizeof *o->normal_of, error)) return false;
  if (!tc_build_vertex(b, at, error)) {
    g_prefix_error(error, "line %zu: ", o->stream.line);
    return false;
  }
  o->normal_of[b->n_vertices - 1] = NONE;
  return !read_three(&line, rgb) || tc_build_color(b, rgb, error);
}

static bool read_normal(obj *o, char *line, GError **error) {
  double along[3];
  if (!read_three(&line, along)) return bad(o, "a normal wants three numbers", error);
  if (!tc_build_grow(&o->build, &o->normals, &o->normal_room, o->n_normals + 1, sizeof *o->normals, error)) return false;
  tc_build_direction(&o->build, along, o->normals[o->n_normals++]);
  return true;
}

/* "7" is the seventh vertex so far, "-1" the last. */
static bool read_number(char **at, size_t count, uint32_t *number) {
  char *end;
  const gint64 given = g_ascii_strtoll(*at, &end, 10);
  if (end == *at || given == 0 || given > (gint64)count || given < -(gint64)count) return false;
  *number = (uint32_t)(given > 0 ? given - 1 : given + (gint64)count);
  *at = end;
  return true;
}

/* A vertex used with a second normal gets a duplicate. */
static bool with_normal(obj *o, uint32_t vertex, uint32_t normal, uint32_t *corner, GError **error) {
  *corner = vertex;
  if (o->normal_of[vertex] == NONE) o->normal_of[vertex] = normal;
  if (o->normal_of[vertex] == normal) return true;
  const uint32_t key[3] = {vertex, normal, 0};
  if (!tc_build_grow(&o->build, &o->extras, &o->extra_room, o->n_extras + 1, sizeof key, error) ||
      !tc_weld_find(&o->weld, key, o->extras, (uint32_t)o->n_extras, corner, error))
    return false;
  if (*corner == o->n_extras) memcpy(o->extras[o->n_extras++], key, sizeof key);
  *corner |= EXTRA;
  return true;
}

/* "v", "v/t", "v//n" or "v/t/n". */
static bool read_corner(obj *o, char *word, uint32_t *corner, GError **error) {
  uint32_t normal;
  if (!read_number(&word, o->build.n_vertices, corner)) return bad(o, "a face names a vertex that is not there", error);
  if (*word == '/') word += 1 + strcspn(word + 1, "/");
  if (*word == 0) {
    o->bare = true;
    return true;
  }
  if (*word++ != '/') return bad(o, "a face's corners are v, v/t, v//n or v/t/n", error);
  if (!read_number(&word, o->n_normals, &normal) || *word)
    return bad(o, "a face names a normal that is not there", error);
  return with_normal(o, *corner, normal, corner, error);
}

static const uint32_t *numbers(const GArray *array) { return (const uint32_t *)(const void *)array->data; }

static uint32_t vertex_of(const obj *o, uint32_t corner) { return corner & EXTRA ? o->extras[corner & ~EXTRA][0] : corner; }

static bool read_face(obj *o, char *line, GError **error) {
  g_array_set_size(o->corners, 0);
  g_array_set_size(o->places, 0);
  for (char *word; *(word = tc_line_word(&line));) {
    uint32_t corner, place;
    if (!read_corner(o, word, &corner, error)) return false;
    place = vertex_of(o, corner);
    g_array_append_val(o->corners, corner);
    g_array_append_val(o->places, place);
  }
  if (tc_build_polygon(&o->build, numbers(o->places), numbers(o->corners), o->corners->len, error)) return true;
  g_prefix_error(error, "line %zu: ", o->stream.line);
  return false;
}

static bool read_line(obj *o, char *line, GError **error) {
  const char *word = tc_line_word(&line);
  if (strcmp(word, "v") == 0) return read_vertex(o, line, error);
  if (strcmp(word, "vn") == 0) return read_normal(o, line, error);
  if (strcmp(word, "f") == 0 || strcmp(word, "fo") == 0) return read_face(o, line, error);
  if (word[0] == '#' && !o->build.n_vertices) o->build.ras |= tc_build_says_ras(line, strlen(line));
  return true;
}

static bool read_lines(obj *o, GError **error) {
  GError *trouble = NULL;
  for (char *line; (line = tc_stream_line(&o->stream, &trouble));)
    if (!read_line(o, g_strstrip(line), error)) return false;
  if (!trouble) return true;
  g_propagate_error(error, trouble);
  return false;
}

/* Appends duplicates behind the file's vertices; without normals they are replaced by their originals. */
static bool place_extras(obj *o, GError **error) {
  tc_build *b = &o->build;
  const size_t own = b->n_vertices;
  const bool normals = !o->bare && o->n_normals > 0, colors = b->n_colors == own;
  for (size_t t = 0; t < b->n_triangles; t++)
    for (int c = 0; c < 3; c++)
      if (b->triangles[t][c] & EXTRA)
        b->triangles[t][c] = normals ? (uint32_t)own + (b->triangles[t][c] & ~EXTRA) : vertex_of(o, b->triangles[t][c]);
  if (!normals) return true;
  const size_t n = own + o->n_extras;
  if (!tc_build_grow(b, &b->positions, &b->vertex_room, n, sizeof *b->positions, error) ||
      !tc_build_grow(b, &b->normals, &b->normal_room, n, sizeof *b->normals, error) ||
      (colors && !tc_build_grow(b, &b->colors, &b->color_room, n, sizeof *b->colors, error)))
    return false;
  for (size_t i = 0; i < n; i++) {
    const uint32_t *extra = i < own ? NULL : o->extras[i - own], normal = extra ? extra[1] : o->normal_of[i];
    if (extra) memcpy(b->positions[i], b->positions[extra[0]], sizeof *b->positions);
    if (extra && colors) b->colors[i] = b->colors[extra[0]];
    memcpy(b->normals[i], normal == NONE ? (const float[3]){0, 0, 1} : o->normals[normal], sizeof *b->normals);
  }
  b->n_vertices = b->n_normals = n;
  if (colors) b->n_colors = n;
  return true;
}

static bool read_obj(const tc_input *input, const tc_order *order, GError **error) {
  obj o = {0};
  if (!tc_stream_open(&o.stream, input, order, error)) return false;
  o.corners = g_array_new(FALSE, FALSE, sizeof(uint32_t));
  o.places = g_array_new(FALSE, FALSE, sizeof(uint32_t));
  tc_build_init(&o.build, "obj", order);
  bool ok = read_lines(&o, error) && place_extras(&o, error);
  tc_stream_close(&o.stream);
  g_array_unref(o.corners);
  g_array_unref(o.places);
  g_free(o.weld.slots);
  g_free(o.normals);
  g_free(o.normal_of);
  g_free(o.extras);
  ok = ok && tc_build_send(&o.build, error);
  tc_build_clear(&o.build);
  return ok;
}

/* Recognises text whose first line, comments aside, starts with an OBJ keyword. */
static bool looks_like_obj(const uint8_t *head, size_t size) {
  static const char *const words[] = {"v", "vn", "vt", "f", "g", "o", "s", "mtllib", "usemtl"};
  char *text = g_strndup((const char *)head, size), **lines = g_strsplit(text, "\n", -1);
  bool found = false, other = memchr(head, 0, size) != NULL;
  for (char **line = lines; *line && !found && !other; line++) {
    char *rest = g_strstrip(*line), *word = tc_line_word(&rest);
    if (!*word || *word == '#') continue;
    for (size_t i = 0; i < G_N_ELEMENTS(words); i++) found |= strcmp(word, words[i]) == 0;
    other = !found;
  }
  g_strfreev(lines);
  g_free(text);
  return found;
}

const tc_format tc_format_obj = {"OBJ", ".obj|.obj.gz|.obj.bz2", looks_like_obj, read_obj};
