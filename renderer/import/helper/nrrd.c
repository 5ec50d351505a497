/* NRRD 1 to 5: the header's text, attached and detached data. */
#include "renderer/import/helper/nrrd.h"

#include <stdarg.h>
#include <string.h>

#include "renderer/import/helper/format.h"
#include "renderer/import/helper/names.h"
#include "renderer/import/reader.h"

#define LINE_LIMIT 65536u
#define MOST_SEGMENTS 4096u

static const char *const field_names[NRRD_FIELD_COUNT] = {
    "type",           "dimension",        "sizes",        "encoding",    "endian",   "space",     "space dimension",
    "space directions", "space origin",   "space units",  "spacings",    "axis mins", "axis maxs", "centerings",
    "kinds",          "units",            "line skip",    "byte skip",   "data file", "sample units",
};

static const struct { const char *name; tc_nrrd_field field; } other_names[] = {
    {"axismins", NRRD_AXIS_MINS},  {"axismaxs", NRRD_AXIS_MAXS}, {"centers", NRRD_CENTERINGS},
    {"lineskip", NRRD_LINE_SKIP},  {"byteskip", NRRD_BYTE_SKIP}, {"datafile", NRRD_DATA_FILE},
    {"sampleunits", NRRD_SAMPLE_UNITS},
};


void tc_nrrd_error(const tc_nrrd_header *header, tc_nrrd_field field, tc_error_code code, GError **error,
                   const char *format, ...) {
  va_list args;
  va_start(args, format);
  char *what = g_strdup_vprintf(format, args);
  va_end(args);
  if (header->fields[field])
    tc_set_error(error, code, NULL, "header line %d: %s: %s", header->lines[field], field_names[field], what);
  else
    tc_set_error(error, code, NULL, "%s: %s", field_names[field], what);
  g_free(what);
}

/* ---- the header's text ---- */

static int find_field(const char *name) {
  for (int i = 0; i < NRRD_FIELD_COUNT; i++)
    if (g_ascii_strcasecmp(name, field_names[i]) == 0) return i;
  for (size_t i = 0; i < G_N_ELEMENTS(other_names); i++)
    if (g_ascii_strcasecmp(name, other_names[i].name) == 0) return (int)other_names[i].field;
  return -1;
}

/* The segment of a number, made where there is none yet. NULL: there are too many. */
static tc_layered *segment_of(tc_nrrd_header *h, int64_t number) {
  if (!h->segments) h->segments = g_array_new(FALSE, FALSE, sizeof(tc_layered));
  for (guint i = 0; i < h->segments->len; i++) {
    tc_layered *s = &g_array_index(h->segments, tc_layered, i);
    if (s->number == number) return s;
  }
  if (h->segments->len >= MOST_SEGMENTS) return NULL;
  const tc_layered made = {.number = number};
  g_array_append_val(h->segments, made);
  return &g_array_index(h->segments, tc_layered, h->segments->len - 1);
}

/* "Segment0_Name:=liver", as 3D Slicer writes it; also of its colour, value and layer. */
static bool take_segment(tc_nrrd_header *h, const char *key, const char *value) {
  char *what;
  if (strncmp(key, "Segment", 7) != 0 || !g_ascii_isdigit(key[7])) return false;
  const int64_t number = g_ascii_strtoll(key + 7, &what, 10);
  int64_t n;
  double rgb[3];
  tc_layered *s = *what == '_' ? segment_of(h, number) : NULL;
  if (!s) return *what == '_';
  if (strcmp(what, "_Name") == 0) {
    g_strlcpy(s->segment.name, value, sizeof s->segment.name);
    const char *end;
    g_utf8_validate(s->segment.name, -1, &end); /* a character that was cut */
    s->segment.name[end - s->segment.name] = 0;
  }
  if (strcmp(what, "_Color") == 0 && tc_text_numbers(value, rgb, 3) == 3) {
    s->segment.has_color = true;
    for (int c = 0; c < 3; c++) s->segment.color[c] = (float)CLAMP(rgb[c], 0, 1);
  }
  if (strcmp(what, "_LabelValue") == 0 && tc_text_integer(value, 0, TC_SEGMENTS_MAX, &n)) s->value = (uint32_t)n;
  if (strcmp(what, "_Layer") == 0 && tc_text_integer(value, 0, TC_SEGMENTS_MAX, &n)) s->layer = (uint32_t)n;
  return true;
}

/* "modality:=CT", "DICOM.Modality:=CT", and segments: the keys a renderer can use. */
static void take_pair(tc_nrrd_header *h, const char *key, const char *value) {
  if (take_segment(h, key, value)) return;
  const char *dot = strrchr(key, '.');
  if (g_ascii_strcasecmp(dot ? dot + 1 : key, "modality") != 0) return;
  size_t n = strspn(value, "ABCDEFGHIJKLMNOPQRSTUVWXYZ");
  if (n > 0 && n < sizeof h->modality && value[n] == '\0') g_strlcpy(h->modality, value, sizeof h->modality);
}

static bool take_line(tc_nrrd_header *h, char *line, int number, GError **error) {
  char *colon = strchr(line, ':');
  if (!colon) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "header line %d: FIELD: VALUE expected", number);
    return false;
  }
  *colon = '\0';
  bool pair = colon[1] == '=';
  char *name = g_strstrip(line), *value = g_strstrip(colon + (pair ? 2 : 1));
  if (pair) {
    take_pair(h, name, value);
    return true;
  }
  int field = find_field(name);
  if (field < 0) return true; /* says nothing a renderer needs */
  if (h->fields[field]) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "header line %d: %s: given twice, first on line %d", number,
                 field_names[field], h->lines[field]);
    return false;
  }
  h->fields[field] = g_strdup(value);
  h->lines[field] = number;
  return true;
}

/* LIST: the rest of the header is a file name per line. */
static bool take_list(tc_nrrd_header *h, tc_reader *r, GError **error) {
  char *line;
  while ((line = tc_reader_line(r, LINE_LIMIT))) {
    bool used = *g_strstrip(line) != '\0';
    if (used && h->names->len < TC_MAX_DATA_FILES) {
      g_ptr_array_add(h->names, line);
      continue;
    }
    g_free(line);
    if (!used) continue;
    tc_nrrd_error(h, NRRD_DATA_FILE, TC_ERROR_LIMIT, error, "LIST of more than %d files", TC_MAX_DATA_FILES);
    return false;
  }
  if (h->names->len > 0) return true;
  tc_nrrd_error(h, NRRD_DATA_FILE, TC_ERROR_FORMAT, error, "LIST without file names");
  return false;
}

static bool is_list(const char *value) { return strncmp(value, "LIST", 4) == 0 && !g_ascii_isgraph(value[4]); }

static bool magic_ok(const char *line, GError **error) {
  bool known = strlen(line) == 8 && memcmp(line, "NRRD000", 7) == 0 && line[7] >= '1' && line[7] <= '5';
  if (known || strcmp(line, "NRRD00.01") == 0) return true;
  char *quoted = tc_text_quote(line);
  tc_set_error(error, TC_ERROR_UNSUPPORTED, NULL, "header line 1: %s is no NRRD version this reads (NRRD0001 to 5)",
               quoted);
  g_free(quoted);
  return false;
}

static bool parse(tc_nrrd_header *h, tc_reader *r, GError **error) {
  char *line = tc_reader_line(r, LINE_LIMIT);
  bool ok = line && magic_ok(line, error), ended = false;
  if (!line) tc_set_error(error, TC_ERROR_FORMAT, NULL, "no header");
  g_free(line);
  for (int number = 2; ok && !ended; number++) {
    line = tc_reader_line(r, LINE_LIMIT);
    if (!line && r->failed) {
      tc_set_error(error, TC_ERROR_FORMAT, NULL, "header line %d: longer than %u bytes", number, LINE_LIMIT);
      ok = false;
    }
    ended = !line || line[0] == '\0';
    if (!line && ok && !h->fields[NRRD_DATA_FILE]) {
      tc_set_error(error, TC_ERROR_FORMAT, NULL, "header ends at line %d without an empty line and data", number);
      ok = false;
    }
    if (ok && !ended && line[0] != '#') ok = take_line(h, line, number, error);
    const char *file = h->fields[NRRD_DATA_FILE];
    if (ok && !ended && file && h->lines[NRRD_DATA_FILE] == number) {
      h->names = g_ptr_array_new_with_free_func(g_free);
      if (is_list(file)) {
        ok = take_list(h, r, error);
        ended = true;
      }
    }
    g_free(line);
  }
  h->data_at = r->at;
  return ok;
}

/* ---- meaning ---- */

static bool want_field(const tc_nrrd_header *h, tc_nrrd_field field, GError **error) {
  if (h->fields[field]) return true;
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "%s: missing", field_names[field]);
  return false;
}

static bool set_sizes(tc_nrrd_header *h, GError **error) {
  int64_t dimension;
  double sizes[tc_nrrd_max_dims];
  if (!want_field(h, NRRD_DIMENSION, error) || !want_field(h, NRRD_SIZES, error)) return false;
  if (!tc_text_integer(h->fields[NRRD_DIMENSION], 1, tc_nrrd_max_dims, &dimension)) {
    tc_nrrd_error(h, NRRD_DIMENSION, TC_ERROR_FORMAT, error, "a number from 1 to %d expected", tc_nrrd_max_dims);
    return false;
  }
  h->dimension = (int)dimension;
  int got = tc_text_numbers(h->fields[NRRD_SIZES], sizes, tc_nrrd_max_dims);
  if (got != h->dimension) {
    tc_nrrd_error(h, NRRD_SIZES, TC_ERROR_FORMAT, error, "%d values expected, got %d", h->dimension, MAX(got, 0));
    return false;
  }
  for (int i = 0; i < got; i++) {
    if (!(sizes[i] >= 1 && sizes[i] <= INT32_MAX) || sizes[i] != (int32_t)sizes[i]) {
      tc_nrrd_error(h, NRRD_SIZES, TC_ERROR_FORMAT, error, "value %d is %g, a whole number from 1 on expected", i + 1,
                    sizes[i]);
      return false;
    }
    h->sizes[i] = (uint64_t)sizes[i];
  }
  return true;
}

static bool set_type(tc_raster *raster, const tc_nrrd_header *h, GError **error) {
  static const char *const names[TC_ELEMENT_COUNT] = {
      [TC_ELEMENT_I8] = "signed char|int8|int8_t|char",
      [TC_ELEMENT_U8] = "uchar|unsigned char|uint8|uint8_t",
      [TC_ELEMENT_I16] = "short|short int|signed short|signed short int|int16|int16_t",
      [TC_ELEMENT_U16] = "ushort|unsigned short|unsigned short int|uint16|uint16_t",
      [TC_ELEMENT_I32] = "int|signed int|int32|int32_t",
      [TC_ELEMENT_U32] = "uint|unsigned int|uint32|uint32_t",
      [TC_ELEMENT_I64] = "longlong|long long|long long int|signed long long|signed long long int|int64|int64_t",
      [TC_ELEMENT_U64] = "ulonglong|unsigned long long|unsigned long long int|uint64|uint64_t",
      [TC_ELEMENT_F32] = "float|float32",
      [TC_ELEMENT_F64] = "double|float64",
  };
  if (!want_field(h, NRRD_TYPE, error)) return false;
  for (int e = 0; e < TC_ELEMENT_COUNT; e++) {
    char **spellings = g_strsplit(names[e], "|", -1);
    bool found = false;
    for (char **s = spellings; *s; s++)
      if (g_ascii_strcasecmp(*s, h->fields[NRRD_TYPE]) == 0) found = true;
    g_strfreev(spellings);
    if (!found) continue;
    raster->element = (tc_element)e;
    return true;
  }
  char *quoted = tc_text_quote(h->fields[NRRD_TYPE]);
  tc_nrrd_error(h, NRRD_TYPE, TC_ERROR_UNSUPPORTED, error, "%s is not read (uchar, short, ... float, double are)",
                quoted);
  g_free(quoted);
  return false;
}

static bool set_encoding(tc_raster *raster, const tc_nrrd_header *h, GError **error) {
  static const struct { const char *name; tc_encoding encoding; } known[] = {
      {"raw", TC_ENCODING_RAW},      {"gzip", TC_ENCODING_DEFLATE}, {"gz", TC_ENCODING_DEFLATE},
      {"bzip2", TC_ENCODING_BZIP2},  {"bz2", TC_ENCODING_BZIP2},    {"ascii", TC_ENCODING_TEXT},
      {"text", TC_ENCODING_TEXT},    {"txt", TC_ENCODING_TEXT},     {"hex", TC_ENCODING_HEX},
  };
  if (!want_field(h, NRRD_ENCODING, error)) return false;
  size_t i = 0;
  while (i < G_N_ELEMENTS(known) && g_ascii_strcasecmp(known[i].name, h->fields[NRRD_ENCODING]) != 0) i++;
  if (i == G_N_ELEMENTS(known)) {
    tc_nrrd_error(h, NRRD_ENCODING, TC_ERROR_UNSUPPORTED, error, "not read (raw, gzip, bzip2, ascii and hex are)");
    return false;
  }
  raster->data.encoding = known[i].encoding;
  const char *endian = h->fields[NRRD_ENDIAN];
  bool little = endian && g_ascii_strcasecmp(endian, "little") == 0;
  raster->big_endian = endian && g_ascii_strcasecmp(endian, "big") == 0;
  bool matters = tc_element_size(raster->element) > 1 && known[i].encoding != TC_ENCODING_TEXT;
  if (!matters || little || raster->big_endian) return true;
  tc_nrrd_error(h, NRRD_ENDIAN, TC_ERROR_FORMAT, error, "little or big expected for %s voxels",
                tc_element_name(raster->element));
  return false;
}

static bool set_skips(tc_raster *raster, const tc_nrrd_header *h, GError **error) {
  int64_t lines = 0, bytes = 0;
  const char *line_skip = h->fields[NRRD_LINE_SKIP], *byte_skip = h->fields[NRRD_BYTE_SKIP];
  if (line_skip && !tc_text_integer(line_skip, 0, INT64_MAX, &lines)) {
    tc_nrrd_error(h, NRRD_LINE_SKIP, TC_ERROR_FORMAT, error, "a number from 0 on expected");
    return false;
  }
  if (byte_skip && !tc_text_integer(byte_skip, -1, INT64_MAX, &bytes)) {
    tc_nrrd_error(h, NRRD_BYTE_SKIP, TC_ERROR_FORMAT, error, "a number from 0 on expected, or -1 for data at the end");
    return false;
  }
  bool text = raster->data.encoding == TC_ENCODING_TEXT || raster->data.encoding == TC_ENCODING_HEX;
  raster->data.line_skip = (uint64_t)lines;
  raster->data.byte_skip = text ? 0 : bytes;
  return h->names || tc_data_attach(&raster->data, h->data_at, error);
}

/* "data file: NAME", "PATTERN FIRST LAST STEP [DIM]" or "LIST [DIM]" (whose names are there already). DIM is how many
 * axes a file holds, by default all but the slowest. */
static bool set_names(tc_raster *raster, tc_nrrd_header *h, GError **error) {
  if (!h->names) return true;
  const char *value = h->fields[NRRD_DATA_FILE];
  int64_t within = -1;
  if (is_list(value)) {
    if (value[4] != '\0' && !tc_text_integer(value + 4, 1, h->dimension, &within)) {
      tc_nrrd_error(h, NRRD_DATA_FILE, TC_ERROR_FORMAT, error, "LIST: number of axes per file from 1 to %d expected",
                    h->dimension);
      return false;
    }
  } else if (strchr(value, '%') && strpbrk(value, " \t")) {
    if (!tc_names_from_pattern(value, h->names, &within, error)) return false;
  } else {
    g_ptr_array_add(h->names, g_strdup(value));
    within = h->dimension;
  }
  if (within < 0) within = h->dimension - 1;
  uint64_t files = 1;
  for (int i = (int)MIN(within, h->dimension); i < h->dimension; i++)
    if (__builtin_mul_overflow(files, h->sizes[i], &files)) files = UINT64_MAX, i = h->dimension;
  bool slabs = within >= h->dimension && h->sizes[h->dimension - 1] % h->names->len == 0;
  if (files != h->names->len && !slabs) {
    tc_nrrd_error(h, NRRD_DATA_FILE, TC_ERROR_FORMAT, error,
                  "%" G_GUINT64_FORMAT " files expected for these sizes, got %u", files, h->names->len);
    return false;
  }
  raster->data.names = g_ptr_array_ref(h->names);
  return true;
}

static void set_words(tc_raster *raster, const tc_nrrd_header *h) {
  g_strlcpy(raster->desc.modality, h->modality, sizeof raster->desc.modality);
  char *unit = g_strdup(h->fields[NRRD_SAMPLE_UNITS] ? h->fields[NRRD_SAMPLE_UNITS] : "");
  g_strdelimit(unit, "\"", ' ');
  g_strstrip(unit);
  bool plain = strlen(unit) < sizeof raster->desc.unit;
  for (const char *at = unit; *at; at++)
    if (!g_ascii_isgraph(*at)) plain = false;
  if (plain) g_strlcpy(raster->desc.unit, unit, sizeof raster->desc.unit);
  g_free(unit);
}

/* Values and layers of segments are the voxels'; layers are the components that are not space. */
static void set_segments(tc_raster *raster, const tc_nrrd_header *h) {
  const bool narrow = raster->element == TC_ELEMENT_U8 || raster->element == TC_ELEMENT_U16 || raster->element == TC_ELEMENT_I16;
  raster->segments = h->segments;
  if (h->segments && narrow && raster->components > 1 && raster->combine == TC_COMBINE_FIRST) raster->combine = TC_COMBINE_LAYERS;
}

static bool probe(const uint8_t *head, size_t size) {
  return size >= 8 && memcmp(head, "NRRD00", 6) == 0 && (g_ascii_isdigit(head[6]) || head[6] == '.');
}

static bool read_nrrd(const tc_input *input, const tc_order *order, GError **error) {
  size_t size;
  uint8_t *bytes = tc_input_header(input, &size, error);
  tc_nrrd_header h = {0};
  tc_raster raster;
  tc_reader r;
  bool ok = false;
  tc_raster_init(&raster, "nrrd", input);
  if (!bytes) goto out;
  tc_reader_init(&r, bytes, size, false);
  if (!parse(&h, &r, error) || (h.names && !tc_input_may_name(input, error)) || !set_sizes(&h, error) || !set_type(&raster, &h, error)) goto out;
  if (!set_encoding(&raster, &h, error) || !set_skips(&raster, &h, error) || !set_names(&raster, &h, error)) goto out;
  if (!tc_nrrd_set_axes(&raster, &h, error)) goto out;
  set_words(&raster, &h);
  set_segments(&raster, &h);
  g_free(bytes); /* not needed while the voxels are read */
  bytes = NULL;
  ok = tc_raster_load(&raster, order, error);
out:
  g_free(bytes);
  for (int i = 0; i < NRRD_FIELD_COUNT; i++) g_free(h.fields[i]);
  if (h.names) g_ptr_array_unref(h.names);
  if (h.segments) g_array_unref(h.segments);
  tc_raster_clear(&raster);
  return ok;
}

const tc_format tc_format_nrrd = {"NRRD", ".nrrd|.nhdr", probe, read_nrrd};
