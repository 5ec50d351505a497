/* NRRD's axes: which are space, which are components or frames, and where the voxels lie. */
#include <math.h>
#include <string.h>

#include "renderer/import/helper/nrrd.h"
#include "renderer/import/reader.h"

typedef enum axis_role { ROLE_UNKNOWN, ROLE_SPACE, ROLE_COLOUR, ROLE_VECTOR, ROLE_FRAMES } axis_role;

typedef struct axes {
  axis_role role[tc_nrrd_max_dims];
  bool has_direction[tc_nrrd_max_dims];
  double direction[tc_nrrd_max_dims][4]; /* in the file's space */
  double origin[4];
  double sign[3];       /* file's space to LPS */
  int space_dims;       /* coordinates of a vector; 0: the file names no space */
  int space[3], n_space; /* the axes that are space, fastest first */
} axes;

/* ---- text of per-axis fields ---- */

static char **words_of(const tc_nrrd_header *h, tc_nrrd_field field, GError **error) {
  char **words = g_strsplit_set(h->fields[field], " \t", -1);
  int n = 0;
  for (int i = 0; words[i]; i++) { /* drop the empty words of repeated blanks */
    if (words[i][0] == '\0')
      g_free(words[i]);
    else
      words[n++] = words[i];
  }
  words[n] = NULL;
  if (n == h->dimension) return words;
  tc_nrrd_error(h, field, TC_ERROR_FORMAT, error, "%d values expected, got %d", h->dimension, n);
  g_strfreev(words);
  return NULL;
}

/* A number per axis; NaN says "none". All NaN when the field is not given. */
static bool numbers_of(const tc_nrrd_header *h, tc_nrrd_field field, double *values, GError **error) {
  for (int i = 0; i < h->dimension; i++) values[i] = NAN;
  if (!h->fields[field]) return true;
  int got = tc_text_numbers(h->fields[field], values, tc_nrrd_max_dims);
  if (got == h->dimension) return true;
  tc_nrrd_error(h, field, TC_ERROR_FORMAT, error, "%d numbers expected, got %d", h->dimension, MAX(got, 0));
  return false;
}

/* "(a,b,c)" at *at, which moves behind it. Returns how many numbers, or -1. */
static int vector_at(const char **at, double *v, int most) {
  const char *p = *at;
  int n = 0;
  if (*p++ != '(') return -1;
  for (;;) {
    char *end;
    if (n == most) return -1;
    v[n++] = g_ascii_strtod(p, &end);
    if (end == p) return -1;
    while (g_ascii_isspace(*end)) end++;
    p = end + 1;
    if (*end == ')') break;
    if (*end != ',') return -1;
  }
  *at = p;
  return n;
}

static double unit_mm(const char *text) {
  static const struct { const char *name; double mm; } units[] = {
      {"m", 1000}, {"cm", 10}, {"um", 0.001}, {"micron", 0.001}, {"microns", 0.001}, {"nm", 1e-6},
  };
  for (size_t i = 0; i < G_N_ELEMENTS(units); i++)
    if (strcmp(text, units[i].name) == 0) return units[i].mm;
  return 1;
}

/* The unit of the n-th quoted word. */
static double quoted_unit(const char *text, int n) {
  char **parts = g_strsplit(text, "\"", -1);
  int count = (int)g_strv_length(parts);
  double mm = 2 * n + 1 < count ? unit_mm(parts[2 * n + 1]) : 1;
  g_strfreev(parts);
  return mm;
}

/* ---- space ---- */

static bool set_space(axes *a, const tc_nrrd_header *h, tc_raster *raster, GError **error) {
  static const struct { const char *name, *brief; int dims; double sign[3]; } spaces[] = {
      {"right-anterior-superior", "RAS", 3, {-1, -1, 1}},
      {"left-anterior-superior", "LAS", 3, {1, -1, 1}},
      {"left-posterior-superior", "LPS", 3, {1, 1, 1}},
      {"right-anterior-superior-time", "RAST", 4, {-1, -1, 1}},
      {"left-anterior-superior-time", "LAST", 4, {1, -1, 1}},
      {"left-posterior-superior-time", "LPST", 4, {1, 1, 1}},
      {"scanner-xyz", "", 3, {1, 1, 1}},
      {"scanner-xyz-time", "", 4, {1, 1, 1}},
      {"3D-right-handed", "", 3, {1, 1, 1}},
      {"3D-left-handed", "", 3, {1, 1, 1}},
      {"3D-right-handed-time", "", 4, {1, 1, 1}},
      {"3D-left-handed-time", "", 4, {1, 1, 1}},
  };
  const char *name = h->fields[NRRD_SPACE], *dims = h->fields[NRRD_SPACE_DIMENSION];
  a->sign[0] = a->sign[1] = a->sign[2] = 1;
  if (dims && !name) {
    int64_t n;
    if (!tc_text_integer(dims, 2, 4, &n)) {
      tc_nrrd_error(h, NRRD_SPACE_DIMENSION, TC_ERROR_UNSUPPORTED, error, "2, 3 or 4 expected");
      return false;
    }
    a->space_dims = (int)n;
    tc_raster_note(raster, "the file's space is not anatomical and was taken as LPS");
  }
  if (!name) return true;
  for (size_t i = 0; i < G_N_ELEMENTS(spaces); i++) {
    bool brief = spaces[i].brief[0] && g_ascii_strcasecmp(name, spaces[i].brief) == 0;
    if (!brief && g_ascii_strcasecmp(name, spaces[i].name) != 0) continue;
    a->space_dims = spaces[i].dims;
    memcpy(a->sign, spaces[i].sign, sizeof a->sign);
    if (!spaces[i].brief[0]) tc_raster_note(raster, "the file's space is not anatomical and was taken as LPS");
    return true;
  }
  tc_nrrd_error(h, NRRD_SPACE, TC_ERROR_UNSUPPORTED, error, "unknown (left-posterior-superior and its like are read)");
  return false;
}

static bool set_directions(axes *a, const tc_nrrd_header *h, GError **error) {
  const char *at = h->fields[NRRD_SPACE_DIRECTIONS], *origin = h->fields[NRRD_SPACE_ORIGIN];
  if ((at || origin) && a->space_dims == 0) {
    tc_nrrd_error(h, at ? NRRD_SPACE_DIRECTIONS : NRRD_SPACE_ORIGIN, TC_ERROR_FORMAT, error,
                  "given without a space or space dimension");
    return false;
  }
  for (int i = 0; at && i < h->dimension; i++) {
    at += strspn(at, " \t");
    if (strncmp(at, "none", 4) == 0) {
      at += 4;
      continue;
    }
    a->has_direction[i] = vector_at(&at, a->direction[i], 4) == a->space_dims;
    if (a->has_direction[i]) continue;
    tc_nrrd_error(h, NRRD_SPACE_DIRECTIONS, TC_ERROR_FORMAT, error,
                  "value %d: a vector of %d numbers or none expected", i + 1, a->space_dims);
    return false;
  }
  if (at && at[strspn(at, " \t")] != '\0') {
    tc_nrrd_error(h, NRRD_SPACE_DIRECTIONS, TC_ERROR_FORMAT, error, "more than %d vectors", h->dimension);
    return false;
  }
  if (!origin || vector_at(&origin, a->origin, 4) == a->space_dims) return true;
  tc_nrrd_error(h, NRRD_SPACE_ORIGIN, TC_ERROR_FORMAT, error, "a vector of %d numbers expected", a->space_dims);
  return false;
}

/* ---- roles ---- */

static bool role_of_kind(const char *kind, axis_role *role) {
  static const struct { const char *name; axis_role role; } kinds[] = {
      {"domain", ROLE_SPACE}, {"space", ROLE_SPACE}, {"time", ROLE_FRAMES}, {"list", ROLE_FRAMES},
      {"point", ROLE_FRAMES}, {"???", ROLE_UNKNOWN}, {"none", ROLE_UNKNOWN},
      {"RGB-color", ROLE_COLOUR}, {"RGBA-color", ROLE_COLOUR}, {"3-color", ROLE_COLOUR}, {"4-color", ROLE_COLOUR},
  };
  for (size_t i = 0; i < G_N_ELEMENTS(kinds); i++)
    if (g_ascii_strcasecmp(kind, kinds[i].name) == 0) {
      *role = kinds[i].role;
      return true;
    }
  *role = ROLE_VECTOR; /* vectors, gradients, complex, tensors */
  return g_ascii_strcasecmp(kind, "HSV-color") != 0 && g_ascii_strcasecmp(kind, "XYZ-color") != 0;
}

static bool roles_by_kinds(axes *a, const tc_nrrd_header *h, GError **error) {
  if (!h->fields[NRRD_KINDS]) return true;
  char **words = words_of(h, NRRD_KINDS, error);
  bool ok = words != NULL;
  for (int i = 0; ok && i < h->dimension; i++) {
    ok = role_of_kind(words[i], &a->role[i]);
    if (ok) continue;
    tc_nrrd_error(h, NRRD_KINDS, TC_ERROR_UNSUPPORTED, error, "this kind of colour is not read: save RGB");
  }
  g_strfreev(words);
  return ok;
}

static bool looks_like_colour(const tc_raster *raster, uint64_t size) {
  return raster->element == TC_ELEMENT_U8 && (size == 3 || size == 4);
}

/* Does the axis step through space, as far as directions tell? A step in time alone does not. */
static bool has_step(const axes *a, int i) {
  const double *d = a->direction[i];
  return a->has_direction[i] && (a->space_dims < 4 || d[0] != 0 || d[1] != 0 || d[2] != 0);
}

/* A fastest axis of 2 to 4 values that is not space holds components; any other such axis, frames. */
static axis_role role_beside_space(const tc_nrrd_header *h, const tc_raster *raster, int i) {
  if (i > 0 || h->sizes[0] > 4 || h->sizes[0] == 1) return ROLE_FRAMES;
  return looks_like_colour(raster, h->sizes[0]) ? ROLE_COLOUR : ROLE_VECTOR;
}

/* What kinds leave open: directions decide, where there are none the first three axes left are space. */
static void guess_roles(axes *a, const tc_nrrd_header *h, const tc_raster *raster) {
  bool directions = h->fields[NRRD_SPACE_DIRECTIONS] != NULL;
  bool bare = !directions && !h->fields[NRRD_KINDS];
  int space = 0;
  for (int i = 0; i < h->dimension; i++) {
    if (a->role[i] == ROLE_SPACE && directions && !has_step(a, i)) a->role[i] = ROLE_UNKNOWN;
    if (a->role[i] == ROLE_SPACE) space++;
  }
  if (bare && h->dimension == 4) a->role[0] = role_beside_space(h, raster, 0);
  if (a->role[0] == ROLE_FRAMES && bare) a->role[0] = ROLE_UNKNOWN; /* then the last axis holds the frames */
  for (int i = 0; i < h->dimension; i++) {
    if (a->role[i] != ROLE_UNKNOWN) continue;
    bool inside = directions ? has_step(a, i) : space < 3;
    a->role[i] = inside ? ROLE_SPACE : role_beside_space(h, raster, i);
    space += inside;
  }
}

static bool count_space(axes *a, const tc_nrrd_header *h, const tc_raster *raster, GError **error) {
  for (int i = 0; i < h->dimension; i++) {
    if (a->role[i] != ROLE_SPACE) continue;
    if (a->n_space < 3)
      a->space[a->n_space++] = i;
    else
      a->role[i] = ROLE_FRAMES;
  }
  bool bare = !h->fields[NRRD_KINDS] && !h->fields[NRRD_SPACINGS] && a->space_dims == 0;
  bool wide = h->dimension == 3 && h->sizes[1] >= 32 && h->sizes[2] >= 32; /* a tiny block is no picture */
  if (wide && bare && looks_like_colour(raster, h->sizes[0])) {
    tc_nrrd_error(h, NRRD_SIZES, TC_ERROR_UNSUPPORTED, error,
                  "looks like a colour picture: name the axes' kinds, or give spacings if it is a volume");
    return false;
  }
  if (a->n_space >= 2) return true;
  tc_nrrd_error(h, NRRD_DIMENSION, TC_ERROR_UNSUPPORTED, error,
                "too few axes of space (%d): a volume has 3, an image 2", a->n_space);
  return false;
}

/* Whole frames lie behind everything else; at most one other axis holds components (or frames). */
static bool set_layout(const axes *a, const tc_nrrd_header *h, tc_raster *raster, GError **error) {
  int last = h->dimension - 1, odd = -1;
  uint64_t before = 1;
  for (; last >= 0 && a->role[last] == ROLE_FRAMES; last--)
    if (__builtin_mul_overflow(raster->frames, h->sizes[last], &raster->frames)) raster->frames = UINT64_MAX / 2;
  for (int i = 0; i < a->n_space; i++) raster->desc.dims[i] = (int)h->sizes[a->space[i]];
  for (int i = 0; i <= last; i++) {
    if (a->role[i] == ROLE_SPACE) {
      if (odd < 0 && __builtin_mul_overflow(before, h->sizes[i], &before)) before = UINT64_MAX;
      continue;
    }
    if (h->sizes[i] == 1) continue;
    if (odd >= 0 || h->sizes[i] > INT32_MAX) {
      tc_nrrd_error(h, NRRD_DIMENSION, TC_ERROR_UNSUPPORTED, error, "several axes that are not space are not read");
      return false;
    }
    odd = i;
  }
  if (odd < 0) return true;
  if (a->role[odd] == ROLE_COLOUR && h->sizes[odd] != 3 && h->sizes[odd] != 4) {
    tc_nrrd_error(h, NRRD_SIZES, TC_ERROR_FORMAT, error, "a colour axis has 3 or 4 values, not %" G_GUINT64_FORMAT,
                  h->sizes[odd]);
    return false;
  }
  raster->components = (uint32_t)h->sizes[odd];
  raster->inner = before;
  raster->combine = a->role[odd] == ROLE_COLOUR   ? TC_COMBINE_LUMA
                    : a->role[odd] == ROLE_VECTOR ? TC_COMBINE_MAGNITUDE
                                                  : TC_COMBINE_FIRST;
  return true;
}

/* ---- place ---- */

/* Spacing and first sample of axes without directions: spacings, else the interval of mins and maxs, else 1. A cell's
 * sample lies in its middle. */
static bool plain_axes(const axes *a, const tc_nrrd_header *h, double *spacing, double *start, GError **error) {
  double mins[tc_nrrd_max_dims], maxs[tc_nrrd_max_dims];
  char **centers = h->fields[NRRD_CENTERINGS] ? words_of(h, NRRD_CENTERINGS, error) : NULL;
  bool ok = (centers || !h->fields[NRRD_CENTERINGS]) && numbers_of(h, NRRD_SPACINGS, spacing, error) &&
            numbers_of(h, NRRD_AXIS_MINS, mins, error) && numbers_of(h, NRRD_AXIS_MAXS, maxs, error);
  for (int i = 0; ok && i < h->dimension; i++) {
    bool cell = centers && g_ascii_strcasecmp(centers[i], "cell") == 0;
    double steps = (double)h->sizes[i] - (cell ? 0 : 1);
    if (isnan(spacing[i])) spacing[i] = steps > 0 && isfinite(maxs[i] - mins[i]) ? (maxs[i] - mins[i]) / steps : 1;
    start[i] = isfinite(mins[i]) ? mins[i] + (cell ? spacing[i] / 2 : 0) : 0;
    double mm = h->fields[NRRD_UNITS] ? quoted_unit(h->fields[NRRD_UNITS], i) : 1;
    spacing[i] *= mm;
    start[i] *= mm;
  }
  g_strfreev(centers);
  return ok;
}

static bool set_place(const axes *a, const tc_nrrd_header *h, tc_raster *raster, GError **error) {
  double columns[3][3] = {{0}}, spacing[tc_nrrd_max_dims], start[tc_nrrd_max_dims];
  double mm = h->fields[NRRD_SPACE_UNITS] ? quoted_unit(h->fields[NRRD_SPACE_UNITS], 0) : 1;
  if (!plain_axes(a, h, spacing, start, error)) return false;
  for (int i = 0; i < 3 && a->space_dims > 0; i++) raster->desc.origin[i] = a->sign[i] * mm * a->origin[i];
  for (int k = 0; k < a->n_space; k++) {
    int axis = a->space[k];
    if (a->has_direction[axis]) {
      for (int i = 0; i < 3; i++) columns[k][i] = a->sign[i] * mm * a->direction[axis][i];
    } else {
      columns[k][k] = a->sign[k] * spacing[axis];
      if (!h->fields[NRRD_SPACE_ORIGIN]) raster->desc.origin[k] = a->sign[k] * start[axis];
    }
  }
  for (int i = 0; i < 3; i++)
    if (!isfinite(raster->desc.origin[i])) {
      tc_nrrd_error(h, NRRD_SPACE_ORIGIN, TC_ERROR_FORMAT, error, "coordinate %d is no number", i + 1);
      return false;
    }
  if (tc_raster_set_axes(raster, columns)) return true;
  tc_nrrd_field field = h->fields[NRRD_SPACE_DIRECTIONS] ? NRRD_SPACE_DIRECTIONS : NRRD_SPACINGS;
  tc_nrrd_error(h, field, TC_ERROR_FORMAT, error, "the axes are not independent vectors of finite length");
  return false;
}

bool tc_nrrd_set_axes(tc_raster *raster, const tc_nrrd_header *header, GError **error) {
  axes a = {0};
  if (!set_space(&a, header, raster, error) || !set_directions(&a, header, error)) return false;
  if (!roles_by_kinds(&a, header, error)) return false;
  guess_roles(&a, header, raster);
  return count_space(&a, header, raster, error) && set_layout(&a, header, raster, error) &&
         set_place(&a, header, raster, error);
}
