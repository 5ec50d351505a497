/* Arranges pictures as a regular stack by the rules of dicom_stack.h. */
#include "renderer/import/helper/dicom_stack.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/base/vector.h"

#define OFF_GRID 0.10       /* in steps: largest distance of a slice from its place on a regular grid */
#define OFF_GRID_MM 0.02    /* headers round positions to two or three decimals */
#define MISSING_STEP 1.5    /* in neighbouring steps: a slice is missing */
#define GAP_STEP 3          /* in neighbouring steps: a wider gap is not interpolated */
#define GAP_STEP_USUAL 10   /* in usual steps: likewise */
#define LAYERS_A_SLICE 8    /* largest number of grid layers per slice */
#define LEAST_LEAN 0.1      /* cosine between the slice normal and the stacking direction */
#define TILT_COSINE 0.99996 /* half a degree; smaller tilts are rounding */

/* A picture during sorting: its index, its distance along the normal, and its turn. */
typedef struct entry {
  double along;
  uint32_t slice;
  int32_t instance;
  uint32_t frame, segment;
} entry;

typedef struct work {
  const tc_dicom_slice *slices;
  entry *entries; /* [count] */
  size_t count;
  uint32_t *level; /* [count]: number of the entry's position */
  size_t levels;
  double normal[3];
} work;

void tc_dicom_note(char note[256], const char *format, ...) {
  size_t at = strlen(note);
  if (at > 0 && at + 2 < 256) {
    memcpy(note + at, "; ", 3);
    at += 2;
  }
  va_list args;
  va_start(args, format);
  vsnprintf(note + at, 256 - at, format, args);
  va_end(args);
}

static bool fail(GError **error, const char *format, ...) G_GNUC_PRINTF(2, 3);

static bool fail(GError **error, const char *format, ...) {
  char text[256];
  va_list args;
  va_start(args, format);
  vsnprintf(text, sizeof text, format, args);
  va_end(args);
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "%s", text);
  return false;
}

/* ---- order and levels ---- */

static int by_place(const void *pa, const void *pb) {
  const entry *a = pa, *b = pb;
  if (a->along != b->along) return a->along < b->along ? -1 : 1;
  if (a->instance != b->instance) return a->instance < b->instance ? -1 : 1;
  if (a->frame != b->frame) return a->frame < b->frame ? -1 : 1;
  return a->slice < b->slice ? -1 : a->slice > b->slice;
}

static int by_turn(const void *pa, const void *pb) {
  entry a = *(const entry *)pa, b = *(const entry *)pb;
  a.along = b.along = 0;
  return by_place(&a, &b);
}

static const tc_dicom_slice *slice_of(const work *w, size_t i) { return &w->slices[w->entries[i].slice]; }

void tc_dicom_normal(const tc_dicom_slice *slice, double normal[3]) {
  static const double straight[6] = {1, 0, 0, 0, 1, 0};
  const double *o = slice->has_orientation ? slice->orientation : straight;
  cross3(o, o + 3, normal);
  double length = length3(normal);
  for (int i = 0; i < 3; i++) normal[i] /= length > 0 ? length : 1;
}

double tc_dicom_same_place(double range, size_t count) {
  double same = count > 1 ? 0.2 * range / (double)(count - 1) : 0;
  return same > 0.05 ? 0.05 : same < 1e-5 ? 1e-5 : same;
}

static void measure(work *w) {
  const tc_dicom_slice *first = slice_of(w, 0);
  tc_dicom_normal(first, w->normal);
  for (size_t i = 0; i < w->count; i++)
    w->entries[i].along = first->has_position ? dot3(slice_of(w, i)->position, w->normal) : 0;
}

/* Numbers the different positions; entries at one position are sorted by turn. */
static void find_levels(work *w) {
  qsort(w->entries, w->count, sizeof *w->entries, by_place);
  double same = tc_dicom_same_place(w->entries[w->count - 1].along - w->entries[0].along, w->count);
  size_t start = 0;
  w->levels = 0;
  for (size_t i = 0; i < w->count; i++) {
    if (i > 0 && w->entries[i].along - w->entries[start].along > same) {
      qsort(w->entries + start, i - start, sizeof *w->entries, by_turn);
      start = i;
      w->levels++;
    }
    w->level[i] = (uint32_t)w->levels;
  }
  qsort(w->entries + start, w->count - start, sizeof *w->entries, by_turn);
  w->levels++;
}

/* ---- the grid ---- */

static int compare_doubles(const void *pa, const void *pb) {
  double a = *(const double *)pa, b = *(const double *)pb;
  return (a > b) - (a < b);
}

/* Largest distance, in steps, of positions from a regular grid of `layers` from the first to the last. places[] gives
 * the layer of each position; NULL: consecutive layers. */
static double off_grid(const double *at, size_t levels, size_t layers, const uint32_t *places) {
  double step = (at[levels - 1] - at[0]) / (double)(layers - 1), worst = 0;
  for (size_t i = 0; i < levels; i++)
    worst = fmax(worst, fabs(at[i] - at[0] - step * (double)(places ? places[i] : i)));
  return worst <= OFF_GRID_MM ? 0 : worst / step;
}

/* Number of slices missing in step i: the step is a whole multiple of the equal steps around it. 0: none. */
static size_t missing_in(const double *at, size_t levels, size_t i) {
  double step = at[i + 1] - at[i], before = i > 0 ? at[i] - at[i - 1] : 0,
         after = i + 2 < levels ? at[i + 2] - at[i + 1] : 0;
  double beside = before > 0 && after > 0 ? 0.5 * (before + after) : before + after;
  if (!(beside > 0) || step < MISSING_STEP * beside) return 0;
  if (before > 0 && after > 0 && fabs(before - after) > OFF_GRID * beside) return 0;
  double whole = round(step / beside);
  return fabs(step / beside - whole) < 2 * OFF_GRID && whole < 1e6 ? (size_t)whole - 1 : 0;
}

/* Finds missing slices of an otherwise regular grid: without any, *layers = levels; one is bridged; several are an
 * error. `places` [levels] receives the layer of each position. */
static bool find_missing(const double *at, size_t levels, uint32_t *places, size_t *layers, GError **error) {
  size_t missing = 0, gaps = 0, first = 0;
  for (size_t i = 0; i < levels; i++) {
    places[i] = (uint32_t)(i + missing);
    size_t here = i + 1 < levels ? missing_in(at, levels, i) : 0;
    if (here && gaps++ == 0) first = i + 1;
    missing += here;
  }
  *layers = levels;
  if (missing == 0 || off_grid(at, levels, levels + missing, places) > 2 * OFF_GRID) return true;
  *layers += missing;
  if (missing == 1) return true;
  return fail(error,
              "%zu slices are missing at %zu place%s, the first after slice %zu of %zu (%.3g mm apart there); one could"
              " be bridged: send the whole series",
              missing, gaps, gaps == 1 ? "" : "s", first, levels, at[first] - at[first - 1]);
}

/* Interpolates the layers of a regular grid from the nearest slices; `layers` from the first position to the last. */
static void mix_layers(const double *at, size_t levels, size_t layers, tc_dicom_stack *s) {
  double step = (at[levels - 1] - at[0]) / (double)(layers - 1);
  s->mix = g_new(tc_dicom_mix, layers);
  for (size_t z = 0, below = 0; z < layers; z++) {
    double here = at[0] + step * (double)z;
    while (below + 2 < levels && at[below + 1] <= here) below++;
    double part = (here - at[below]) / (at[below + 1] - at[below]);
    if (part < 1e-6) part = 0;
    if (part > 1 - 1e-6) part = 1;
    s->mix[z] = (tc_dicom_mix){(uint32_t)below, (float)part};
  }
  s->dims[2] = (int)layers;
}

static void bridge(const double *at, size_t levels, const uint32_t *places, tc_dicom_stack *s) {
  size_t i = 1;
  while (places[i] == i) i++;
  mix_layers(at, levels, levels + 1, s);
  for (size_t k = 0; k < levels; k++) /* layers at a slice stay that slice */
    s->mix[places[k]] = k + 1 < levels ? (tc_dicom_mix){(uint32_t)k, 0} : (tc_dicom_mix){(uint32_t)k - 1, 1};
  s->bridged = (int)i + 1;
  tc_dicom_note(s->note, "1 missing slice bridged from its neighbours (layer %zu of %zu)", i + 1, levels + 1);
}

/* First step too wide for interpolation: much wider than its neighbours or than the usual step; n if there is none. */
static size_t first_gap(const double *steps, size_t n, double usual) {
  for (size_t i = 0; i < n; i++) {
    double before = i > 0 ? steps[i - 1] : steps[i + 1], after = i + 1 < n ? steps[i + 1] : before;
    if (steps[i] > GAP_STEP * fmax(before, after) || steps[i] > GAP_STEP_USUAL * usual) return i;
  }
  return n;
}

/* Resamples slices at varying distances to layers at equal distances. Needs at least three: two are never irregular. */
static bool resample(const double *at, size_t levels, tc_dicom_stack *s, GError **error) {
  size_t n = levels - 1;
  double *steps = g_new(double, n), *sorted = g_new(double, n), range = at[levels - 1] - at[0];
  for (size_t i = 0; i < n; i++) sorted[i] = steps[i] = at[i + 1] - at[i];
  qsort(sorted, n, sizeof *sorted, compare_doubles);
  double least = sorted[0], usual = sorted[n / 2], widest = sorted[n - 1];
  size_t gap = first_gap(steps, n, usual);
  g_free(sorted);
  g_free(steps);
  if (gap < n)
    return fail(error, "slices are missing after slice %zu of %zu: %.3g mm apart there, usually %.3g mm", gap + 1,
                levels, at[gap + 1] - at[gap], usual);
  size_t layers = (size_t)fmin(ceil(range / least - 1e-6), (double)(LAYERS_A_SLICE * n)) + 1;
  mix_layers(at, levels, layers, s);
  tc_dicom_note(s->note, "slice distances of %.3g to %.3g mm: %zu slices resampled to %zu layers %.4g mm apart", least,
                widest, levels, layers, range / (double)(layers - 1));
  return true;
}

/* Makes the layers between the first and the last position, by the rules above. at [levels] ascends. */
static bool make_layers(const double *at, size_t levels, tc_dicom_stack *s, GError **error) {
  uint32_t *places = g_new(uint32_t, levels);
  size_t layers;
  double off = off_grid(at, levels, levels, NULL);
  bool ok = true;
  if (off <= OFF_GRID) {
    if (off > 0.01)
      tc_dicom_note(s->note, "slice steps differ: slices are up to %.2g mm off equal ones, which are used",
                    off * (at[levels - 1] - at[0]) / (double)(levels - 1));
  } else if ((ok = find_missing(at, levels, places, &layers, error))) {
    if (layers > levels)
      bridge(at, levels, places, s);
    else
      ok = resample(at, levels, s, error);
  }
  g_free(places);
  return ok;
}

/* Positions must lie on one straight line within a voxel. `at` are distances along it. */
static bool check_line(const work *w, const double *at, const tc_dicom_stack *s, GError **error) {
  double mean = w->levels > 1 ? (at[w->levels - 1] - at[0]) / (double)(w->levels - 1) : 0;
  double slack = fmax(fmin(s->spacing[0], s->spacing[1]), 0.5 * mean);
  for (size_t i = 0; i < s->count; i++) {
    const tc_dicom_slice *slice = &w->slices[s->items[i].slice];
    double off = 0;
    for (int k = 0; k < 3; k++) {
      double d = slice->position[k] - s->origin[k] - s->direction[3 * k + 2] * (at[w->level[i]] - at[0]);
      off += d * d;
    }
    if (sqrt(off) > slack)
      return fail(error,
                  "slices do not lie on a straight line (slice %u is %.3g mm off); they may be several stacks, choose"
                  " one",
                  w->level[i] + 1, sqrt(off));
  }
  return true;
}

/* Sets column 2 and the origin from the first and last picture, and converts distances `at` along the normal to
 * distances along column 2. */
static bool place_axis(const work *w, double *at, tc_dicom_stack *s, GError **error) {
  const tc_dicom_slice *first = slice_of(w, 0), *last = slice_of(w, w->count - 1);
  double across[3], length;
  for (int k = 0; k < 3; k++) across[k] = last->position[k] - first->position[k];
  length = length3(across);
  double lean = w->levels > 1 ? dot3(across, w->normal) / length : 1;
  if (!(lean > LEAST_LEAN)) return fail(error, "slices are shifted along their own plane and make no volume");
  for (int k = 0; k < 3; k++) {
    s->direction[3 * k + 2] = w->levels > 1 ? across[k] / length : w->normal[k];
    s->origin[k] = first->position[k];
  }
  for (size_t i = 0; i < w->levels; i++) at[i] /= lean;
  if (lean < TILT_COSINE)
    tc_dicom_note(s->note, "gantry tilt: slices are stacked %.1f degrees off their normal and kept as an oblique axis",
                  acos(lean) * 180 / G_PI);
  return true;
}

/* The header's distance between slices, for stacks whose positions do not give one. */
static double spare_step(const tc_dicom_slice *slice, char note[256]) {
  if (slice->between > 0) return slice->between;
  if (slice->thickness > 0) return slice->thickness;
  tc_dicom_note(note, "slice distance unknown, 1 mm used");
  return 1;
}

static void set_plane(const tc_dicom_slice *first, tc_dicom_stack *s) {
  static const double straight[6] = {1, 0, 0, 0, 1, 0};
  const double *o = first->has_orientation ? first->orientation : straight;
  for (int k = 0; k < 3; k++) {
    s->direction[3 * k] = o[k];
    s->direction[3 * k + 1] = o[3 + k];
  }
  s->dims[0] = first->columns;
  s->dims[1] = first->rows;
  for (int i = 0; i < 2; i++) s->spacing[i] = first->has_spacing ? first->spacing[i] : 1;
  if (!first->has_spacing) tc_dicom_note(s->note, "pixel spacing unknown, 1 mm used");
  if (!first->has_orientation) tc_dicom_note(s->note, "orientation unknown, axial assumed");
  if (!first->has_position) tc_dicom_note(s->note, "slice positions unknown");
}

/* Stacks pictures without positions: one layer per picture, sorted by turn. */
static bool stack_by_turn(work *w, tc_dicom_stack *s) {
  qsort(w->entries, w->count, sizeof *w->entries, by_turn);
  for (size_t i = 0; i < w->count; i++) s->items[i] = (tc_dicom_layer_item){w->entries[i].slice, (uint32_t)i};
  s->count = w->count;
  s->dims[2] = (int)w->count;
  for (int k = 0; k < 3; k++) s->direction[3 * k + 2] = w->normal[k];
  s->spacing[2] = spare_step(slice_of(w, 0), s->note);
  return true;
}

/* Layer distance of a segmentation: the header's if all steps are whole multiples of it, else the least step. */
static bool segment_step(const double *at, size_t levels, double header, double *step, GError **error) {
  double least = at[1] - at[0];
  for (size_t i = 1; i + 1 < levels; i++) least = fmin(least, at[i + 1] - at[i]);
  double tries[2] = {header > 0 ? header : least, least};
  for (int t = 0; t < 2; t++) {
    bool fits = true;
    for (size_t i = 1; i < levels && fits; i++) {
      double whole = (at[i] - at[0]) / tries[t];
      fits = whole < 65536 && fabs(whole - round(whole)) < 0.2 && round(whole) > round((at[i - 1] - at[0]) / tries[t]);
    }
    *step = tries[t];
    if (fits) return true;
  }
  return fail(error, "segmentation frames do not lie on a regular grid");
}

static bool stack_segments(const work *w, const double *at, tc_dicom_stack *s, GError **error) {
  double step = 0;
  if (w->levels > 1) {
    if (!segment_step(at, w->levels, slice_of(w, 0)->between, &step, error)) return false;
    s->dims[2] = (int)lround((at[w->levels - 1] - at[0]) / step) + 1;
  } else {
    s->dims[2] = 1;
    s->spacing[2] = spare_step(slice_of(w, 0), s->note);
  }
  for (size_t i = 0; i < w->count; i++) {
    size_t level = w->level[i];
    s->items[i] =
        (tc_dicom_layer_item){w->entries[i].slice, step > 0 ? (uint32_t)lround((at[level] - at[0]) / step) : 0};
  }
  s->count = w->count;
  if ((size_t)s->dims[2] > w->levels)
    tc_dicom_note(s->note, "%zu slices hold no segment and are empty", (size_t)s->dims[2] - w->levels);
  if (step > 0) s->spacing[2] = (at[w->levels - 1] - at[0]) / (s->dims[2] - 1);
  return check_line(w, at, s, error);
}

static bool stack_levels(const work *w, const double *at, tc_dicom_stack *s, GError **error) {
  if (w->levels < w->count) return fail(error, "%zu pictures share a position", w->count - w->levels);
  for (size_t i = 0; i < w->count; i++) s->items[i] = (tc_dicom_layer_item){w->entries[i].slice, (uint32_t)i};
  s->count = w->count;
  s->dims[2] = (int)w->levels;
  if (w->levels == 1)
    s->spacing[2] = spare_step(slice_of(w, 0), s->note);
  else if (!make_layers(at, w->levels, s, error))
    return false;
  else
    s->spacing[2] = (at[w->levels - 1] - at[0]) / (s->dims[2] - 1);
  return check_line(w, at, s, error);
}

static bool stack(work *w, tc_dicom_stack *s, GError **error) {
  set_plane(slice_of(w, 0), s);
  measure(w);
  if (!slice_of(w, 0)->has_position) return stack_by_turn(w, s);
  find_levels(w);
  double *at = g_new0(double, w->levels);
  for (size_t i = w->count; i-- > 0;) at[w->level[i]] = w->entries[i].along;
  bool ok = place_axis(w, at, s, error) &&
            (slice_of(w, 0)->sparse ? stack_segments(w, at, s, error) : stack_levels(w, at, s, error));
  g_free(at);
  return ok;
}

bool tc_dicom_stack_make(const tc_dicom_slice *slices, const uint32_t *chosen, size_t count, tc_dicom_stack *s,
                         GError **error) {
  work w = {.slices = slices, .entries = g_new(entry, count), .count = count, .level = g_new(uint32_t, count)};
  *s = (tc_dicom_stack){.items = g_new(tc_dicom_layer_item, count)};
  for (size_t i = 0; i < count; i++) {
    const tc_dicom_slice *slice = &slices[chosen[i]];
    w.entries[i] = (entry){0, chosen[i], slice->instance, slice->frame, slice->segment};
  }
  bool ok = stack(&w, s, error);
  if (!ok) tc_dicom_stack_finish(s);
  g_free(w.entries);
  g_free(w.level);
  return ok;
}

void tc_dicom_stack_finish(tc_dicom_stack *stack) {
  g_free(stack->items);
  g_free(stack->mix);
  memset(stack, 0, sizeof *stack);
}
