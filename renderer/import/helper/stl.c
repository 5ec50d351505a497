/* STL, binary and ASCII: triangles with the coordinates of their corners. Equal corners become one vertex. The file's
 * normals follow from the corners and are ignored. */
#include <string.h>

#include "renderer/import/helper/build.h"
#include "renderer/import/helper/format.h"
#include "renderer/import/helper/stream.h"
#include "renderer/import/reader.h"

enum { HEAD_BYTES = 84, RECORD_BYTES = 50 };

typedef struct stl {
  tc_stream stream;
  tc_build build;
  tc_weld weld;
} stl;

static bool corner(stl *s, const double at[3], uint32_t *number, GError **error) {
  tc_build *b = &s->build;
  float place[3];
  if (!tc_build_place(b, at, place, error) ||
      !tc_build_grow(b, &b->positions, &b->vertex_room, b->n_vertices + 1, sizeof place, error) ||
      !tc_weld_find(&s->weld, place, b->positions, (uint32_t)b->n_vertices, number, error))
    return false;
  if (*number == b->n_vertices) memcpy(b->positions[b->n_vertices++], place, sizeof place);
  return true;
}

/* ---- binary ---- */

static bool read_record(stl *s, const uint8_t *bytes, GError **error) {
  tc_reader r;
  uint32_t corners[3];
  tc_reader_init(&r, bytes + 12, RECORD_BYTES - 12, false);
  for (int c = 0; c < 3; c++) {
    double at[3];
    for (int k = 0; k < 3; k++) at[k] = tc_reader_f32(&r);
    if (!corner(s, at, &corners[c], error)) return false;
  }
  return tc_build_polygon(&s->build, corners, corners, 3, error);
}

static bool read_binary(stl *s, GError **error) {
  const uint8_t *head = tc_stream_take(&s->stream, HEAD_BYTES, error);
  if (!head) return false;
  tc_reader r;
  tc_reader_init(&r, head + 80, 4, false);
  const uint32_t count = tc_reader_u32(&r);
  s->build.ras = tc_build_says_ras(head, 80);
  for (uint32_t i = 0; i < count; i++) {
    const uint8_t *record = tc_stream_take(&s->stream, RECORD_BYTES, error);
    if (!record || !read_record(s, record, error)) {
      g_prefix_error(error, "triangle %u of %u: ", i + 1, count);
      return false;
    }
  }
  return true;
}

/* ---- ASCII ---- */

static bool bad_line(const stl *s, const char *what, GError **error) {
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "line %zu: %s", s->stream.line, what);
  return false;
}

/* Reads a line of an ASCII file; `corners` collects the corners of a loop. */
static bool read_line(stl *s, char *line, uint32_t corners[3], int *n, GError **error) {
  const char *word = tc_line_word(&line);
  double at[3];
  if (g_ascii_strcasecmp(word, "vertex") == 0) {
    if (*n == 3) return bad_line(s, "a loop has more than three corners; save triangles", error);
    if (!tc_line_number(&line, &at[0]) || !tc_line_number(&line, &at[1]) || !tc_line_number(&line, &at[2]))
      return bad_line(s, "a vertex wants three numbers", error);
    if (corner(s, at, &corners[(*n)++], error)) return true;
    g_prefix_error(error, "line %zu: ", s->stream.line);
    return false;
  }
  if (g_ascii_strcasecmp(word, "endloop") == 0) {
    if (*n != 3) return bad_line(s, "a loop wants three corners", error);
    *n = 0;
    return tc_build_polygon(&s->build, corners, corners, 3, error);
  }
  if (g_ascii_strcasecmp(word, "solid") == 0) s->build.ras |= tc_build_says_ras(line, strlen(line));
  return true; /* facet, outer loop, endfacet, endsolid */
}

static bool read_ascii(stl *s, GError **error) {
  uint32_t corners[3];
  int n = 0;
  GError *trouble = NULL;
  for (char *line; (line = tc_stream_line(&s->stream, &trouble));)
    if (!read_line(s, g_strstrip(line), corners, &n, error)) return false;
  if (!trouble && n > 0) bad_line(s, "the file is cut short: fetch it again", &trouble);
  if (!trouble) return true;
  g_propagate_error(error, trouble);
  return false;
}

/* ---- */

/* Binary files may begin with "solid", too. */
static bool is_ascii(const uint8_t *head, size_t size) {
  size_t at = 0;
  while (at < size && g_ascii_isspace(head[at])) at++;
  return size - at >= 5 && g_ascii_strncasecmp((const char *)head + at, "solid", 5) == 0 &&
         (memmem(head, size, "facet", 5) || memmem(head, size, "FACET", 5) || memmem(head, size, "endsolid", 8)) &&
         !memchr(head, 0, size);
}

bool tc_stl_fits(const uint8_t *head, size_t size, uint64_t whole) {
  if (size < HEAD_BYTES) return false;
  tc_reader r;
  tc_reader_init(&r, head + 80, 4, false);
  return whole == HEAD_BYTES + RECORD_BYTES * (uint64_t)tc_reader_u32(&r);
}

static bool read_stl(const tc_input *input, const tc_order *order, GError **error) {
  uint8_t head[TC_PROBE_BYTES];
  size_t size;
  stl s = {0};
  if (!tc_input_head(input, head, sizeof head, &size, error) || !tc_stream_open(&s.stream, input, order, error))
    return false;
  tc_build_init(&s.build, "stl", order);
  bool ok = is_ascii(head, size) ? read_ascii(&s, error) : read_binary(&s, error);
  g_free(s.weld.slots);
  tc_stream_close(&s.stream);
  ok = ok && tc_build_send(&s.build, error);
  tc_build_clear(&s.build);
  return ok;
}

const tc_format tc_format_stl = {"STL", ".stl|.stl.gz|.stl.bz2", is_ascii, read_stl};
