/* Loose pictures to one regular stack; the rules are in dicom_stack.h. */
#include "renderer/import/dicom_stack.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Cosine below which two pictures do not lie alike: about 0.8 degrees, over rounding in headers, under any real tilt.
 * */
#define SAME_ORIENTATION 0.9999
#define STEP_TOLERANCE 0.10 /* of the mean step */
#define STEP_FLOOR_MM 0.02  /* positions are written with two or three decimals */
#define MISSING_STEP 1.5    /* times the usual step */
#define LEAST_LEAN 0.1      /* cosine between the slice normal and the stacking direction */

/* One picture on its way: index, distance along the normal, and what orders it among its like. */
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
  uint32_t *level; /* [count]: which distinct position an entry is at */
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

static double dot3(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void cross3(const double *a, const double *b, double *out) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
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

/* ---- which pictures belong together ---- */

static bool alike(const tc_dicom_slice *a, const tc_dicom_slice *b) {
  if (a->rows != b->rows || a->columns != b->columns || a->has_orientation != b->has_orientation ||
      a->has_position != b->has_position || a->sparse != b->sparse)
    return false;
  if (a->has_spacing && b->has_spacing)
    for (int i = 0; i < 2; i++)
      if (fabs(a->spacing[i] - b->spacing[i]) > 1e-3 * a->spacing[i]) return false;
  return !a->has_orientation || (dot3(a->orientation, b->orientation) > SAME_ORIENTATION &&
                                 dot3(a->orientation + 3, b->orientation + 3) > SAME_ORIENTATION);
}

/* Classes of like pictures, first come first numbered; at most `most` classes (a radial series has one for each
 * slice). */
static size_t classify(const tc_dicom_slice *slices, size_t count, uint32_t *class_of, size_t most) {
  size_t classes = 0;
  uint32_t *first = g_new(uint32_t, most);
  for (size_t i = 0; i < count; i++) {
    size_t c = 0;
    while (c < classes && !alike(&slices[first[c]], &slices[i]))
      c++;
    if (c == classes && classes < most) first[classes++] = (uint32_t)i;
    class_of[i] = (uint32_t)c; /* == most: in none */
  }
  g_free(first);
  return classes;
}

static uint32_t largest_class(const uint32_t *class_of, size_t count, size_t classes) {
  size_t *sizes = g_new0(size_t, classes + 1), best = 0;
  for (size_t i = 0; i < count; i++)
    sizes[class_of[i]]++;
  for (size_t c = 1; c < classes; c++)
    if (sizes[c] > sizes[best]) best = c;
  g_free(sizes);
  return (uint32_t)best;
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

static void measure(work *w) {
  const tc_dicom_slice *first = slice_of(w, 0);
  static const double straight[6] = {1, 0, 0, 0, 1, 0};
  const double *o = first->has_orientation ? first->orientation : straight;
  cross3(o, o + 3, w->normal);
  double length = sqrt(dot3(w->normal, w->normal));
  for (int i = 0; i < 3; i++)
    w->normal[i] /= length > 0 ? length : 1;
  for (size_t i = 0; i < w->count; i++)
    w->entries[i].along = first->has_position ? dot3(slice_of(w, i)->position, w->normal) : 0;
}

/* Positions closer than a fifth of the average step (never more than 0.05 mm) are one level; within a level entries are
 * put in their turn. */
static void find_levels(work *w) {
  qsort(w->entries, w->count, sizeof *w->entries, by_place);
  double range = w->entries[w->count - 1].along - w->entries[0].along;
  double same = w->count > 1 ? 0.2 * range / (double)(w->count - 1) : 0;
  same = same > 0.05 ? 0.05 : same < 1e-5 ? 1e-5 : same;
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

/* Steps must be alike; says what is wrong in terms of slices. at[] are the distances of the levels. */
static bool check_steps(const double *at, size_t levels, char note[256], GError **error) {
  size_t n = levels - 1, bad = 0, gaps = 0, first_gap = 0;
  double *steps = g_new(double, n), mean = (at[levels - 1] - at[0]) / (double)n, drift = 0;
  for (size_t i = 0; i < n; i++)
    steps[i] = at[i + 1] - at[i];
  qsort(steps, n, sizeof *steps, compare_doubles);
  double usual = steps[n / 2], allowed = fmax(STEP_TOLERANCE * mean, STEP_FLOOR_MM), widest = 0;
  for (size_t i = 0; i < n; i++) {
    double step = at[i + 1] - at[i], off = fabs(step - mean);
    if (off > allowed) bad++;
    if (step > MISSING_STEP * usual && gaps++ == 0) first_gap = i + 1;
    widest = fmax(widest, off);
    drift = fmax(drift, fabs(at[i] - at[0] - mean * (double)i));
  }
  g_free(steps);
  if (gaps)
    return fail(error,
                "slices are missing at %zu place%s, the first after slice %zu of %zu (%.3g mm apart, usually %.3g mm);"
                " send the whole series",
                gaps, gaps == 1 ? "" : "s", first_gap, levels, at[first_gap] - at[first_gap - 1], usual);
  if (bad || drift > 0.5 * mean)
    return fail(error,
                "slice positions are not regular (steps differ by up to %.3g mm from %.4g mm); export the series on a"
                " regular grid",
                widest, mean);
  if (widest > 0.01 * mean) tc_dicom_note(note, "slice steps differ by up to %.2g mm, the mean is used", widest);
  return true;
}

/* Positions must lie on one straight line within a voxel. */
static bool check_line(const work *w, const tc_dicom_stack *s, GError **error) {
  double slack = fmax(fmin(s->spacing[0], s->spacing[1]), 0.5 * s->spacing[2]);
  for (size_t i = 0; i < s->count; i++) {
    const tc_dicom_slice *slice = &w->slices[s->items[i].slice];
    double off = 0;
    for (int k = 0; k < 3; k++) {
      double d = slice->position[k] - s->origin[k] - s->direction[3 * k + 2] * s->spacing[2] * s->items[i].layer;
      off += d * d;
    }
    if (sqrt(off) > slack)
      return fail(error,
                  "slices do not lie on a straight line (slice %u is %.3g mm off); they may be several stacks, choose"
                  " one",
                  s->items[i].layer + 1, sqrt(off));
  }
  return true;
}

/* Places column 2, origin and the step from the first and last picture. */
static bool place_stack(const work *w, const tc_dicom_slice *first, const tc_dicom_slice *last, int layers,
                        tc_dicom_stack *s, GError **error) {
  double across[3], length;
  for (int k = 0; k < 3; k++)
    across[k] = last->position[k] - first->position[k];
  length = sqrt(dot3(across, across));
  if (layers > 1 && !(dot3(across, w->normal) > LEAST_LEAN * length))
    return fail(error, "slices are shifted along their own plane and make no volume");
  for (int k = 0; k < 3; k++) {
    s->direction[3 * k + 2] = layers > 1 ? across[k] / length : w->normal[k];
    s->origin[k] = first->has_position ? first->position[k] : 0;
  }
  if (layers > 1) s->spacing[2] = length / (layers - 1);
  return true;
}

/* The header's own distance between slices, for stacks that positions cannot measure. */
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
  for (int i = 0; i < 2; i++)
    s->spacing[i] = first->has_spacing ? first->spacing[i] : 1;
  if (!first->has_spacing) tc_dicom_note(s->note, "pixel spacing unknown, 1 mm used");
  if (!first->has_orientation) tc_dicom_note(s->note, "orientation unknown, axial assumed");
  if (!first->has_position) tc_dicom_note(s->note, "slice positions unknown");
}

/* No positions: every picture is a layer, in its turn. */
static bool stack_by_turn(work *w, tc_dicom_stack *s) {
  qsort(w->entries, w->count, sizeof *w->entries, by_turn);
  for (size_t i = 0; i < w->count; i++)
    s->items[i] = (tc_dicom_layer_item){w->entries[i].slice, (uint32_t)i};
  s->count = w->count;
  s->dims[2] = (int)w->count;
  for (int k = 0; k < 3; k++)
    s->direction[3 * k + 2] = w->normal[k];
  s->spacing[2] = spare_step(slice_of(w, 0), s->note);
  return true;
}

/* The distance of a segmentation's layers: the header's where all steps are whole multiples of it, else the least
 * step. */
static bool segment_step(const double *at, size_t levels, double header, double *step, GError **error) {
  double least = at[1] - at[0];
  for (size_t i = 1; i + 1 < levels; i++)
    least = fmin(least, at[i + 1] - at[i]);
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

static bool stack_segments(work *w, const double *at, tc_dicom_stack *s, GError **error) {
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
  return place_stack(w, slice_of(w, 0), slice_of(w, w->count - 1), s->dims[2], s, error) && check_line(w, s, error);
}

/* Takes the first entry of each level and counts how many complete stacks there are. */
static bool stack_levels(work *w, const double *at, tc_dicom_stack *s, GError **error) {
  size_t most = 0, run = 0;
  for (size_t i = 0; i < w->count; i++) {
    bool fresh = i == 0 || w->level[i] != w->level[i - 1];
    run = fresh ? 1 : run + 1;
    most = run > most ? run : most;
    if (fresh) s->items[s->count++] = (tc_dicom_layer_item){w->entries[i].slice, w->level[i]};
  }
  s->dims[2] = (int)w->levels;
  s->frames = (int)most;
  if (most > 1)
    tc_dicom_note(s->note, "%s %zu pictures at a position (time points, echoes or the like), the first was taken",
                  most * w->levels == w->count ? "each of" : "up to", most);
  if (w->levels == 1)
    s->spacing[2] = spare_step(slice_of(w, 0), s->note);
  else if (!check_steps(at, w->levels, s->note, error))
    return false;
  const tc_dicom_slice *first = &w->slices[s->items[0].slice], *last = &w->slices[s->items[s->count - 1].slice];
  return place_stack(w, first, last, s->dims[2], s, error) && check_line(w, s, error);
}

/* One attempt with the entries in w: fills s from nothing. */
static bool attempt(work *w, tc_dicom_stack *s, GError **error) {
  memset(s, 0, sizeof *s);
  s->frames = 1;
  s->items = g_new(tc_dicom_layer_item, w->count);
  set_plane(slice_of(w, 0), s);
  measure(w);
  if (!slice_of(w, 0)->has_position) return stack_by_turn(w, s);
  find_levels(w);
  double *at = g_new0(double, w->levels);
  for (size_t i = w->count; i-- > 0;)
    at[w->level[i]] = w->entries[i].along;
  /* The first in turn speaks for its level: the very picture that is taken. */
  bool ok = slice_of(w, 0)->sparse ? stack_segments(w, at, s, error) : stack_levels(w, at, s, error);
  g_free(at);
  if (!ok) tc_dicom_stack_finish(s);
  return ok;
}

/* Pictures of class `wanted` (and of one acquisition group, unless any) become entries. */
static void collect(work *w, size_t count, const uint32_t *class_of, uint32_t wanted, const uint32_t *group) {
  w->count = 0;
  for (size_t i = 0; i < count; i++) {
    const tc_dicom_slice *slice = &w->slices[i];
    if (class_of[i] != wanted || (group && slice->group != *group)) continue;
    w->entries[w->count++] = (entry){0, (uint32_t)i, slice->instance, slice->frame, slice->segment};
  }
}

/* All together make no stack: tries each acquisition alone and keeps the one with most layers. Keeps *error
 * otherwise. */
static bool by_acquisition(work *w, size_t count, const uint32_t *class_of, uint32_t wanted, tc_dicom_stack *best) {
  GHashTable *seen = g_hash_table_new(g_direct_hash, g_direct_equal);
  memset(best, 0, sizeof *best);
  for (size_t i = 0; i < count && g_hash_table_size(seen) < 64; i++) {
    uint32_t group = w->slices[i].group;
    if (class_of[i] != wanted || !g_hash_table_add(seen, GUINT_TO_POINTER(group))) continue;
    tc_dicom_stack one;
    collect(w, count, class_of, wanted, &group);
    if (!attempt(w, &one, NULL)) continue;
    if (one.dims[2] > best->dims[2]) {
      tc_dicom_stack_finish(best);
      *best = one;
    } else {
      tc_dicom_stack_finish(&one);
    }
  }
  bool ok = g_hash_table_size(seen) > 1 && best->dims[2] > 1;
  g_hash_table_destroy(seen);
  if (!ok) tc_dicom_stack_finish(best);
  return ok;
}

bool tc_dicom_stack_make(const tc_dicom_slice *slices, size_t count, tc_dicom_stack *stack, GError **error) {
  work w = {.slices = slices, .entries = g_new(entry, count), .level = g_new(uint32_t, count)};
  uint32_t *class_of = g_new(uint32_t, count);
  GError *why = NULL;
  size_t classes = classify(slices, count, class_of, 1024);
  uint32_t wanted = largest_class(class_of, count, classes);
  collect(&w, count, class_of, wanted, NULL);
  size_t members = w.count;
  bool ok = attempt(&w, stack, &why);
  if (!ok && by_acquisition(&w, count, class_of, wanted, stack)) {
    ok = true;
    tc_dicom_note(stack->note, "the largest of several acquisitions was taken");
    g_clear_error(&why);
  }
  if (ok && members < count)
    tc_dicom_note(stack->note, "%zu pictures of another size or orientation left out", count - members);
  if (why) g_propagate_error(error, why);
  g_free(class_of);
  g_free(w.entries);
  g_free(w.level);
  return ok;
}

void tc_dicom_stack_finish(tc_dicom_stack *stack) {
  g_free(stack->items);
  memset(stack, 0, sizeof *stack);
}
