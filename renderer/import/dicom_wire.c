/* The parent's side of the helper's stream. It believes none of it: caps on every length, a range for every number. */
#include "renderer/import/dicom_wire.h"

#include <math.h>
#include <string.h>

#include "renderer/import/reader.h"

typedef struct message {
  uint32_t kind, length;
} message;

static bool broken(GError **error, const char *what) {
  tc_set_error(error, TC_ERROR_FORMAT, NULL,
               "the DICOM decoder's answer makes no sense (%s); the file is probably damaged", what);
  return false;
}

/* The longest body of a kind; a kind not known has none. */
static bool length_fits(const message *m) {
  switch (m->kind) {
  case TC_DICOM_PROGRESS:
    return m->length == 8;
  case TC_DICOM_SERIES:
    return m->length == TC_DICOM_SERIES_BYTES;
  case TC_DICOM_HEAD:
    return m->length == TC_DICOM_HEAD_BYTES;
  case TC_DICOM_VOXELS:
    return m->length > 0 && m->length <= TC_DICOM_CHUNK_BYTES;
  case TC_DICOM_FAIL:
    return m->length == 4 + TC_DICOM_FAIL_TEXT;
  case TC_DICOM_END:
    return m->length == 0;
  default:
    return false;
  }
}

static bool next_message(const tc_dicom_wire_reader *in, message *m, GError **error) {
  uint8_t header[TC_DICOM_HEADER_BYTES];
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
static bool take_fail(const tc_dicom_wire_reader *in, GError **error) {
  uint8_t body[4 + TC_DICOM_FAIL_TEXT];
  char text[TC_DICOM_FAIL_TEXT];
  if (!in->read(in->user, body, sizeof body, error)) return false;
  tc_reader r;
  tc_reader_init(&r, body, sizeof body, false);
  uint32_t code = tc_reader_u32(&r);
  take_text(&r, text, sizeof text);
  bool allowed = code == TC_ERROR_FORMAT || code == TC_ERROR_LIMIT || code == TC_ERROR_UNSUPPORTED ||
                 code == TC_ERROR_NOT_FOUND || code == TC_ERROR_IO || code == TC_ERROR_MEMORY ||
                 code == TC_ERROR_INVALID;
  tc_set_error(error, allowed ? (tc_error_code)code : TC_ERROR_FORMAT, NULL, "%s",
               text[0] ? text : "the DICOM decoder gave up without a reason");
  return false;
}

static bool tick(const tc_dicom_wire_reader *in, double fraction, GError **error) {
  if (!in->tick || in->tick(in->tick_user, fraction)) return true;
  tc_set_error(error, TC_ERROR_CANCELLED, NULL, "cancelled while reading DICOM");
  return false;
}

static bool take_progress(const tc_dicom_wire_reader *in, GError **error) {
  uint8_t body[8];
  if (!in->read(in->user, body, sizeof body, error)) return false;
  tc_reader r;
  tc_reader_init(&r, body, sizeof body, false);
  double fraction = tc_reader_f64(&r);
  if (!(fraction >= 0 && fraction <= 1)) return broken(error, "progress");
  return tick(in, fraction, error);
}

static bool within(const double *values, int count, double limit) {
  for (int i = 0; i < count; i++)
    if (!isfinite(values[i]) || fabs(values[i]) > limit) return false;
  return true;
}

/* Ranges of every number of the head; products are tc_volume_new()'s to check. */
static bool head_is_sane(const tc_volume_desc *d) {
  for (int i = 0; i < 3; i++)
    if (d->dims[i] < 1 || d->dims[i] > (1 << 20) || !(d->spacing[i] >= 1e-6 && d->spacing[i] <= 1e6)) return false;
  for (int k = 0; k < 3; k++) {
    double x = d->direction[k], y = d->direction[3 + k], z = d->direction[6 + k];
    if (!(fabs(sqrt(x * x + y * y + z * z) - 1) < 1e-3)) return false;
  }
  return within(d->origin, 3, 1e9) && within(d->direction, 9, 1.01) && within(&d->slope, 1, 1e30) && d->slope != 0 &&
         within(&d->intercept, 1, 1e30) && within(&d->window_center, 1, 1e30) && within(&d->window_width, 1, 1e30) &&
         d->window_width >= 0 && d->frames >= 1 && d->frames <= (1 << 24);
}

static bool provenance_is_sane(const tc_provenance *from, const tc_volume_desc *d) {
  return from->volume >= 0 && from->volume <= d->frames && from->slices_used >= 0 &&
         from->slices_used <= from->slices_found && from->bridged >= 0 && from->bridged <= d->dims[2];
}

static bool take_head(const tc_dicom_wire_reader *in, tc_volume_desc *desc, tc_provenance *from, GError **error) {
  uint8_t body[TC_DICOM_HEAD_BYTES];
  double numbers[TC_DICOM_HEAD_NUMBERS];
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
  for (int i = 0; i < TC_DICOM_HEAD_NUMBERS; i++)
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
  g_strlcpy(desc->format, "dicom", sizeof desc->format);
  if (r.failed || type >= TC_VOXEL_TYPE_COUNT || !head_is_sane(desc) || !provenance_is_sane(from, desc))
    return broken(error, "volume header");
  desc->type = (tc_voxel_type)type;
  return true;
}

static tc_volume *volume_for(const tc_dicom_wire_reader *in, GError **error) {
  tc_volume_desc desc;
  tc_provenance from;
  if (!take_head(in, &desc, &from, error)) return NULL;
  uint64_t bytes = tc_voxel_size(desc.type);
  for (int i = 0; i < 3; i++)
    if (__builtin_mul_overflow(bytes, (uint64_t)desc.dims[i], &bytes)) bytes = UINT64_MAX;
  if (in->max_voxel_bytes && bytes > in->max_voxel_bytes) {
    tc_set_error(error, TC_ERROR_LIMIT, NULL,
                 "the series holds %" G_GUINT64_FORMAT " bytes of voxels, more than the limit of %" G_GUINT64_FORMAT,
                 bytes, in->max_voxel_bytes);
    return NULL;
  }
  if (in->reserve && !in->reserve(in->tick_user, bytes, error)) return NULL;
  tc_volume *volume = tc_volume_new(&desc, error);
  if (volume) tc_volume_set_provenance(volume, &from);
  return volume;
}

tc_volume *tc_dicom_wire_load(const tc_dicom_wire_reader *in, GError **error) {
  tc_volume *volume = NULL;
  size_t done = 0, total = 0;
  message m;
  while (next_message(in, &m, error)) {
    switch (m.kind) {
    case TC_DICOM_PROGRESS:
      if (!take_progress(in, error)) goto fail;
      break;
    case TC_DICOM_HEAD:
      if (volume) {
        broken(error, "two volume headers");
        goto fail;
      }
      if (!(volume = volume_for(in, error))) goto fail;
      total = tc_volume_bytes(volume);
      break;
    case TC_DICOM_VOXELS:
      if (!volume || m.length > total - done) {
        broken(error, "more voxels than announced");
        goto fail;
      }
      if (!in->read(in->user, (char *)tc_volume_voxels(volume) + done, m.length, error)) goto fail;
      done += m.length;
      break;
    case TC_DICOM_FAIL:
      take_fail(in, error);
      goto fail;
    case TC_DICOM_END:
      if (volume && done == total) return volume;
      broken(error, "fewer voxels than announced");
      goto fail;
    default:
      broken(error, "message out of place");
      goto fail;
    }
  }
fail:
  tc_volume_unref(volume);
  return NULL;
}

static bool take_series(const tc_dicom_wire_reader *in, GArray *list, GError **error) {
  uint8_t body[TC_DICOM_SERIES_BYTES];
  tc_series series = {0};
  if (!in->read(in->user, body, sizeof body, error)) return false;
  if (list->len >= TC_DICOM_SERIES_MAX) return broken(error, "too many series");
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

bool tc_dicom_wire_list(const tc_dicom_wire_reader *in, tc_series **series, size_t *count, GError **error) {
  GArray *list = g_array_new(FALSE, TRUE, sizeof(tc_series));
  bool ok = true, ended = false;
  message m;
  while (ok && !ended && (ok = next_message(in, &m, error))) {
    if (m.kind == TC_DICOM_PROGRESS)
      ok = take_progress(in, error);
    else if (m.kind == TC_DICOM_SERIES)
      ok = take_series(in, list, error);
    else if (m.kind == TC_DICOM_FAIL)
      ok = take_fail(in, error);
    else if (m.kind == TC_DICOM_END)
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
