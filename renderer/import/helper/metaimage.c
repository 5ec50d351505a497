/* MetaImage: .mha (data in the file) and .mhd (data in a separate file). Row k of TransformMatrix is the direction of
 * index axis k; Offset and directions are LPS mm, as in ITK. */
#include <math.h>
#include <string.h>

#include "renderer/import/helper/convert.h"
#include "renderer/import/helper/format.h"
#include "renderer/import/helper/names.h"
#include "renderer/import/reader.h"

/* The header is text up to ElementDataFile; names of a LIST follow it. */
#define LINE_LIMIT 65536u
enum { max_dims = 6 };

typedef struct meta_header {
  int64_t n_dims, channels, header_size;
  double sizes[max_dims], spacing[max_dims], element_size[max_dims], offset[max_dims], matrix[max_dims * max_dims];
  int n_sizes, n_spacing, n_element_size, n_offset, n_matrix;
  int element; /* tc_element, or -1 */
  bool big_endian, compressed, text;
  char modality[16];
  char *data_file;
  size_t data_at; /* first byte after the line of ElementDataFile */
} meta_header;

typedef enum key_kind { KEY_INT, KEY_LIST, KEY_BOOL, KEY_ASCII, KEY_TYPE, KEY_MODALITY, KEY_DATA } key_kind;

/* Destination of each key; other keys are ignored. */
static const struct {
  const char *name;
  key_kind kind;
  size_t to, count; /* offsets in meta_header */
  int most;         /* largest number of values in a list */
} keys[] = {
#define LIST(key, member, most) {key, KEY_LIST, offsetof(meta_header, member), offsetof(meta_header, n_##member), most}
    {"NDims", KEY_INT, offsetof(meta_header, n_dims), 0, 0},
    {"HeaderSize", KEY_INT, offsetof(meta_header, header_size), 0, 0},
    {"ElementNumberOfChannels", KEY_INT, offsetof(meta_header, channels), 0, 0},
    LIST("DimSize", sizes, max_dims),
    LIST("ElementSpacing", spacing, max_dims),
    LIST("ElementSize", element_size, max_dims),
    LIST("Offset", offset, max_dims),
    LIST("Position", offset, max_dims),
    LIST("Origin", offset, max_dims),
    LIST("TransformMatrix", matrix, max_dims * max_dims),
    LIST("Orientation", matrix, max_dims * max_dims),
    LIST("Rotation", matrix, max_dims * max_dims),
    {"BinaryDataByteOrderMSB", KEY_BOOL, offsetof(meta_header, big_endian), 0, 0},
    {"ElementByteOrderMSB", KEY_BOOL, offsetof(meta_header, big_endian), 0, 0},
    {"CompressedData", KEY_BOOL, offsetof(meta_header, compressed), 0, 0},
    {"BinaryData", KEY_ASCII, offsetof(meta_header, text), 0, 0},
    {"ElementType", KEY_TYPE, 0, 0, 0},
    {"Modality", KEY_MODALITY, 0, 0, 0},
    {"ElementDataFile", KEY_DATA, 0, 0, 0},
#undef LIST
};

static int element_of(const char *name) {
  static const struct { const char *name; tc_element element; } types[] = {
      {"MET_CHAR", TC_ELEMENT_I8},    {"MET_UCHAR", TC_ELEMENT_U8},   {"MET_SHORT", TC_ELEMENT_I16},
      {"MET_USHORT", TC_ELEMENT_U16}, {"MET_INT", TC_ELEMENT_I32},    {"MET_UINT", TC_ELEMENT_U32},
      {"MET_LONG", TC_ELEMENT_I32},   {"MET_ULONG", TC_ELEMENT_U32}, /* 4 bytes by definition on any machine */
      {"MET_LONG_LONG", TC_ELEMENT_I64}, {"MET_ULONG_LONG", TC_ELEMENT_U64},
      {"MET_FLOAT", TC_ELEMENT_F32},  {"MET_DOUBLE", TC_ELEMENT_F64},
  };
  for (size_t i = 0; i < G_N_ELEMENTS(types); i++) {
    size_t n = strlen(types[i].name);
    if (strncmp(name, types[i].name, n) == 0 && (name[n] == '\0' || strcmp(name + n, "_ARRAY") == 0))
      return (int)types[i].element;
  }
  return -1;
}

static bool is_true(const char *text) { return g_ascii_toupper(text[0]) == 'T' || text[0] == '1'; }

static void complain(GError **error, const char *key, const char *value, const char *wanted) {
  char *quoted = tc_text_quote(value);
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "%s = %s: %s expected", key, quoted, wanted);
  g_free(quoted);
}

/* "MET_MOD_CT" -> "CT" */
static void set_modality(meta_header *h, const char *value) {
  if (strncmp(value, "MET_MOD_", 8) == 0) value += 8;
  static const char *const known[] = {"CT", "MR", "US", "NM", "PT"};
  for (size_t i = 0; i < G_N_ELEMENTS(known); i++)
    if (g_ascii_strcasecmp(value, known[i]) == 0) g_strlcpy(h->modality, known[i], sizeof h->modality);
}

static bool set_key(meta_header *h, const char *key, const char *value, GError **error) {
  size_t i = 0;
  while (i < G_N_ELEMENTS(keys) && strcmp(keys[i].name, key) != 0) i++;
  if (i == G_N_ELEMENTS(keys)) return true;
  void *to = (char *)h + keys[i].to;
  switch (keys[i].kind) {
  case KEY_INT:
    if (tc_text_integer(value, -1, INT64_MAX, to)) return true;
    complain(error, key, value, "a whole number");
    return false;
  case KEY_LIST: {
    int count = tc_text_numbers(value, to, keys[i].most);
    *(int *)((char *)h + keys[i].count) = count;
    if (count >= 1 && count <= keys[i].most) return true;
    complain(error, key, value, "numbers, for at most 6 dimensions,");
    return false;
  }
  case KEY_BOOL: *(bool *)to = is_true(value); return true;
  case KEY_ASCII: *(bool *)to = !is_true(value); return true;
  case KEY_TYPE:
    h->element = element_of(value);
    if (h->element >= 0) return true;
    complain(error, key, value, "MET_UCHAR, MET_SHORT ... MET_DOUBLE");
    return false;
  case KEY_MODALITY: set_modality(h, value); return true;
  case KEY_DATA:
    g_free(h->data_file);
    h->data_file = g_strdup(value);
    return true;
  }
  return true;
}

/* "key = value", trimmed in place; false for a line without '='. */
static bool split_line(char *line, char **key, char **value) {
  char *equals = strchr(line, '=');
  if (!equals) return false;
  *equals = '\0';
  *key = g_strstrip(line);
  *value = g_strstrip(equals + 1);
  return true;
}

static bool parse(meta_header *h, tc_reader *r, GError **error) {
  *h = (meta_header){.element = -1, .channels = 1};
  bool ok = true;
  for (int number = 1; ok && !h->data_file; number++) {
    char *line = tc_reader_line(r, LINE_LIMIT), *key, *value;
    if (!line) {
      tc_set_error(error, TC_ERROR_FORMAT, NULL, "header ends at line %d without ElementDataFile", number);
      return false;
    }
    if (split_line(line, &key, &value)) {
      ok = set_key(h, key, value, error);
    } else if (*g_strstrip(line) != '\0') {
      tc_set_error(error, TC_ERROR_FORMAT, NULL, "KEY = VALUE expected");
      ok = false;
    }
    if (!ok) g_prefix_error(error, "header line %d: ", number);
    g_free(line);
  }
  h->data_at = r->at;
  return ok;
}

static bool probe(const uint8_t *head, size_t size) {
  tc_reader r;
  tc_reader_init(&r, head, size, false);
  for (int i = 0; i < 16; i++) {
    char *line = tc_reader_line(&r, TC_PROBE_BYTES), *key, *value;
    if (!line) return false;
    bool pair = split_line(line, &key, &value);
    bool found = pair && ((strcmp(key, "ObjectType") == 0 && strcmp(value, "Image") == 0) || strcmp(key, "NDims") == 0);
    g_free(line);
    if (!pair) return false;
    if (found) return true;
  }
  return false;
}

static bool set_dims(tc_raster *raster, const meta_header *h, GError **error) {
  if (h->n_dims < 2 || h->n_dims > max_dims || h->n_sizes != h->n_dims) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL,
                 "NDims is %" G_GINT64_FORMAT " with %d sizes in DimSize: 2 to %d expected, one size each", h->n_dims,
                 h->n_sizes, max_dims);
    return false;
  }
  for (int i = 0; i < h->n_dims; i++) {
    double size = h->sizes[i];
    if (!(size >= 1 && size <= INT32_MAX) || size != floor(size)) {
      tc_set_error(error, TC_ERROR_FORMAT, NULL, "DimSize: size %d is %g, a whole number from 1 on expected", i + 1,
                   size);
      return false;
    }
    if (i < 3)
      raster->desc.dims[i] = (int)size;
    else if (__builtin_mul_overflow(raster->frames, (uint64_t)size, &raster->frames)) {
      tc_set_error(error, TC_ERROR_LIMIT, NULL, "DimSize: more frames than any file holds");
      return false;
    }
  }
  return true;
}

static bool set_type(tc_raster *raster, const meta_header *h, GError **error) {
  if (h->element < 0) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "ElementType is missing");
    return false;
  }
  if (h->channels < 1 || h->channels > 32768) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "ElementNumberOfChannels is %" G_GINT64_FORMAT, h->channels);
    return false;
  }
  raster->element = (tc_element)h->element;
  raster->big_endian = h->big_endian;
  raster->components = (uint32_t)h->channels;
  bool colour = (h->channels == 3 || h->channels == 4) && h->element == TC_ELEMENT_U8;
  raster->combine = colour ? TC_COMBINE_LUMA : TC_COMBINE_MAGNITUDE;
  return true;
}

/* Uses the first three axes and coordinates; a 2-D image lies in the plane z = 0. */
static bool set_space(tc_raster *raster, const meta_header *h, GError **error) {
  int n = (int)h->n_dims, space = MIN(n, 3);
  const double *spacing = h->n_spacing ? h->spacing : h->element_size;
  int n_spacing = h->n_spacing ? h->n_spacing : h->n_element_size;
  double columns[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  if ((n_spacing && n_spacing < space) || (h->n_offset && h->n_offset < space) ||
      (h->n_matrix && h->n_matrix != n * n)) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL,
                 "ElementSpacing, Offset or TransformMatrix have not the numbers %d dimensions want", n);
    return false;
  }
  for (int k = 0; k < space; k++) {
    double size = n_spacing ? spacing[k] : 1;
    if (!isfinite(size) || size == 0) {
      tc_set_error(error, TC_ERROR_FORMAT, NULL, "ElementSpacing: spacing %d is %g", k + 1, size);
      return false;
    }
    for (int i = 0; i < space; i++) columns[k][i] = size * (h->n_matrix ? h->matrix[k * n + i] : i == k);
    if (h->n_offset) raster->desc.origin[k] = h->offset[k];
    if (!isfinite(raster->desc.origin[k])) {
      tc_set_error(error, TC_ERROR_FORMAT, NULL, "Offset: coordinate %d is no number", k + 1);
      return false;
    }
  }
  if (tc_raster_set_axes(raster, columns)) return true;
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "TransformMatrix: its axes are not independent");
  return false;
}

/* LIST: one file name per line up to the end of the header. */
static bool list_names(GPtrArray *names, tc_reader *r, GError **error) {
  char *line;
  while ((line = tc_reader_line(r, LINE_LIMIT))) {
    bool used = *g_strstrip(line) != '\0';
    if (used && names->len < TC_MAX_DATA_FILES) {
      g_ptr_array_add(names, line);
      continue;
    }
    g_free(line);
    if (!used) continue;
    tc_set_error(error, TC_ERROR_LIMIT, NULL, "ElementDataFile = LIST: more than %d files", TC_MAX_DATA_FILES);
    return false;
  }
  if (names->len > 0) return true;
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "ElementDataFile = LIST: no file names follow");
  return false;
}

static bool set_data(tc_raster *raster, const meta_header *h, tc_reader *r, GError **error) {
  tc_data *data = &raster->data;
  data->encoding = h->text ? TC_ENCODING_TEXT : h->compressed ? TC_ENCODING_DEFLATE : TC_ENCODING_RAW;
  if (strcmp(h->data_file, "LOCAL") == 0 || strcmp(h->data_file, "Local") == 0 || strcmp(h->data_file, "local") == 0) {
    return tc_data_attach(data, h->data_at, error);
  }
  if (!tc_input_may_name(data->input, error)) return false;
  data->names = g_ptr_array_new_with_free_func(g_free);
  if (h->header_size == -1 && data->encoding == TC_ENCODING_RAW)
    data->byte_skip = -1;
  else
    data->offset = (uint64_t)MAX(h->header_size, 0);
  bool list = strncmp(h->data_file, "LIST", 4) == 0 && (h->data_file[4] == '\0' || g_ascii_isspace(h->data_file[4]));
  if (list) return list_names(data->names, r, error);
  if (strchr(h->data_file, '%') && strpbrk(h->data_file, " \t"))
    return tc_names_from_pattern(h->data_file, data->names, NULL, error);
  g_ptr_array_add(data->names, g_strdup(h->data_file));
  return true;
}

static bool read_metaimage(const tc_input *input, const tc_order *order, GError **error) {
  size_t size;
  uint8_t *bytes = tc_input_header(input, &size, error);
  meta_header h = {0};
  tc_raster raster;
  tc_reader r;
  bool ok = false;
  tc_raster_init(&raster, "metaimage", input);
  if (!bytes) goto out;
  tc_reader_init(&r, bytes, size, false);
  if (!parse(&h, &r, error) || !set_dims(&raster, &h, error) || !set_type(&raster, &h, error)) goto out;
  if (!set_space(&raster, &h, error) || !set_data(&raster, &h, &r, error)) goto out;
  g_strlcpy(raster.desc.modality, h.modality, sizeof raster.desc.modality);
  g_free(bytes); /* freed early: not needed while voxels are read */
  bytes = NULL;
  ok = tc_raster_load(&raster, order, error);
out:
  g_free(bytes);
  g_free(h.data_file);
  tc_raster_clear(&raster);
  return ok;
}

const tc_format tc_format_metaimage = {"MetaImage", ".mha|.mhd", probe, read_metaimage};
