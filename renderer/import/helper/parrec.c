/* Philips PAR/REC, versions 4 to 4.2: a text header with a row for each image, and a .REC of raw images. Images are
 * grouped by the values in their rows: type, sequence, time, label, b-value, direction, phase, echo. Each group with
 * all slices is a volume of the list. Values are those of the console (rescale slope and intercept). Geometry comes
 * from the header's centre and angles, with the order of rotations documented by nibabel, against which the tests
 * compare. */
#include <math.h>
#include <string.h>

#include "renderer/import/helper/convert.h"
#include "renderer/import/helper/format.h"
#include "renderer/import/helper/stream.h"

/* Columns of a row of numbers; only 4.1 and 4.2 have the last three. */
enum {
  SLICE = 0,
  ECHO,
  TIME,
  PHASE,
  TYPE,
  SEQUENCE,
  INDEX,
  BITS,
  SIZE_X = 9,
  SIZE_Y,
  INTERCEPT,
  SLOPE,
  THICKNESS = 22,
  GAP,
  ORIENTATION = 25,
  SPACING_X = 28,
  SPACING_Y,
  B_FACTOR = 33,
  LEAST_COLUMNS = 41,
  B_VALUE = 41,
  DIRECTION,
  LABEL = 48,
  COLUMNS
};
enum { MOST_IMAGES = 1 << 17 };

/* Columns that distinguish volumes, slowest first. */
static const int keys[] = {TYPE, SEQUENCE, TIME, LABEL, B_FACTOR, B_VALUE, DIRECTION, PHASE, ECHO};

typedef struct image {
  double row[COLUMNS];
  int64_t order; /* position in the header */
  int again;     /* number of earlier images with the same keys and slice */
} image;

typedef struct parrec {
  GArray *images;              /* sorted by volume, then by slice */
  double angles[3], centre[3]; /* degrees, mm; AP, FH, RL */
  double announced_slices, announced_times;
  int slices, times, volumes, incomplete;
} parrec;

static bool probe(const uint8_t *head, size_t size) {
  static const char magic[] = "# === DATA DESCRIPTION FILE";
  return size >= sizeof magic - 1 && memcmp(head, magic, sizeof magic - 1) == 0;
}

static bool fail(tc_error_code code, GError **error, const char *what) {
  tc_set_error(error, code, NULL, "PAR header: %s", what);
  return false;
}

/* ---- the text ---- */

static bool take_row(parrec *p, char *line, GError **error) {
  image i = {.order = p->images->len};
  int column = 0;
  for (char *word; column < COLUMNS && *(word = tc_line_word(&line)); column++) {
    char *end;
    i.row[column] = g_ascii_strtod(word, &end); /* two columns of 4.1 are words, which are not needed */
    if (column < LEAST_COLUMNS && (*end || !isfinite(i.row[column])))
      return fail(TC_ERROR_FORMAT, error, "a row is not of numbers");
  }
  if (column < LEAST_COLUMNS)
    return fail(TC_ERROR_UNSUPPORTED, error, "rows of a version before 4: convert it to NIfTI (dcm2niix)");
  if (p->images->len == MOST_IMAGES) return fail(TC_ERROR_LIMIT, error, "more than 131072 images");
  g_array_append_val(p->images, i);
  return true;
}

/* ".    Angulation midslice(ap,fh,rl)[degr]  :   0.0 0.0 0.0" */
static bool take_general(parrec *p, char *line, GError **error) {
  const struct {
    const char *name;
    double *to;
    int numbers;
  } wanted[] = {{"Angulation midslice", p->angles, 3},
                {"Off Centre midslice", p->centre, 3},
                {"Max. number of slices", &p->announced_slices, 1},
                {"Max. number of dynamics", &p->announced_times, 1}};
  char *colon = strchr(line, ':');
  for (size_t i = 0; colon && i < G_N_ELEMENTS(wanted); i++) {
    if (!strstr(line, wanted[i].name)) continue;
    char *rest = colon + 1;
    for (int k = 0; k < wanted[i].numbers; k++)
      if (!tc_line_number(&rest, &wanted[i].to[k]) || !isfinite(wanted[i].to[k]))
        return fail(TC_ERROR_FORMAT, error, "no numbers for the stack's place or size");
  }
  return true;
}

static bool parse(parrec *p, const tc_input *input, const tc_order *order, GError **error) {
  GError *trouble = NULL;
  tc_stream s;
  if (!tc_stream_open(&s, input, order, error)) return false;
  bool ok = true;
  for (char *line; ok && (line = tc_stream_line(&s, &trouble));) {
    line += strspn(line, " \t");
    if (*line == '.') ok = take_general(p, line, &trouble);
    if (g_ascii_isdigit(*line) || *line == '-') ok = take_row(p, line, &trouble);
  }
  tc_stream_close(&s);
  if (trouble) {
    g_propagate_error(error, trouble);
    return false;
  }
  return p->images->len > 0 || fail(TC_ERROR_FORMAT, error, "no images");
}

/* ---- which image is where ---- */

static int compare_volume(const image *a, const image *b) {
  for (size_t i = 0; i < G_N_ELEMENTS(keys); i++)
    if (a->row[keys[i]] != b->row[keys[i]]) return a->row[keys[i]] < b->row[keys[i]] ? -1 : 1;
  return a->again - b->again;
}

static int by_volume(const void *a, const void *b) {
  const image *x = a, *y = b;
  const int volumes = compare_volume(x, y);
  if (volumes) return volumes;
  if (x->row[SLICE] != y->row[SLICE]) return x->row[SLICE] < y->row[SLICE] ? -1 : 1;
  return x->order < y->order ? -1 : 1;
}

static image *image_at(const parrec *p, guint i) { return &g_array_index(p->images, image, i); }

/* Sorts the images. Images with equal keys belong to successive volumes. */
static void sort(parrec *p) {
  g_array_sort(p->images, by_volume);
  for (guint i = 1; i < p->images->len; i++) {
    image *before = image_at(p, i - 1), *now = image_at(p, i);
    const bool same = before->row[SLICE] == now->row[SLICE];
    const int again = before->again;
    before->again = 0;
    now->again = same && compare_volume(before, now) == 0 ? again + 1 : 0;
    before->again = again;
  }
  g_array_sort(p->images, by_volume);
}

/* Drops volumes with missing slices, from an aborted acquisition. */
static void keep_whole(parrec *p) {
  guint kept = 0;
  for (guint from = 0, to; from < p->images->len; from = to) {
    for (to = from + 1; to < p->images->len && compare_volume(image_at(p, from), image_at(p, to)) == 0;) to++;
    if (to - from != (guint)p->slices) {
      p->incomplete++;
      continue;
    }
    memmove(image_at(p, kept), image_at(p, from), (to - from) * sizeof(image));
    kept += to - from;
    p->volumes++;
  }
  g_array_set_size(p->images, kept);
}

/* Number of different values in a column. */
static int count_different(const parrec *p, int column) {
  GHashTable *numbers = g_hash_table_new(NULL, NULL);
  for (guint i = 0; i < p->images->len; i++)
    g_hash_table_add(numbers, GINT_TO_POINTER((int)CLAMP(image_at(p, i)->row[column], INT32_MIN, INT32_MAX)));
  const int count = (int)g_hash_table_size(numbers);
  g_hash_table_destroy(numbers);
  return count;
}

/* Checks the number of slices against the header: its centre holds only for the announced stack. */
static bool count(parrec *p, GError **error) {
  p->slices = count_different(p, SLICE);
  p->times = count_different(p, TIME);
  return p->slices >= p->announced_slices ||
         fail(TC_ERROR_FORMAT, error, "fewer slices are listed than it announces: export the series again");
}

/* Checks that all images have one grid. */
static bool is_uniform(const parrec *p, GError **error) {
  static const int same[] = {BITS, SIZE_X, SIZE_Y, THICKNESS, GAP, ORIENTATION, SPACING_X, SPACING_Y};
  const image *first = image_at(p, 0);
  for (guint i = 1; i < p->images->len; i++)
    for (size_t k = 0; k < G_N_ELEMENTS(same); k++)
      if (image_at(p, i)->row[same[k]] != first->row[same[k]])
        return fail(TC_ERROR_UNSUPPORTED, error,
                    "images of several sizes or orientations, such as localizers: convert them to NIfTI (dcm2niix)");
  if (first->row[BITS] == 8 || first->row[BITS] == 16) return true;
  return fail(TC_ERROR_UNSUPPORTED, error, "voxels of 8 or 16 bits expected: convert it to NIfTI (dcm2niix)");
}

/* ---- place in space: Philips' axes are P, S, L ---- */

static void turn(double v[3], int a, int b, double degrees) {
  const double c = cos(degrees * G_PI / 180), s = sin(degrees * G_PI / 180), x = v[a], y = v[b];
  v[a] = c * x - s * y;
  v[b] = s * x + c * y;
}

/* Directions of the index axes of slices without rotation: column, row, slice of transverse, sagittal, coronal. */
static const signed char axes[3][3][3] = {
    {{0, 0, 1}, {1, 0, 0}, {0, 1, 0}}, {{1, 0, 0}, {0, -1, 0}, {0, 0, -1}}, {{0, 0, 1}, {0, -1, 0}, {1, 0, 0}}};

static bool set_space(tc_raster *raster, const parrec *p, GError **error) {
  const double *row = image_at(p, 0)->row, steps[3] = {row[SPACING_X], row[SPACING_Y], row[THICKNESS] + row[GAP]};
  const double centre[3] = {p->centre[2], p->centre[0], p->centre[1]};
  const double orientation = row[ORIENTATION];
  double columns[3][3];
  if (orientation != 1 && orientation != 2 && orientation != 3)
    return fail(TC_ERROR_FORMAT, error, "no slice orientation of 1 to 3");
  memcpy(raster->desc.origin, centre, sizeof centre);
  for (int k = 0; k < 3; k++) {
    double v[3];
    for (int i = 0; i < 3; i++) v[i] = steps[k] * axes[(int)orientation - 1][k][i];
    turn(v, 2, 0, p->angles[1]); /* FH about S */
    turn(v, 1, 2, p->angles[0]); /* AP about P */
    turn(v, 0, 1, p->angles[2]); /* RL about L */
    const double lps[3] = {v[2], v[0], v[1]};
    for (int i = 0; i < 3; i++) {
      columns[k][i] = lps[i];
      raster->desc.origin[i] -= lps[i] * (raster->desc.dims[k] - 1) / 2.0;
    }
  }
  return tc_raster_set_axes(raster, columns) || fail(TC_ERROR_FORMAT, error, "no distances between voxels and slices");
}

/* ---- voxels ---- */

/* Slices may have different scales; then rescaled values are stored. */
static bool has_one_scale(const parrec *p, const image *images) {
  for (int z = 1; z < p->slices; z++)
    if (images[z].row[SLOPE] != images[0].row[SLOPE] || images[z].row[INTERCEPT] != images[0].row[INTERCEPT])
      return false;
  return images[0].row[SLOPE] != 0;
}

static void rescale(const uint8_t *from, int bytes, size_t n, const double *row, float *to) {
  for (size_t i = 0; i < n; i++) {
    const unsigned voxel = bytes == 1 ? from[i] : from[2 * i] | (unsigned)from[2 * i + 1] << 8;
    to[i] = (float)(voxel * row[SLOPE] + row[INTERCEPT]);
  }
}

static bool send(const tc_raster *raster, const parrec *p, const image *images, const tc_input *rec,
                 const tc_order *order, GError **error) {
  const size_t n = (size_t)raster->desc.dims[0] * (size_t)raster->desc.dims[1];
  const int bytes = (int)images->row[BITS] / 8;
  const bool values = raster->desc.type == TC_F32;
  uint8_t *slice = g_try_malloc(n * (size_t)bytes);
  float *scaled = values ? g_try_new(float, n) : NULL;
  bool ok = slice && (scaled || !values);
  if (!ok) tc_set_error(error, TC_ERROR_MEMORY, NULL, "no memory for a slice");
  for (int z = 0; ok && z < p->slices; z++) {
    const double *row = images[z].row;
    ok = row[INDEX] >= 0 && row[INDEX] < MOST_IMAGES && row[INDEX] == floor(row[INDEX]);
    if (!ok) fail(TC_ERROR_FORMAT, error, "an index in the REC file is none");
    ok = ok && tc_input_read(rec, (uint64_t)row[INDEX] * n * (uint64_t)bytes, slice, n * (size_t)bytes, error);
    if (ok && values) rescale(slice, bytes, n, row, scaled);
    ok = ok && tc_order_put(order, values ? (void *)scaled : slice, n * (values ? 4 : (size_t)bytes), error) &&
         order->goes_on(order->user, (double)z / p->slices, error);
  }
  g_free(scaled);
  g_free(slice);
  return ok;
}

static bool describe(tc_raster *raster, const parrec *p, const image *images, GError **error) {
  const double *row = images->row, sizes[3] = {row[SIZE_X], row[SIZE_Y], p->slices};
  for (int k = 0; k < 3; k++) {
    if (!(sizes[k] >= 1 && sizes[k] <= 65536) || sizes[k] != floor(sizes[k]))
      return fail(TC_ERROR_FORMAT, error, "no image size");
    raster->desc.dims[k] = (int)sizes[k];
  }
  g_strlcpy(raster->desc.modality, "MR", sizeof raster->desc.modality);
  raster->desc.frames = p->volumes;
  raster->desc.type = TC_F32;
  if (has_one_scale(p, images)) {
    raster->desc.type = row[BITS] == 8 ? TC_U8 : TC_U16;
    raster->desc.slope = row[SLOPE];
    raster->desc.intercept = row[INTERCEPT];
  } else {
    tc_raster_note(raster, "each slice has its own scale: kept as values (f32)");
  }
  if (p->incomplete)
    tc_raster_note(raster, "%d of %d volumes lack slices and are left out", p->incomplete, p->incomplete + p->volumes);
  if (p->times < p->announced_times)
    tc_raster_note(raster, "%d of %.0f dynamics that the header announces are there", p->times, p->announced_times);
  return set_space(raster, p, error);
}

/* Opens NAME.REC for NAME.PAR, in the same case. */
static bool open_rec(const tc_input *input, tc_input *rec, GError **error) {
  const char *dot = strrchr(input->name, '.');
  const bool lower = dot && g_str_has_prefix(dot, ".par");
  char *name = g_strdup_printf("%.*s%s", dot ? (int)(dot - input->name) : (int)strlen(input->name), input->name,
                               lower ? ".rec" : ".REC");
  const bool found = tc_input_open_sibling(input, name, false, rec, error);
  g_free(name);
  if (!found || rec->packing == TC_ENCODING_RAW) return found;
  return fail(TC_ERROR_UNSUPPORTED, error, "the .REC beside it is packed: unpack it first");
}

static bool read_volume(parrec *p, const tc_input *input, const tc_order *order, GError **error) {
  tc_raster raster;
  tc_input rec = {.fd = -1};
  const uint32_t wanted = MAX(order->volume, 1);
  const tc_provenance from = {.volume = (int)wanted};
  tc_raster_init(&raster, "parrec", input);
  if (!p->volumes) return fail(TC_ERROR_FORMAT, error, "no volume has all slices");
  if (wanted > (uint32_t)p->volumes) {
    tc_set_error(error, TC_ERROR_NOT_FOUND, NULL, "no volume %u: the file holds %d", wanted, p->volumes);
    return false;
  }
  const image *images = image_at(p, (wanted - 1) * (guint)p->slices);
  bool ok = describe(&raster, p, images, error) && open_rec(input, &rec, error);
  if (ok && p->volumes > 1) tc_raster_note(&raster, "volume %u of %d, choose by #volume=N", wanted, p->volumes);
  ok = ok && tc_raster_begin(&raster, rec.size / (uint64_t)(images->row[BITS] / 8), &from, order, error) &&
       send(&raster, p, images, &rec, order, error);
  tc_input_close(&rec);
  tc_raster_clear(&raster);
  return ok;
}

static bool read_parrec(const tc_input *input, const tc_order *order, GError **error) {
  parrec p = {.images = g_array_new(FALSE, FALSE, sizeof(image))};
  bool ok = parse(&p, input, order, error) && is_uniform(&p, error) && count(&p, error);
  if (ok) {
    sort(&p);
    keep_whole(&p);
    ok = read_volume(&p, input, order, error);
  }
  g_array_unref(p.images);
  return ok;
}

const tc_format tc_format_parrec = {"PAR/REC", ".par", probe, read_parrec};
