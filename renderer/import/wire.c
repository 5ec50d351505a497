/* The parent's side of the helper's stream. It believes none of it: caps on every length, a range for every number. */
#include "renderer/import/wire.h"

#include <math.h>
#include <string.h>
#include <unistd.h>

#include "renderer/import/reader.h"

typedef struct message {
  uint32_t kind, length;
} message;

static bool broken(GError **error, const char *what) {
  tc_set_error(error, TC_ERROR_FORMAT, NULL,
               "the decoder's answer makes no sense (%s); the file is probably damaged", what);
  return false;
}

/* The longest body of a kind; a kind not known has none. */
static bool length_fits(const message *m) {
  switch (m->kind) {
  case TC_WIRE_PROGRESS:
    return m->length == 8;
  case TC_WIRE_SERIES:
    return m->length == TC_WIRE_SERIES_BYTES;
  case TC_WIRE_HEAD:
    return m->length == TC_WIRE_HEAD_BYTES;
  case TC_WIRE_VOXELS:
    return m->length == 8;
  case TC_WIRE_WANT:
    return m->length == 8;
  case TC_WIRE_OPEN:
    return m->length == 4 + TC_WIRE_NAME;
  case TC_WIRE_FAIL:
    return m->length == 4 + TC_WIRE_FAIL_TEXT;
  case TC_WIRE_END:
    return m->length == 0;
  default:
    return false;
  }
}

static bool next_message(const tc_wire_reader *in, message *m, GError **error) {
  uint8_t header[TC_WIRE_HEADER_BYTES];
  if (!in->read(in->user, header, sizeof header, error)) return false;
  tc_reader r;
  tc_reader_init(&r, header, sizeof header, false);
  m->kind = tc_reader_u32(&r);
  m->length = tc_reader_u32(&r);
  return length_fits(m) || broken(error, "unknown message");
}

/* Copies a fixed text field as printable ASCII; the helper's text may hold anything. */
static void take_text(tc_reader *r, char *out, size_t field) {
  for (size_t i = 0; i < field; i++) {
    uint8_t c = tc_reader_u8(r);
    out[i] = (char)(c == 0 || (c >= 0x20 && c < 0x7f) ? c : '?');
  }
  out[field - 1] = 0;
  memset(out + strlen(out), 0, field - strlen(out)); /* nothing after the end either */
}

/* The helper may use these codes only: the others speak of the parent's state, not of a file. */
static bool take_fail(const tc_wire_reader *in, GError **error) {
  uint8_t body[4 + TC_WIRE_FAIL_TEXT];
  char text[TC_WIRE_FAIL_TEXT];
  if (!in->read(in->user, body, sizeof body, error)) return false;
  tc_reader r;
  tc_reader_init(&r, body, sizeof body, false);
  uint32_t code = tc_reader_u32(&r);
  take_text(&r, text, sizeof text);
  bool allowed = code == TC_ERROR_FORMAT || code == TC_ERROR_LIMIT || code == TC_ERROR_UNSUPPORTED ||
                 code == TC_ERROR_NOT_FOUND || code == TC_ERROR_IO || code == TC_ERROR_MEMORY ||
                 code == TC_ERROR_INVALID;
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
  if (!in->read(in->user, body, sizeof body, error)) return false;
  tc_reader r;
  tc_reader_init(&r, body, sizeof body, false);
  double fraction = tc_reader_f64(&r);
  if (!(fraction >= 0 && fraction <= 1)) return broken(error, "progress");
  return tick(in, fraction, error);
}

/* Numbers that tc_volume_new() does not look at; it checks the grid itself. */
static bool head_is_sane(const tc_volume_desc *d) {
  for (int i = 0; i < 9; i++)
    if (!(fabs(d->direction[i]) <= 1.001)) return false;
  for (const char *at = d->format; *at; at++)
    if (!g_ascii_isalnum(*at)) return false;
  return isfinite(d->window_center) && isfinite(d->window_width) && d->window_width >= 0 && d->frames >= 1;
}

static bool provenance_is_sane(const tc_provenance *from, const tc_volume_desc *d) {
  return from->volume >= 0 && from->volume <= d->frames && from->slices_used >= 0 &&
         from->slices_used <= from->slices_found && from->bridged >= 0 && from->bridged <= d->dims[2];
}

static bool take_head(const tc_wire_reader *in, tc_volume_desc *desc, tc_provenance *from, GError **error) {
  uint8_t body[TC_WIRE_HEAD_BYTES];
  double numbers[TC_WIRE_HEAD_NUMBERS];
  if (!in->read(in->user, body, sizeof body, error)) return false;
  tc_reader r;
  tc_reader_init(&r, body, sizeof body, false);
  memset(desc, 0, sizeof *desc);
  for (int i = 0; i < 3; i++)
    desc->dims[i] = tc_reader_i32(&r);
  uint32_t type = tc_reader_u32(&r);
  desc->frames = tc_reader_i32(&r);
  from->volume = tc_reader_i32(&r);
  from->slices_used = tc_reader_i32(&r);
  from->slices_found = tc_reader_i32(&r);
  from->bridged = tc_reader_i32(&r);
  from->resampled = tc_reader_u32(&r) != 0;
  for (int i = 0; i < TC_WIRE_HEAD_NUMBERS; i++)
    numbers[i] = tc_reader_f64(&r);
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
  if (r.failed || type >= TC_VOXEL_TYPE_COUNT || !head_is_sane(desc) || !provenance_is_sane(from, desc))
    return broken(error, "volume header");
  desc->type = (tc_voxel_type)type;
  return true;
}

static tc_volume *volume_for(const tc_wire_reader *in, GError **error) {
  tc_volume_desc desc;
  tc_provenance from;
  if (!take_head(in, &desc, &from, error)) return NULL;
  uint64_t bytes = tc_voxel_size(desc.type);
  for (int i = 0; i < 3; i++)
    if (__builtin_mul_overflow(bytes, (uint64_t)desc.dims[i], &bytes)) bytes = UINT64_MAX;
  if (in->max_voxel_bytes && bytes > in->max_voxel_bytes) {
    tc_set_error(error, TC_ERROR_LIMIT, NULL,
                 "the volume holds %" G_GUINT64_FORMAT " bytes of voxels, more than the limit of %" G_GUINT64_FORMAT,
                 bytes, in->max_voxel_bytes);
    return NULL;
  }
  if (in->reserve && !in->reserve(in->user, bytes, error)) return NULL;
  tc_volume *volume = tc_volume_new(&desc, error);
  if (volume) tc_volume_set_provenance(volume, &from);
  return volume;
}

static bool take_want(const tc_wire_reader *in, GError **error) {
  uint8_t body[8];
  if (!in->read(in->user, body, sizeof body, error)) return false;
  tc_reader r;
  tc_reader_init(&r, body, sizeof body, false);
  return !in->reserve || in->reserve(in->user, tc_reader_u64(&r), error);
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

/* A volume on its way. */
typedef struct filling {
  tc_volume *volume; /* NULL before HEAD */
  size_t done, total;
} filling;

static bool take_voxels(const tc_wire_reader *in, filling *f, GError **error) {
  uint8_t body[8];
  if (!in->read(in->user, body, sizeof body, error)) return false;
  tc_reader r;
  tc_reader_init(&r, body, sizeof body, false);
  uint32_t slot = tc_reader_u32(&r), bytes = tc_reader_u32(&r);
  if (slot >= TC_WIRE_SLOTS || bytes > TC_WIRE_SLOT_BYTES) return broken(error, "slot");
  if (!f->volume || bytes > f->total - f->done) return broken(error, "more voxels than announced");
  memcpy((char *)tc_volume_voxels(f->volume) + f->done, in->ring + (size_t)slot * TC_WIRE_SLOT_BYTES, bytes);
  f->done += bytes;
  in->reply(in->user, TC_WIRE_FREE, -1);
  return true;
}

static bool take_volume(const tc_wire_reader *in, filling *f, GError **error) {
  if (f->volume) return broken(error, "two volume headers");
  f->volume = volume_for(in, error);
  f->total = f->volume ? tc_volume_bytes(f->volume) : 0;
  return f->volume != NULL;
}

static bool take(const tc_wire_reader *in, uint32_t kind, filling *f, GError **error) {
  switch (kind) {
  case TC_WIRE_PROGRESS: return take_progress(in, error);
  case TC_WIRE_WANT: return take_want(in, error);
  case TC_WIRE_OPEN: return take_open(in, error);
  case TC_WIRE_HEAD: return take_volume(in, f, error);
  case TC_WIRE_VOXELS: return take_voxels(in, f, error);
  case TC_WIRE_FAIL: return take_fail(in, error);
  default: return broken(error, "message out of place");
  }
}

tc_volume *tc_wire_load(const tc_wire_reader *in, GError **error) {
  filling f = {0};
  message m;
  bool ok = true;
  while ((ok = next_message(in, &m, error)) && m.kind != TC_WIRE_END && (ok = take(in, m.kind, &f, error)))
    continue;
  if (ok && (!f.volume || f.done != f.total)) ok = broken(error, "fewer voxels than announced");
  if (ok) return f.volume;
  tc_volume_unref(f.volume);
  return NULL;
}

static bool take_series(const tc_wire_reader *in, GArray *list, GError **error) {
  uint8_t body[TC_WIRE_SERIES_BYTES];
  tc_series series = {0};
  if (!in->read(in->user, body, sizeof body, error)) return false;
  if (list->len >= TC_WIRE_SERIES_MAX) return broken(error, "too many series");
  tc_reader r;
  tc_reader_init(&r, body, sizeof body, false);
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
