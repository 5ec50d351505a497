/* The one entry for every format: which file is what, by content first and by name second. */
#include "renderer/import/import.h"

#include <string.h>
#include <sys/stat.h>

#include "renderer/import/dicom.h"
#include "renderer/import/format.h"

static const tc_format *const formats[] = {&tc_format_nifti, &tc_format_nrrd, &tc_format_metaimage};

typedef struct target {
  char *path;   /* without a series suffix; owned */
  char *series; /* text after '#', or NULL; owned */
  bool folder;
} target;

static void target_clear(target *t) {
  g_clear_pointer(&t->path, g_free);
  g_clear_pointer(&t->series, g_free);
}

/* A '#' may be part of a name: it starts a suffix only where the whole path does not exist. A suffix has one part or
 * two ("#2#volume=3"). */
static bool find_target(const char *path, target *t, GError **error) {
  struct stat st;
  *t = (target){.path = g_strdup(path)};
  bool found = stat(path, &st) == 0;
  for (int part = 0; !found && part < 2; part++) {
    char *hash = strrchr(t->path, '#');
    if (!hash || hash == t->path) break;
    *hash = '\0';
    g_free(t->series);
    t->series = g_strdup(path + (hash - t->path) + 1);
    found = stat(t->path, &st) == 0;
  }
  if (!found) {
    tc_set_error(error, TC_ERROR_NOT_FOUND, NULL, "no such file or folder");
    target_clear(t);
    return false;
  }
  t->folder = S_ISDIR(st.st_mode);
  return true;
}

/* ---- what the content is ---- */

static bool has_suffix(const char *name, const char *suffixes) {
  char *lower = g_ascii_strdown(name, -1), **list = g_strsplit(suffixes, "|", -1);
  bool found = false;
  for (char **s = list; *s; s++)
    if (g_str_has_suffix(lower, *s)) found = true;
  g_strfreev(list);
  g_free(lower);
  return found;
}

typedef enum kind { KIND_DICOM, KIND_FORMAT, KIND_UNKNOWN } kind;

static kind recognise(const char *path, const uint8_t *head, size_t size, bool gzip, const tc_format **format) {
  for (size_t i = 0; i < G_N_ELEMENTS(formats); i++)
    if ((!gzip || formats[i]->compressed) && formats[i]->probe(head, size)) {
      *format = formats[i];
      return KIND_FORMAT;
    }
  if (tc_dicom_probe(path)) return KIND_DICOM;
  for (size_t i = 0; i < G_N_ELEMENTS(formats); i++)
    if (has_suffix(path, formats[i]->suffixes)) {
      *format = formats[i];
      return KIND_FORMAT;
    }
  return !gzip && has_suffix(path, ".dcm|.ima|.zip") ? KIND_DICOM : KIND_UNKNOWN;
}

/* The .img of a NIfTI pair was named: its header tells what it is. */
static bool use_header_beside(tc_input *input, GError **error) {
  uint8_t head[TC_PROBE_BYTES];
  size_t size;
  bool gzip;
  tc_input header;
  if (!has_suffix(input->name, ".img|.img.gz")) return true;
  char *name = g_strdup(input->name);
  memcpy(g_strrstr(name, ".") - (has_suffix(name, ".gz") ? 4 : 0), ".hdr", 5);
  bool found = tc_input_open_sibling(input, name, &header, NULL);
  g_free(name);
  if (!found) return true;
  if (!tc_input_head(&header, head, sizeof head, &size, &gzip, error)) {
    tc_input_close(&header);
    return false;
  }
  if (!tc_format_nifti.probe(head, size)) {
    tc_input_close(&header);
    return true;
  }
  header.folder_fd = input->folder_fd;
  input->folder_fd = -1;
  tc_input_close(input);
  *input = header;
  return true;
}

/* What "#volume=N" says of a file that is not DICOM; 0 without it. */
static bool read_volume(const target *t, const tc_format *format, uint32_t *volume, GError **error) {
  guint64 number = 0;
  *volume = 0;
  if (!t->series) return true;
  if (g_str_has_prefix(t->series, "volume=") && g_ascii_string_to_unsigned(t->series + 7, 10, 1, 1 << 24, &number, NULL)) {
    *volume = (uint32_t)number;
    return true;
  }
  tc_set_error(error, TC_ERROR_INVALID, NULL, "%s holds no series: after '#' give nothing, or volume=N", format->name);
  return false;
}

static tc_volume *read_format(const target *t, const tc_format *format, const tc_input *input,
                              const tc_import_options *options, GError **error) {
  tc_import_options own = options ? *options : (tc_import_options){0};
  uint32_t volume;
  if (!read_volume(t, format, &volume, error)) return NULL;
  if (volume) own.volume = volume;
  return format->read(input, &own, error);
}

static tc_volume *import_file(const target *t, const tc_import_options *options, GError **error) {
  uint8_t head[TC_PROBE_BYTES];
  size_t size;
  bool gzip;
  const tc_format *format = NULL;
  tc_volume *volume = NULL;
  tc_input input;
  if (!tc_input_open(&input, t->path, error)) return NULL;
  input.alone = options && options->self_contained;
  if (!use_header_beside(&input, error) || !tc_input_head(&input, head, sizeof head, &size, &gzip, error)) goto out;
  if (input.size == 0) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "the file is empty");
    goto out;
  }
  switch (recognise(t->path, head, size, gzip, &format)) {
  case KIND_DICOM: volume = tc_import_dicom(t->path, t->series, options, error); break;
  case KIND_FORMAT: volume = read_format(t, format, &input, options, error); break;
  case KIND_UNKNOWN:
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "%s: NIfTI, NRRD, MetaImage and DICOM are read",
                 gzip ? "a gzip file that holds no NIfTI image" : "unknown kind of file");
    break;
  }
out:
  tc_input_close(&input);
  return volume;
}

/* The base name for a message: one line, whatever the file is called. */
static char *shown_name(const char *path) {
  char *name = g_path_get_basename(path);
  for (char *at = name; *at; at++)
    if (g_ascii_iscntrl(*at)) *at = '?';
  return name;
}

tc_volume *tc_import(const char *path, const tc_import_options *options, GError **error) {
  if (g_str_has_prefix(path, "demo:")) {
    const uint64_t bytes = tc_volume_demo_bytes(path + 5);
    if (bytes && options && options->reserve && !options->reserve(options->user, bytes, error)) return NULL;
    return tc_volume_demo(path + 5, error);
  }
  target t = {0};
  tc_volume *volume = NULL;
  GError *trouble = NULL;
  if (find_target(path, &t, &trouble)) {
    volume = t.folder ? tc_import_dicom(t.path, t.series, options, &trouble) : import_file(&t, options, &trouble);
    target_clear(&t);
  }
  if (volume) return volume;
  char *name = shown_name(path);
  g_propagate_prefixed_error(error, trouble, "open %s: ", name);
  g_free(name);
  return NULL;
}

bool tc_import_list(const char *path, const tc_import_options *options, tc_series **series, size_t *count,
                    GError **error) {
  uint8_t head[TC_PROBE_BYTES];
  size_t size;
  bool gzip, ok = true, dicom = false;
  const tc_format *format;
  target t;
  tc_input input;
  GError *trouble = NULL;
  *series = NULL;
  *count = 0;
  if (g_str_has_prefix(path, "demo:")) return true;
  ok = find_target(path, &t, &trouble);
  if (ok && !t.folder) {
    ok = tc_input_open(&input, t.path, &trouble);
    if (ok) {
      ok = tc_input_head(&input, head, sizeof head, &size, &gzip, &trouble);
      dicom = ok && recognise(t.path, head, size, gzip, &format) == KIND_DICOM;
      tc_input_close(&input);
    }
  }
  if (ok && (t.folder || dicom)) ok = tc_import_dicom_list(t.path, options, series, count, &trouble);
  target_clear(&t);
  if (ok) return true;
  char *name = shown_name(path);
  g_propagate_prefixed_error(error, trouble, "open %s: ", name);
  g_free(name);
  return false;
}
