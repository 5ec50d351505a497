/* The daemon's side of the helper's stream. It trusts nothing: every length has a maximum and every number a range. */
#include "renderer/import/wire.h"

#include <math.h>
#include <string.h>
#include <unistd.h>

#include "renderer/import/colors.h"
#include "renderer/import/reader.h"
#include "renderer/mesh/mesh.h"
#include "renderer/splat/vmd.h"

typedef struct message {
  uint32_t kind, length;
} message;

static bool broken(GError **error, const char *what) {
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "the decoder's answer makes no sense (%s); the file is probably damaged",
               what);
  return false;
}

/* Checks the body's length against the maximum of its kind; unknown kinds have none. */
static bool length_fits(const message *m) {
  switch (m->kind) {
  case TC_WIRE_PROGRESS: return m->length == 8;
  case TC_WIRE_SERIES: return m->length == TC_WIRE_SERIES_BYTES;
  case TC_WIRE_HEAD: return m->length == TC_WIRE_HEAD_BYTES;
  case TC_WIRE_MESH: return m->length == TC_WIRE_MESH_BYTES;
  case TC_WIRE_SEGMENT: return m->length == TC_WIRE_SEGMENT_BYTES;
  case TC_WIRE_VOXELS: return m->length == 8;
  case TC_WIRE_WANT:
  case TC_WIRE_MODEL: return m->length == 8;
  case TC_WIRE_OPEN: return m->length == 4 + TC_WIRE_NAME;
  case TC_WIRE_FAIL: return m->length == 4 + TC_WIRE_FAIL_TEXT;
  case TC_WIRE_END: return m->length == 0;
  default: return false;
  }
}

/* Reads a whole body of `bytes` bytes and sets the reader to its start. */
static bool take_body(const tc_wire_reader *in, uint8_t *body, size_t bytes, tc_reader *r, GError **error) {
  if (!in->read(in->user, body, bytes, error)) return false;
  tc_reader_init(r, body, bytes, false);
  return true;
}

static bool next_message(const tc_wire_reader *in, message *m, GError **error) {
  uint8_t header[TC_WIRE_HEADER_BYTES];
  tc_reader r;
  if (!take_body(in, header, sizeof header, &r, error)) return false;
  m->kind = tc_reader_u32(&r);
  m->length = tc_reader_u32(&r);
  return length_fits(m) || broken(error, "unknown message");
}

/* Copies a fixed-size field of free text as UTF-8 without control characters. */
static void take_words(tc_reader *r, char *out, size_t field) {
  for (size_t i = 0; i < field; i++) {
    uint8_t c = tc_reader_u8(r);
    out[i] = (char)(c == 0 || (c >= 0x20 && c != 0x7f) ? c : '?');
  }
  out[field - 1] = 0;
  const char *end;
  while (!g_utf8_validate(out, -1, &end)) out[end - out] = '?';
  for (char *at = out; *at; at = g_utf8_next_char(at)) {
    const gunichar c = g_utf8_get_char(at);
    if (!g_unichar_isprint(c)) memset(at, '?', (size_t)(g_utf8_next_char(at) - at));
  }
  memset(out + strlen(out), 0, field - strlen(out));
}

/* Copies a fixed-size text field as printable ASCII, whatever the helper sent. */
static void take_text(tc_reader *r, char *out, size_t field) {
  for (size_t i = 0; i < field; i++) {
    uint8_t c = tc_reader_u8(r);
    out[i] = (char)(c == 0 || (c >= 0x20 && c < 0x7f) ? c : '?');
  }
  out[field - 1] = 0;
  memset(out + strlen(out), 0, field - strlen(out)); /* clears the rest of the field, too */
}

/* A helper may report only these codes; the others describe the daemon's state, not a file. */
static bool take_fail(const tc_wire_reader *in, GError **error) {
  uint8_t body[4 + TC_WIRE_FAIL_TEXT];
  char text[TC_WIRE_FAIL_TEXT];
  tc_reader r;
  if (!take_body(in, body, sizeof body, &r, error)) return false;
  uint32_t code = tc_reader_u32(&r);
  take_text(&r, text, sizeof text);
  bool allowed = code == TC_ERROR_FORMAT || code == TC_ERROR_LIMIT || code == TC_ERROR_UNSUPPORTED ||
                 code == TC_ERROR_NOT_FOUND || code == TC_ERROR_IO || code == TC_ERROR_MEMORY ||
                 code == TC_ERROR_INVALID || (code >= TC_WIRE_ELSEWHERE && code < TC_WIRE_ELSEWHERE + TC_HELPER_COUNT);
  tc_set_error(error, allowed ? (tc_error_code)code : TC_ERROR_FORMAT, NULL, "%s",
               text[0] ? text : "the decoder gave up without a reason");
  return false;
}

static bool tick(const tc_wire_reader *in, double fraction, GError **error) {
  if (!in->tick || in->tick(in->user, fraction)) return true;
  tc_set_error(error, TC_ERROR_CANCELLED, NULL, "cancelled");
  return false;
}

static bool take_progress(const tc_wire_reader *in, GError **error) {
  uint8_t body[8];
  tc_reader r;
  if (!take_body(in, body, sizeof body, &r, error)) return false;
  double fraction = tc_reader_f64(&r);
  if (!(fraction >= 0 && fraction <= 1)) return broken(error, "progress");
  return tick(in, fraction, error);
}

static bool format_is_sane(const char *format) {
  for (; *format; format++)
    if (!g_ascii_isalnum(*format)) return false;
  return true;
}

/* Checks the numbers that tc_volume_new() does not; that function checks the grid. */
static bool head_is_sane(const tc_volume_desc *d) {
  for (int i = 0; i < 9; i++)
    if (!(fabs(d->direction[i]) <= 1.001)) return false;
  return format_is_sane(d->format) && isfinite(d->window_center) && isfinite(d->window_width) && d->window_width >= 0 &&
         d->frames >= 1;
}

static bool provenance_is_sane(const tc_provenance *from, const tc_volume_desc *d) {
  return from->volume >= 0 && from->volume <= d->frames && from->slices_used >= 0 &&
         from->slices_used <= from->slices_found && from->bridged >= 0 && from->bridged <= d->dims[2];
}

static bool take_head(const tc_wire_reader *in, tc_volume_desc *desc, tc_provenance *from, GError **error) {
  uint8_t body[TC_WIRE_HEAD_BYTES];
  double numbers[TC_WIRE_HEAD_NUMBERS];
  tc_reader r;
  if (!take_body(in, body, sizeof body, &r, error)) return false;
  memset(desc, 0, sizeof *desc);
  for (int i = 0; i < 3; i++) desc->dims[i] = tc_reader_i32(&r);
  uint32_t type = tc_reader_u32(&r);
  desc->frames = tc_reader_i32(&r);
  from->volume = tc_reader_i32(&r);
  from->slices_used = tc_reader_i32(&r);
  from->slices_found = tc_reader_i32(&r);
  from->bridged = tc_reader_i32(&r);
  from->resampled = tc_reader_u32(&r) != 0;
  from->colors = tc_reader_u32(&r) != 0;
  for (int i = 0; i < TC_WIRE_HEAD_NUMBERS; i++) numbers[i] = tc_reader_f64(&r);
  memcpy(desc->spacing, numbers, sizeof desc->spacing);
  memcpy(desc->origin, numbers + 3, sizeof desc->origin);
  memcpy(desc->direction, numbers + 6, sizeof desc->direction);
  desc->slope = numbers[15];
  desc->intercept = numbers[16];
  desc->window_center = numbers[17];
  desc->window_width = numbers[18];
  take_text(&r, desc->modality, 16);
  take_text(&r, desc->unit, 16);
  take_text(&r, desc->note, 256);
  take_text(&r, desc->format, 16);
  take_words(&r, from->description, sizeof from->description);
  take_text(&r, from->time, sizeof from->time);
  if (r.failed || type >= TC_VOXEL_TYPE_COUNT || (from->colors && type != TC_U8) || !head_is_sane(desc) ||
      !provenance_is_sane(from, desc))
    return broken(error, "volume header");
  desc->type = (tc_voxel_type)type;
  return true;
}

static bool over_limit(const tc_wire_reader *in, uint64_t bytes, const char *what, GError **error) {
  if (!in->max_voxel_bytes || bytes <= in->max_voxel_bytes) return false;
  tc_set_error(error, TC_ERROR_LIMIT, NULL, "%s %" G_GUINT64_FORMAT " bytes, more than the limit of %" G_GUINT64_FORMAT,
               what, bytes, in->max_voxel_bytes);
  return true;
}

static tc_volume *volume_for(const tc_wire_reader *in, GError **error) {
  tc_volume_desc desc;
  tc_provenance from;
  if (!take_head(in, &desc, &from, error)) return NULL;
  uint64_t bytes = from.colors ? 3 : tc_voxel_size(desc.type); /* colours: luma and two-byte labels */
  for (int i = 0; i < 3; i++)
    if (__builtin_mul_overflow(bytes, (uint64_t)desc.dims[i], &bytes)) bytes = UINT64_MAX;
  if (over_limit(in, bytes, "the volume holds voxels of", error)) return NULL;
  if (in->reserve && !in->reserve(in->user, bytes, error)) return NULL;
  tc_volume *volume = tc_volume_new(&desc, error);
  if (volume) tc_volume_set_provenance(volume, &from);
  return volume;
}

static bool take_u64(const tc_wire_reader *in, uint64_t *value, GError **error) {
  uint8_t body[8];
  tc_reader r;
  if (!take_body(in, body, sizeof body, &r, error)) return false;
  *value = tc_reader_u64(&r);
  return true;
}

static bool take_want(const tc_wire_reader *in, GError **error) {
  uint64_t bytes;
  return take_u64(in, &bytes, error) && (!in->reserve || in->reserve(in->user, bytes, error));
}

static bool take_open(const tc_wire_reader *in, GError **error) {
  uint8_t body[4 + TC_WIRE_NAME];
  if (!in->read(in->user, body, sizeof body, error)) return false;
  if (!in->open || body[sizeof body - 1] != 0) return broken(error, "file name");
  GError *trouble = NULL;
  int fd = in->open(in->user, (const char *)body + 4, body[0] != 0, &trouble);
  if (trouble) {
    g_propagate_error(error, trouble);
    return false;
  }
  in->reply(in->user, fd >= 0 ? TC_WIRE_FILE : TC_WIRE_MISSING, fd);
  if (fd >= 0) close(fd);
  return true;
}

/* A volume or mesh under construction: up to four arrays, filled one after another. */
typedef struct filling {
  tc_volume *volume; /* NULL before HEAD */
  uint8_t *model;    /* or before MODEL; the volume is decoded from these bytes at the end */
  size_t model_bytes;
  tc_mesh *mesh;        /* NULL before MESH */
  tc_mesh_file *source; /* facts about a mesh file; NULL: a volume is expected */
  struct {
    char *at;
    size_t left;
  } arrays[4];
  int n_arrays, next;
  GArray *segments;  /* NULL: none */
  tc_colors *colors; /* of an RGB volume */
} filling;

static void add_array(filling *f, void *at, size_t bytes) {
  f->arrays[f->n_arrays].at = at;
  f->arrays[f->n_arrays++].left = bytes;
}

static bool take_voxels(const tc_wire_reader *in, filling *f, GError **error) {
  uint8_t body[8];
  tc_reader r;
  if (!take_body(in, body, sizeof body, &r, error)) return false;
  uint32_t slot = tc_reader_u32(&r), bytes = tc_reader_u32(&r);
  if (slot >= TC_WIRE_SLOTS || bytes > TC_WIRE_SLOT_BYTES) return broken(error, "slot");
  const uint8_t *from = in->ring + (size_t)slot * TC_WIRE_SLOT_BYTES;
  if (f->colors) {
    if (!tc_colors_put(f->colors, from, bytes)) return broken(error, "more data than announced");
    bytes = 0;
  }
  for (; bytes > 0 && f->next < f->n_arrays; f->next += f->arrays[f->next].left == 0) {
    const size_t n = MIN(bytes, f->arrays[f->next].left);
    memcpy(f->arrays[f->next].at, from, n);
    f->arrays[f->next].at += n;
    f->arrays[f->next].left -= n;
    from += n;
    bytes -= (uint32_t)n;
  }
  if (bytes > 0) return broken(error, "more data than announced");
  in->reply(in->user, TC_WIRE_FREE, -1);
  return true;
}

static bool take_volume(const tc_wire_reader *in, filling *f, GError **error) {
  if (f->volume || f->model || f->source) return broken(error, "a volume header out of place");
  f->volume = volume_for(in, error);
  if (!f->volume) return false;
  if (!tc_volume_provenance(f->volume)->colors)
    add_array(f, tc_volume_voxels(f->volume), tc_volume_bytes(f->volume));
  else
    f->colors = tc_colors_new(f->volume, error);
  return f->n_arrays > 0 || f->colors;
}

/* Memory of a model while it is read, as a multiple of its bytes: the bytes, a copy of most of them, and an index of
 * four bytes per column; each column has at least one byte. */
#define MODEL_ROOM 6

static bool take_model(const tc_wire_reader *in, filling *f, GError **error) {
  uint64_t bytes;
  if (f->volume || f->model || f->source) return broken(error, "a volume header out of place");
  if (!take_u64(in, &bytes, error)) return false;
  if (bytes > UINT32_MAX) return broken(error, "size of the model");
  if (over_limit(in, bytes, "the model takes", error)) return false;
  if (in->reserve && !in->reserve(in->user, MODEL_ROOM * bytes, error)) return false;
  f->model_bytes = bytes;
  f->model = g_try_malloc(bytes + 1);
  if (!f->model) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "voxel model: out of memory");
    return false;
  }
  add_array(f, f->model, bytes);
  return true;
}

/* The helper has decompressed the model, so the daemon inflates nothing. */
static tc_volume *volume_of_model(const filling *f, GError **error) {
  tc_reader r;
  tc_reader_init(&r, f->model, f->model_bytes, false);
  tc_reader_seek(&r, TC_VMD_FLAGS_AT);
  if (tc_reader_u16(&r) != 0 || r.failed) return broken(error, "packed model"), NULL;
  tc_vmd *vmd = tc_vmd_decode(f->model, f->model_bytes, error);
  tc_volume *volume = vmd ? tc_vmd_volume(vmd, error) : NULL;
  if (!volume) tc_vmd_free(vmd);
  return volume;
}

/* ---- meshes ---- */

static bool take_mesh_head(const tc_wire_reader *in, tc_mesh_head *head, GError **error) {
  uint8_t body[TC_WIRE_MESH_BYTES];
  double numbers[6];
  tc_reader r;
  if (!take_body(in, body, sizeof body, &r, error)) return false;
  for (int i = 0; i < 6; i++) {
    numbers[i] = tc_reader_f64(&r);
    const bool good = i < 3 ? fabs(numbers[i]) <= 1e10 : numbers[i] >= 0 && numbers[i] <= UINT32_MAX;
    if (!good) return broken(error, "mesh header");
  }
  memcpy(head->origin, numbers, sizeof head->origin);
  head->n_vertices = (uint64_t)numbers[3];
  head->n_triangles = (uint64_t)numbers[4];
  head->degenerate = (uint64_t)numbers[5];
  head->normals = tc_reader_u32(&r) != 0;
  head->colors = tc_reader_u32(&r) != 0;
  take_text(&r, head->format, sizeof head->format);
  return (head->n_triangles && format_is_sane(head->format)) || broken(error, "mesh header");
}

/* Reserves memory for normals in any case: the renderer computes missing ones. */
static bool take_mesh(const tc_wire_reader *in, filling *f, GError **error) {
  tc_mesh_head head;
  if (f->mesh || !f->source) return broken(error, "a mesh header out of place");
  if (!take_mesh_head(in, &head, error)) return false;
  const uint64_t colors = head.colors ? head.n_vertices * TC_MESH_COLOR_BYTES : 0;
  const uint64_t bytes = tc_mesh_bytes(head.n_vertices, head.n_triangles, true) + colors;
  if (over_limit(in, bytes, "the mesh takes", error)) return false;
  if (in->reserve && !in->reserve(in->user, bytes, error)) return false;
  tc_mesh *m = f->mesh = tc_mesh_new(head.n_vertices, head.n_triangles, head.normals, error);
  if (!m || (colors && !tc_mesh_add_colors(m, error))) return false;
  memcpy(m->origin, head.origin, sizeof m->origin);
  memcpy(f->source->format, head.format, sizeof head.format);
  f->source->degenerate = head.degenerate;
  add_array(f, m->positions, m->n_vertices * sizeof *m->positions);
  if (m->normals) add_array(f, m->normals, m->n_vertices * sizeof *m->normals);
  if (colors) add_array(f, m->colors, colors);
  add_array(f, m->triangles, m->n_triangles * sizeof *m->triangles);
  return true;
}

/* Whether all numbers are finite and at most `most` in size. */
static bool within(const float (*vectors)[3], size_t n, float most) {
  bool good = true;
  for (size_t i = 0; i < n; i++)
    for (int k = 0; k < 3; k++) good &= fabsf(vectors[i][k]) <= most;
  return good;
}

/* Validates the helper's mesh, because every renderer relies on finite positions and valid indices. */
static bool mesh_is_sound(const tc_wire_reader *in, const tc_mesh *m, GError **error) {
  enum { PORTION = 1 << 20 };
  for (size_t i = 0; i < MAX(m->n_vertices, m->n_triangles); i += PORTION) {
    const size_t v = i < m->n_vertices ? MIN(m->n_vertices - i, (size_t)PORTION) : 0;
    const size_t end = MIN(m->n_triangles, i + PORTION);
    bool good = within(m->positions + i, v, 4e9f) && (!m->normals || within(m->normals + i, v, 1.001f));
    for (size_t t = i; t < end; t++)
      for (int c = 0; c < 3; c++) good &= m->triangles[t][c] < m->n_vertices;
    if (!good) return broken(error, "mesh");
    if (!tick(in, 1, error)) return false;
  }
  return true;
}

/* ---- segments ---- */

static bool segment_is_sane(const tc_segment *s) {
  const bool whole = !s->of[0] && !s->of[1];
  return s->label >= 1 && s->label <= TC_SEGMENTS_MAX &&
         (whole || (s->of[0] && s->of[1] && s->of[0] < s->label && s->of[1] < s->label));
}

static bool take_segment(const tc_wire_reader *in, filling *f, GError **error) {
  uint8_t body[TC_WIRE_SEGMENT_BYTES];
  tc_segment s = {0};
  tc_reader r;
  if (!take_body(in, body, sizeof body, &r, error)) return false;
  if (!f->volume) return broken(error, "a segment out of place");
  s.label = tc_reader_u32(&r);
  s.of[0] = tc_reader_u32(&r);
  s.of[1] = tc_reader_u32(&r);
  s.has_color = tc_reader_u8(&r) != 0;
  for (int i = 0; i < 3; i++) s.color[i] = (float)tc_reader_u8(&r) / 255;
  take_words(&r, s.name, sizeof s.name);
  if (!f->segments) f->segments = g_array_new(FALSE, FALSE, sizeof s);
  if (!segment_is_sane(&s) || f->segments->len >= TC_SEGMENTS_MAX) return broken(error, "segment");
  g_array_append_val(f->segments, s);
  return true;
}

/* A label may occur once only. */
static bool keep_segments(filling *f, GError **error) {
  size_t count;
  if (!f->segments) return true;
  tc_volume_set_segments(f->volume, (const tc_segment *)(const void *)f->segments->data, f->segments->len);
  const tc_segment *s = tc_volume_segments(f->volume, &count);
  for (size_t i = 1; i < count; i++)
    if (s[i].label == s[i - 1].label) return broken(error, "segment");
  return true;
}

static bool take(const tc_wire_reader *in, uint32_t kind, filling *f, GError **error) {
  switch (kind) {
  case TC_WIRE_PROGRESS: return take_progress(in, error);
  case TC_WIRE_WANT: return take_want(in, error);
  case TC_WIRE_OPEN: return take_open(in, error);
  case TC_WIRE_HEAD: return take_volume(in, f, error);
  case TC_WIRE_MESH: return take_mesh(in, f, error);
  case TC_WIRE_MODEL: return take_model(in, f, error);
  case TC_WIRE_VOXELS: return take_voxels(in, f, error);
  case TC_WIRE_SEGMENT: return take_segment(in, f, error);
  case TC_WIRE_FAIL: return take_fail(in, error);
  default: return broken(error, "message out of place");
  }
}

static bool take_all(const tc_wire_reader *in, filling *f, GError **error) {
  message m;
  bool ok;
  while ((ok = next_message(in, &m, error)) && m.kind != TC_WIRE_END && (ok = take(in, m.kind, f, error))) continue;
  const bool whole = f->colors ? tc_colors_end(f->colors) : f->n_arrays && f->next == f->n_arrays;
  return ok && (whole || broken(error, "less data than announced"));
}

tc_volume *tc_wire_load(const tc_wire_reader *in, GError **error) {
  filling f = {0};
  bool ok = take_all(in, &f, error);
  if (ok && f.model) ok = (f.volume = volume_of_model(&f, error)) != NULL;
  g_free(f.model);
  ok = ok && keep_segments(&f, error);
  if (f.segments) g_array_unref(f.segments);
  tc_colors_free(f.colors);
  if (ok) return f.volume;
  tc_volume_unref(f.volume);
  return NULL;
}

tc_mesh *tc_wire_load_mesh(const tc_wire_reader *in, tc_mesh_file *source, GError **error) {
  filling f = {.source = source};
  if (take_all(in, &f, error) && mesh_is_sound(in, f.mesh, error)) return f.mesh;
  tc_mesh_free(f.mesh);
  return NULL;
}

static bool take_series(const tc_wire_reader *in, GArray *list, GError **error) {
  uint8_t body[TC_WIRE_SERIES_BYTES];
  tc_series series = {0};
  tc_reader r;
  if (!take_body(in, body, sizeof body, &r, error)) return false;
  if (list->len >= TC_WIRE_SERIES_MAX) return broken(error, "too many series");
  take_text(&r, series.uid, sizeof series.uid);
  take_text(&r, series.modality, sizeof series.modality);
  take_text(&r, series.label, sizeof series.label);
  series.files = tc_reader_i32(&r);
  series.frames = tc_reader_i32(&r);
  series.rows = tc_reader_i32(&r);
  series.columns = tc_reader_i32(&r);
  series.number = tc_reader_i32(&r);
  series.volume = tc_reader_i32(&r);
  series.slices = tc_reader_i32(&r);
  take_text(&r, series.what, sizeof series.what);
  take_words(&r, series.description, sizeof series.description);
  take_text(&r, series.time, sizeof series.time);
  take_words(&r, series.patient, sizeof series.patient);
  if (series.files < 0 || series.frames < 0 || series.rows < 0 || series.columns < 0 || series.number < 1 ||
      series.volume < 1 || series.slices < 0)
    return broken(error, "series");
  g_array_append_val(list, series);
  return true;
}

bool tc_wire_list(const tc_wire_reader *in, tc_series **series, size_t *count, GError **error) {
  GArray *list = g_array_new(FALSE, TRUE, sizeof(tc_series));
  bool ok = true, ended = false;
  message m;
  while (ok && !ended && (ok = next_message(in, &m, error))) {
    if (m.kind == TC_WIRE_PROGRESS)
      ok = take_progress(in, error);
    else if (m.kind == TC_WIRE_SERIES)
      ok = take_series(in, list, error);
    else if (m.kind == TC_WIRE_FAIL)
      ok = take_fail(in, error);
    else if (m.kind == TC_WIRE_END)
      ended = true;
    else
      ok = broken(error, "message out of place");
  }
  if (ok) {
    *count = list->len;
    *series = list->len ? g_memdup2(list->data, list->len * sizeof(tc_series)) : NULL;
  }
  g_array_free(list, TRUE);
  return ok;
}
