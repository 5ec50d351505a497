/* Divides the pictures of a series into volumes by the rules of dicom_group.h. */
#include "renderer/import/helper/dicom_group.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/base/vector.h"

/* Cosine below which two orientations differ: about 0.8 degrees, more than rounding in headers, less than any real
 * tilt. */
#define SAME_ORIENTATION 0.9999

#define GAP_STEPS 4 /* in slice distances: a part farther away is another volume */

enum { CLASSES_MOST = 1024 };

/* One picture on its way. */
typedef struct entry {
  const tc_dicom_slice *slice;
  uint32_t class_of, level; /* level: number of its position among the different positions of its class */
  double along;
} entry;

typedef struct work {
  const tc_dicom_slice *slices;
  entry *entries; /* [count]; each step sorts a range of them */
  size_t count;
  GArray *groups;  /* tc_dicom_group */
  uint32_t *store; /* [2 * count], slices of the groups; fractions belong to two groups */
  size_t stored;
} work;

/* ---- alike ---- */

static bool alike(const tc_dicom_slice *a, const tc_dicom_slice *b) {
  if (a->rows != b->rows || a->columns != b->columns || a->has_orientation != b->has_orientation ||
      a->has_position != b->has_position || a->sparse != b->sparse || a->fractional != b->fractional)
    return false;
  if (a->has_spacing && b->has_spacing)
    for (int i = 0; i < 2; i++)
      if (fabs(a->spacing[i] - b->spacing[i]) > 1e-3 * a->spacing[i]) return false;
  return !a->has_orientation || (dot3(a->orientation, b->orientation) > SAME_ORIENTATION &&
                                 dot3(a->orientation + 3, b->orientation + 3) > SAME_ORIENTATION);
}

/* Numbers the classes of pictures with equal size and orientation. A radial series has one class per slice: pictures
 * beyond CLASSES_MOST classes share a last class, of which no volume is made. */
static void classify(work *w) {
  size_t classes = 0;
  const tc_dicom_slice **first = g_new(const tc_dicom_slice *, CLASSES_MOST);
  for (size_t i = 0; i < w->count; i++) {
    size_t c = 0;
    while (c < classes && !alike(first[c], w->entries[i].slice)) c++;
    if (c == classes && classes < CLASSES_MOST) first[classes++] = w->entries[i].slice;
    w->entries[i].class_of = (uint32_t)c;
  }
  g_free(first);
}

/* ---- orders ---- */

static int order(double a, double b) { return (a > b) - (a < b); }

static int by_turn(const void *pa, const void *pb) {
  const tc_dicom_slice *a = ((const entry *)pa)->slice, *b = ((const entry *)pb)->slice;
  if (a->instance != b->instance) return a->instance < b->instance ? -1 : 1;
  if (a->frame != b->frame) return a->frame < b->frame ? -1 : 1;
  return a < b ? -1 : a > b;
}

static int by_place(const void *pa, const void *pb) {
  const entry *a = pa, *b = pb;
  int first = a->class_of != b->class_of ? order(a->class_of, b->class_of) : order(a->along, b->along);
  return first ? first : by_turn(pa, pb);
}

static int by_level(const void *pa, const void *pb) {
  const entry *a = pa, *b = pb;
  int first = a->level != b->level ? order(a->level, b->level) : order(a->slice->trigger, b->slice->trigger);
  return first ? first : by_turn(pa, pb);
}

/* A map computed from several echoes has no echo time; it is sorted behind them. */
static double key_place(const entry *e, tc_dicom_key key) {
  double value = e->slice->keys[key];
  return key == TC_DICOM_KEY_ECHO_TIME && value == 0 ? INFINITY : value;
}

static int by_key(const void *pa, const void *pb, void *user) {
  const tc_dicom_key key = *(const tc_dicom_key *)user;
  int first = order(key_place(pa, key), key_place(pb, key));
  return first ? first : by_turn(pa, pb);
}

static int by_segment(const void *pa, const void *pb) {
  const entry *a = pa, *b = pb;
  return a->slice->segment != b->slice->segment ? order(a->slice->segment, b->slice->segment) : by_level(pa, pb);
}

static int by_uid(const void *pa, const void *pb) {
  const tc_dicom_slice *a = ((const entry *)pa)->slice, *b = ((const entry *)pb)->slice;
  if (a->uid != b->uid) return a->uid < b->uid ? -1 : 1;
  return by_turn(pa, pb);
}

/* Pictures with equal UIDs are copies only if everything else agrees, too: some writers give all pictures one UID. */
static bool copies(const tc_dicom_slice *a, const tc_dicom_slice *b) {
  return a->uid && a->uid == b->uid && a->frame == b->frame && a->instance == b->instance &&
         memcmp(a->position, b->position, sizeof a->position) == 0 && memcmp(a->keys, b->keys, sizeof a->keys) == 0;
}

static size_t drop_copies(work *w) {
  size_t kept = 0, given = w->count;
  qsort(w->entries, w->count, sizeof *w->entries, by_uid);
  for (size_t i = 0; i < given; i++)
    if (kept == 0 || !copies(w->entries[kept - 1].slice, w->entries[i].slice)) w->entries[kept++] = w->entries[i];
  w->count = kept;
  return given - kept;
}

/* Numbers the different positions of one class, the sorted entries [from, from + count). Pictures without positions
 * get one number each. */
static size_t number_levels(work *w, size_t from, size_t count) {
  entry *e = w->entries + from;
  size_t start = 0;
  uint32_t level = 0;
  const double same = tc_dicom_same_place(e[count - 1].along - e[0].along, count);
  for (size_t i = 0; i < count; i++) {
    if (i > 0 && (!e[i].slice->has_position || e[i].along - e[start].along > same)) {
      start = i;
      level++;
    }
    e[i].level = level;
  }
  return level + 1;
}

/* ---- volumes ---- */

/* Makes a volume of `places` positions from every `step`-th entry. It is tangled if it has fewer positions than
 * pictures, unless sparse. */
static void emit(work *w, const entry *e, size_t count, size_t step, size_t places) {
  tc_dicom_group group = {.slices = w->store + w->stored, .places = places};
  for (size_t i = 0; i < count; i += step) group.slices[group.count++] = (uint32_t)(e[i].slice - w->slices);
  group.tangled = places < group.count && !e->slice->sparse;
  w->stored += group.count;
  g_array_append_val(w->groups, group);
}

/* Largest number of pictures at one position; *places receives the number of positions. Entries are sorted by level. */
static size_t multiplicity(const entry *e, size_t count, size_t *places) {
  size_t most = 0, run = 0;
  *places = 0;
  for (size_t i = 0; i < count; i++) {
    run++;
    if (i + 1 < count && e[i + 1].level == e[i].level) continue;
    most = MAX(most, run);
    run = 0;
    ++*places;
  }
  return most;
}

/* End of the run from `from` whose positions advance in one direction. */
static size_t run_end(const entry *e, size_t count, size_t from, int direction) {
  size_t i = from + 1;
  for (; i < count; i++)
    if ((e[i].level > e[i - 1].level) - (e[i].level < e[i - 1].level) != direction) break;
  return i;
}

/* Separates time points acquired one after another, some with missing slices: a new one begins where positions turn
 * back. Entries are sorted by turn. */
static bool emit_runs(work *w, entry *e, size_t count, size_t wanted) {
  for (int direction = 1; direction >= -1; direction -= 2) {
    size_t runs = 0;
    for (size_t i = 0; i < count && runs <= wanted; runs++) i = run_end(e, count, i, direction);
    if (runs != wanted) continue;
    for (size_t i = 0, end; i < count; i = end) {
      end = run_end(e, count, i, direction);
      emit(w, e + i, end - i, 1, end - i);
    }
    return true;
  }
  return false;
}

/* Separates pictures that differ only in their turn. */
static void split_turns(work *w, entry *e, size_t count) {
  size_t places;
  qsort(e, count, sizeof *e, by_level);
  const size_t each = multiplicity(e, count, &places);
  if (each * places == count) {
    for (size_t turn = 0; turn < each; turn++) emit(w, e + turn, count - turn, each, places);
    return;
  }
  qsort(e, count, sizeof *e, by_turn);
  if (!emit_runs(w, e, count, each)) emit(w, e, count, 1, places);
}

/* Range of levels of some entries, and their positions. */
typedef struct reach {
  uint32_t low, high;
  double from, to;
} reach;

static reach reach_of(const entry *e, size_t count) {
  const entry *low = e, *high = e;
  for (size_t i = 1; i < count; i++) {
    if (e[i].along < low->along) low = &e[i];
    if (e[i].along > high->along) high = &e[i];
  }
  return (reach){low->level, high->level, low->along, high->along};
}

static double mean_step(const reach *r) { return r->high > r->low ? (r->to - r->from) / (r->high - r->low) : 0; }

/* Whether `b` continues `a`: beyond its end, without a gap that slices would have filled. */
static bool goes_on(const reach *a, const reach *b) {
  const double step = fmax(mean_step(a), mean_step(b));
  return b->low > a->high && (step == 0 || b->from - a->to < GAP_STEPS * step);
}

/* End of the entries with the key of entry `from`. */
static size_t part_end(const entry *e, size_t count, size_t from, tc_dicom_key key) {
  size_t i = from + 1;
  while (i < count && e[i].slice->keys[key] == e[from].slice->keys[key]) i++;
  return i;
}

static int by_low(const void *pa, const void *pb) {
  const reach *a = pa, *b = pb;
  return order(a->low, b->low);
}

/* Whether the parts of one key lie one beyond another, in any order. */
static bool parts_apart(const entry *e, size_t count, tc_dicom_key key) {
  GArray *parts = g_array_new(FALSE, FALSE, sizeof(reach));
  for (size_t i = 0, end; i < count; i = end) {
    end = part_end(e, count, i, key);
    const reach r = reach_of(e + i, end - i);
    g_array_append_val(parts, r);
  }
  g_array_sort(parts, by_low);
  bool apart = true;
  for (guint i = 1; i < parts->len && apart; i++)
    apart = goes_on(&g_array_index(parts, reach, i - 1), &g_array_index(parts, reach, i));
  g_array_free(parts, TRUE);
  return apart;
}

/* End of the parts from `from` that make one volume: each lies beyond those before it, in one direction. */
static size_t volume_end(const entry *e, size_t count, size_t from, tc_dicom_key key) {
  size_t end = part_end(e, count, from, key);
  reach all = reach_of(e + from, end - from);
  for (int direction = 0; end < count;) {
    const size_t next = part_end(e, count, end, key);
    const reach r = reach_of(e + end, next - end);
    const int side = goes_on(&all, &r) ? 1 : goes_on(&r, &all) ? -1 : 0;
    if (side == 0 || (direction && side != direction)) break;
    direction = side;
    all = (reach){MIN(all.low, r.low), MAX(all.high, r.high), fmin(all.from, r.from), fmax(all.to, r.to)};
    end = next;
  }
  return end;
}

/* Separates entries by one key after another, then by turn. */
static void split(work *w, entry *e, size_t count, tc_dicom_key key) {
  if (key == TC_DICOM_KEY_COUNT) {
    split_turns(w, e, count);
    return;
  }
  g_qsort_with_data(e, (int)count, sizeof *e, by_key, &key);
  const bool soft = key >= TC_DICOM_KEY_IMAGE_TYPE;
  if (soft && (!e->slice->has_position || parts_apart(e, count, key))) {
    split(w, e, count, key + 1);
    return;
  }
  for (size_t i = 0, end; i < count; i = end) {
    end = soft ? volume_end(e, count, i, key) : part_end(e, count, i, key);
    split(w, e + i, end - i, key + 1);
  }
}

/* ---- all of it ---- */

static const struct {
  const char *name, *unit;
} key_words[TC_DICOM_KEY_COUNT] = {[TC_DICOM_KEY_TIME] = {"time", ""},
                                   [TC_DICOM_KEY_ECHO] = {"echo", ""},
                                   [TC_DICOM_KEY_ECHO_TIME] = {"echo time", " ms"},
                                   [TC_DICOM_KEY_B_VALUE] = {"b-value", ""},
                                   [TC_DICOM_KEY_PHASE] = {"phase", " %"},
                                   [TC_DICOM_KEY_ACQUISITION] = {"acquisition", ""}};

/* Describes each group by the keys that differ, with the values of its first picture. */
static void name_groups(const tc_dicom_slice *slices, tc_dicom_groups *groups) {
  for (int key = 0; key < TC_DICOM_KEY_COUNT; key++) {
    bool differ = false;
    for (size_t g = 1; g < groups->count; g++)
      differ |= slices[groups->list[g].slices[0]].keys[key] != slices[groups->list[0].slices[0]].keys[key];
    for (size_t g = 0; g < groups->count && differ && key_words[key].name; g++) {
      char *what = groups->list[g].what;
      const size_t at = strlen(what);
      g_snprintf(what + at, sizeof groups->list[g].what - at, "%s%s %g%s", at ? ", " : "", key_words[key].name,
                 slices[groups->list[g].slices[0]].keys[key], key_words[key].unit);
    }
  }
}

/* Emits the labels of all segments first, then the fractions of each segment. */
static void emit_fractions(work *w, entry *e, size_t count, size_t places) {
  emit(w, e, count, 1, places);
  g_strlcpy(g_array_index(w->groups, tc_dicom_group, w->groups->len - 1).what, "labels", 7);
  qsort(e, count, sizeof *e, by_segment);
  for (size_t from = 0, end; from < count; from = end) {
    const uint32_t segment = e[from].slice->segment;
    size_t levels = 1;
    for (end = from + 1; end < count && e[end].slice->segment == segment; end++)
      levels += e[end].level != e[end - 1].level;
    emit(w, e + from, end - from, 1, levels);
    tc_dicom_group *group = &g_array_index(w->groups, tc_dicom_group, w->groups->len - 1);
    group->segment = segment;
    g_snprintf(group->what, sizeof group->what, "segment %u", segment);
  }
}

/* Counts the positions of one class, the sorted entries [from, from + count), and emits its volumes. */
static size_t split_class(work *w, size_t from, size_t count) {
  entry *e = w->entries + from;
  const size_t places = number_levels(w, from, count);
  if (e->class_of == CLASSES_MOST) return places;
  if (e->slice->fractional)
    emit_fractions(w, e, count, places);
  else if (e->slice->sparse)
    emit(w, e, count, 1, places);
  else
    split(w, e, count, 0);
  return places;
}

void tc_dicom_groups_make(const tc_dicom_slice *slices, size_t count, tc_dicom_groups *groups) {
  work w = {.slices = slices, .entries = g_new0(entry, count), .count = count, .store = g_new(uint32_t, 2 * count)};
  w.groups = g_array_new(FALSE, TRUE, sizeof(tc_dicom_group));
  *groups = (tc_dicom_groups){.store = w.store};
  for (size_t i = 0; i < count; i++) w.entries[i].slice = &slices[i];
  groups->copies = drop_copies(&w);
  qsort(w.entries, w.count, sizeof *w.entries, by_turn);
  classify(&w);
  for (size_t i = 0; i < w.count; i++) {
    double normal[3];
    tc_dicom_normal(w.entries[i].slice, normal);
    w.entries[i].along = w.entries[i].slice->has_position ? dot3(w.entries[i].slice->position, normal) : 0;
  }
  qsort(w.entries, w.count, sizeof *w.entries, by_place);
  for (size_t from = 0, end; from < w.count; from = end) {
    for (end = from + 1; end < w.count && w.entries[end].class_of == w.entries[from].class_of;) end++;
    groups->places += split_class(&w, from, end - from);
  }
  groups->count = w.groups->len;
  groups->list = (tc_dicom_group *)(void *)g_array_free(w.groups, FALSE);
  name_groups(slices, groups);
  g_free(w.entries);
}

void tc_dicom_groups_finish(tc_dicom_groups *groups) {
  g_free(groups->list);
  g_free(groups->store);
  *groups = (tc_dicom_groups){0};
}

int tc_dicom_groups_choose(const tc_dicom_groups *groups, unsigned wanted, GError **error) {
  size_t best = 0;
  if (wanted > 0 && wanted <= groups->count) return (int)wanted - 1;
  if (wanted > 0) {
    tc_set_error(error, TC_ERROR_NOT_FOUND, NULL, "no volume %u; the series holds %zu, choose one by #volume=N", wanted,
                 groups->count);
    return -1;
  }
  for (size_t g = 1; g < groups->count; g++)
    if (groups->list[g].places > groups->list[best].places) best = g;
  if (2 * groups->list[best].places >= groups->places) return (int)best;
  tc_set_error(error, TC_ERROR_FORMAT, NULL,
               "the series is no one volume: it makes %zu, and the largest holds %zu of its %zu slices; choose one by"
               " #volume=1 to #volume=%zu",
               groups->count, groups->list[best].places, groups->places, groups->count);
  return -1;
}
