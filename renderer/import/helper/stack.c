#include "renderer/import/helper/stack.h"

#include <string.h>

#include "renderer/import/helper/convert.h"
#include "renderer/import/helper/picture.h"
#include "renderer/import/reader.h"

typedef struct stack {
  const tc_dicom_sources *sources;
  GArray *order; /* size_t: indices of the sources that are pictures, in the stack's order */
  tc_picture_note note;
  uint64_t pages;
  tc_page page;
  double spacing[3]; /* mm; 0: not chosen */
  uint32_t volume;   /* from 1 */
} stack;

bool tc_stack_is(const tc_dicom_sources *sources) {
  bool found = false;
  for (size_t i = 0; i < sources->count; i++) {
    const tc_dicom_source_kind kind = tc_dicom_sources_kind(sources, i);
    if (kind == TC_SOURCE_DICOM) return false;
    found |= kind == TC_SOURCE_PICTURE;
  }
  return found;
}

/* ---- what is chosen ---- */

static bool take_spacing(stack *s, const char *text) {
  char **parts = g_strsplit(text, ",", 4), *end;
  bool ok = g_strv_length(parts) == 3;
  for (int k = 0; ok && k < 3; k++) {
    s->spacing[k] = g_ascii_strtod(parts[k], &end);
    ok = end != parts[k] && !*end && s->spacing[k] >= 1e-6 && s->spacing[k] <= 1e6;
  }
  g_strfreev(parts);
  return ok;
}

static bool take_choice(stack *s, const char *choice, GError **error) {
  char **parts = g_strsplit(choice, "#", -1);
  bool ok = true;
  for (char **part = parts; ok && *part; part++) {
    guint64 number = 0;
    if (g_str_has_prefix(*part, "spacing="))
      ok = take_spacing(s, *part + 8);
    else if (g_str_has_prefix(*part, "volume="))
      ok = g_ascii_string_to_unsigned(*part + 7, 10, 1, 1 << 24, &number, NULL);
    else
      ok = false;
    if (ok && number) s->volume = (uint32_t)number;
  }
  g_strfreev(parts);
  if (!ok)
    tc_set_error(error, TC_ERROR_INVALID, NULL, "a stack of pictures: after '#' give spacing=X,Y,Z in mm, or volume=N");
  return ok || !*choice;
}

/* ---- order ---- */

/* Compares runs of digits as numbers: "slice9" comes before "slice10". */
static int compare_names(const char *a, const char *b) {
  while (*a && *b) {
    if (g_ascii_isdigit(*a) && g_ascii_isdigit(*b)) {
      a += strspn(a, "0");
      b += strspn(b, "0");
      const size_t n = strspn(a, "0123456789"), m = strspn(b, "0123456789");
      const int order = n != m ? (n < m ? -1 : 1) : memcmp(a, b, n);
      if (order) return order;
      a += n;
      b += m;
    } else if (*a != *b) {
      return (unsigned char)*a < (unsigned char)*b ? -1 : 1;
    } else {
      a++;
      b++;
    }
  }
  return *a ? 1 : *b ? -1 : 0;
}

static int by_name(const void *a, const void *b, void *sources) {
  const size_t x = *(const size_t *)a, y = *(const size_t *)b;
  const int order = compare_names(tc_dicom_sources_name(sources, x), tc_dicom_sources_name(sources, y));
  return order ? order : x < y ? -1 : x > y;
}

static void find_pictures(stack *s) {
  for (size_t i = 0; i < s->sources->count; i++)
    if (tc_dicom_sources_kind(s->sources, i) == TC_SOURCE_PICTURE) g_array_append_val(s->order, i);
  g_array_sort_with_data(s->order, by_name, (void *)s->sources);
}

/* ---- pages ---- */

static bool open_picture(const stack *s, guint i, tc_dicom_blob *blob, tc_picture *picture, GError **error) {
  memset(picture, 0, sizeof *picture);
  GError *why = NULL;
  const bool ok =
      tc_dicom_sources_get_kind(s->sources, g_array_index(s->order, size_t, i), TC_SOURCE_PICTURE, blob, &why) &&
      tc_picture_open(picture, blob->bytes, blob->size, &why);
  if (!ok && !why) tc_set_error(&why, TC_ERROR_IO, NULL, "a picture changed while it was read");
  if (ok) return true;
  tc_picture_close(picture);
  tc_dicom_blob_finish(blob);
  g_propagate_prefixed_error(error, why, "picture %u of %u: ", i + 1, s->order->len);
  return false;
}

/* Counts the pages and describes the first. */
static bool look(stack *s, const tc_order *order, GError **error) {
  for (guint i = 0; i < s->order->len; i++) {
    tc_dicom_blob blob;
    tc_picture picture;
    if (!order->goes_on(order->user, 0, error) || !open_picture(s, i, &blob, &picture, error)) return false;
    const bool ok = i > 0 || tc_picture_page(&picture, &s->page, error);
    if (i == 0) s->note = picture.note;
    s->pages += (uint64_t)picture.pages;
    tc_picture_close(&picture);
    tc_dicom_blob_finish(&blob);
    if (!ok) return false;
  }
  return true;
}

/* Whether a page, counted over all files, belongs to the volume. Channels vary fastest, then slices, then frames. */
static bool is_wanted(const stack *s, uint64_t page) {
  const uint64_t channels = (uint64_t)s->note.channels,
                 volume = page / (channels * (uint64_t)s->note.slices) * channels + page % channels;
  return volume + 1 == s->volume;
}

static bool send_file(const stack *s, guint i, uint64_t *page, uint8_t *voxels, const tc_order *order, GError **error) {
  tc_dicom_blob blob;
  tc_picture picture;
  if (!open_picture(s, i, &blob, &picture, error)) return false;
  bool ok = true;
  for (int k = 0; ok && k < picture.pages; k++, (*page)++) {
    GError *why = NULL;
    ok = tc_picture_read(&picture, &s->page, voxels, &why);
    if (!ok)
      g_propagate_prefixed_error(error, why, "slice %" G_GUINT64_FORMAT " of %" G_GUINT64_FORMAT ": ", *page + 1,
                                 s->pages);
    if (ok && is_wanted(s, *page)) ok = tc_order_put(order, voxels, tc_page_bytes(&s->page), error);
    ok = ok && order->goes_on(order->user, (double)*page / (double)s->pages, error);
  }
  tc_picture_close(&picture);
  tc_dicom_blob_finish(&blob);
  return ok;
}

/* ---- the volume ---- */

/* Uses a note of several volumes only if the number of pages agrees. */
static void settle_note(stack *s) {
  const uint64_t noted = (uint64_t)s->note.slices * (uint64_t)s->note.channels * (uint64_t)s->note.frames;
  if (s->order->len == 1 && noted == s->pages) return;
  s->note.channels = s->note.frames = 1;
  s->note.slices = (int)MIN(s->pages, (uint64_t)INT32_MAX);
}

static void set_space(const stack *s, tc_raster *raster) {
  const bool chosen = s->spacing[0] > 0, noted = s->note.spacing[0] > 0;
  for (int k = 0; k < 3; k++) raster->desc.spacing[k] = chosen ? s->spacing[k] : noted ? s->note.spacing[k] : 1;
  if (!chosen && !noted)
    tc_raster_note(raster, "pictures have no spacing: 1 mm assumed, give it as PATH#spacing=X,Y,Z");
  tc_raster_note(raster, "pictures give no place: columns taken as left, rows as posterior, slices as head");
}

static bool describe(stack *s, tc_raster *raster, GError **error) {
  const int volumes = s->note.channels * s->note.frames;
  if (s->volume > (uint32_t)volumes) {
    tc_set_error(error, TC_ERROR_NOT_FOUND, NULL, "no volume %u: the stack holds %d", s->volume, volumes);
    return false;
  }
  raster->desc.dims[0] = s->page.width;
  raster->desc.dims[1] = s->page.height;
  raster->desc.dims[2] = s->note.slices;
  raster->desc.type = s->page.type;
  raster->desc.frames = volumes;
  set_space(s, raster);
  if (s->page.colour) tc_raster_note(raster, "colours became Rec. 709 luma (u8), but in slices");
  if (volumes > 1) tc_raster_note(raster, "volume %u of %d, choose by #volume=N", s->volume, volumes);
  return true;
}

static bool send(const stack *s, const tc_order *order, GError **error) {
  uint8_t *voxels = g_try_malloc(tc_page_bytes(&s->page));
  uint64_t page = 0;
  bool ok = voxels != NULL;
  if (!ok) tc_set_error(error, TC_ERROR_MEMORY, NULL, "no memory for a picture");
  for (guint i = 0; ok && i < s->order->len; i++) ok = send_file(s, i, &page, voxels, order, error);
  g_free(voxels);
  return ok;
}

bool tc_stack_read(const tc_dicom_sources *sources, const char *choice, const tc_order *order, GError **error) {
  stack s = {.sources = sources, .order = g_array_new(FALSE, FALSE, sizeof(size_t)), .volume = MAX(order->volume, 1)};
  tc_raster raster;
  tc_raster_init(&raster, "pictures", NULL);
  bool ok = take_choice(&s, choice, error);
  find_pictures(&s);
  ok = ok && look(&s, order, error);
  if (ok) settle_note(&s);
  const tc_provenance from = {.volume = (int)s.volume, .colors = s.page.colour};
  ok = ok && describe(&s, &raster, error) && tc_raster_begin(&raster, INT32_MAX, &from, order, error) &&
       send(&s, order, error);
  tc_raster_clear(&raster);
  g_array_unref(s.order);
  return ok;
}
