#include "renderer/import/helper/overlaps.h"

enum { MOST_MEMBERS = 64 }; /* largest number of segments in a combination that are removed and added again */

void tc_overlaps_init(tc_overlaps *o, uint32_t last) {
  *o = (tc_overlaps){.last = last};
  o->made = g_array_new(FALSE, FALSE, sizeof(tc_segment));
  o->pairs = g_hash_table_new(NULL, NULL);
}

void tc_overlaps_finish(tc_overlaps *o) {
  if (o->made) g_array_unref(o->made);
  if (o->pairs) g_hash_table_unref(o->pairs);
  *o = (tc_overlaps){0};
}

uint32_t tc_overlaps_most(const tc_overlaps *o) { return o->last + o->made->len; }

static const tc_segment *combination(const tc_overlaps *o, uint32_t label) {
  return &g_array_index(o->made, tc_segment, label - o->last - 1);
}

static uint32_t join(tc_overlaps *o, uint32_t label, uint32_t segment) {
  const gpointer key = GUINT_TO_POINTER(label << 16 | segment);
  const uint32_t known = GPOINTER_TO_UINT(g_hash_table_lookup(o->pairs, key));
  if (known) return known;
  if (tc_overlaps_most(o) >= TC_SEGMENTS_MAX) {
    o->full = true;
    return segment;
  }
  const tc_segment made = {.label = tc_overlaps_most(o) + 1, .of = {label, segment}};
  g_array_append_val(o->made, made);
  g_hash_table_insert(o->pairs, key, GUINT_TO_POINTER(made.label));
  return made.label;
}

/* A combination is built from its segments in ascending order, so that each set has one label: larger segments are
 * removed, the new one is added, and they are added again. */
static uint32_t find(tc_overlaps *o, uint32_t under, uint32_t segment) {
  uint32_t above[MOST_MEMBERS];
  int n = 0;
  if (!under) return segment;
  while (under > o->last && combination(o, under)->of[1] > segment) {
    if (n == MOST_MEMBERS) return o->full = true, segment;
    above[n++] = combination(o, under)->of[1];
    under = combination(o, under)->of[0];
  }
  const uint32_t top = under > o->last ? combination(o, under)->of[1] : under;
  if (top > segment)
    under = join(o, segment, under); /* a single, larger segment */
  else if (top < segment)
    under = join(o, under, segment);
  while (n > 0) under = join(o, under, above[--n]);
  return under;
}

uint32_t tc_overlaps_label(tc_overlaps *o, uint32_t under, uint32_t segment) {
  if (under == o->under && segment == o->segment) return o->label;
  const uint32_t label = find(o, under, segment);
  o->under = under;
  o->segment = segment;
  return o->label = label;
}

bool tc_overlaps_send(const tc_overlaps *o, const tc_segment *segments, size_t count, const tc_order *order,
                      GError **error) {
  for (size_t i = 0; i < count; i++)
    if (!order->segment(order->user, &segments[i], error)) return false;
  for (guint i = 0; o->made && i < o->made->len; i++)
    if (!order->segment(order->user, &g_array_index(o->made, tc_segment, i), error)) return false;
  return true;
}
