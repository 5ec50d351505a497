#include "renderer/import/colors.h"

#include <stdlib.h>

enum { SLOTS = 1 << 16, EXACT = 32767, COARSE = 32768 }; /* labels 1..EXACT, then a grid of 5 bits a channel */

struct tc_colors {
  tc_volume *volume, *labels;
  uint64_t at, voxels;
  uint8_t rest[3];
  int n_rest;
  uint32_t n;              /* exact colours */
  uint32_t colors[EXACT];  /* 0xrrggbb, by label - 1 */
  uint16_t slots[SLOTS];   /* labels, by their colours; 0: free */
  bool coarse[COARSE];     /* labels of the grid that are in use */
};

tc_colors *tc_colors_new(tc_volume *volume, GError **error) {
  tc_volume_desc desc = *tc_volume_describe(volume);
  desc.type = TC_U16;
  desc.slope = 1, desc.intercept = 0;
  tc_colors *c = calloc(1, sizeof *c);
  if (!c) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "volume: no memory for colours");
    return NULL;
  }
  c->volume = volume;
  c->voxels = tc_volume_bytes(volume);
  c->labels = tc_volume_new(&desc, error);
  if (c->labels) return c;
  free(c);
  return NULL;
}

void tc_colors_free(tc_colors *c) {
  if (c) tc_volume_unref(c->labels);
  free(c);
}

/* The first colours are kept exactly; once labels run out, others to five bits a channel. */
static uint16_t label_of(tc_colors *c, uint32_t color) {
  uint32_t slot = (color * UINT32_C(2654435761)) >> 16;
  for (; c->slots[slot]; slot = (slot + 1) % SLOTS)
    if (c->colors[c->slots[slot] - 1] == color) return c->slots[slot];
  if (c->n < EXACT) {
    c->colors[c->n++] = color;
    return c->slots[slot] = (uint16_t)c->n;
  }
  const uint32_t coarse = (color >> 19 & 31) << 10 | (color >> 11 & 31) << 5 | (color >> 3 & 31);
  c->coarse[coarse] = true;
  return (uint16_t)(COARSE + coarse);
}

static void put_voxel(tc_colors *c, const uint8_t rgb[3]) {
  const double luma = 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
  ((uint8_t *)tc_volume_voxels(c->volume))[c->at] = (uint8_t)(luma + 0.5);
  ((uint16_t *)tc_volume_voxels(c->labels))[c->at++] = label_of(c, (uint32_t)rgb[0] << 16 | (uint32_t)rgb[1] << 8 | rgb[2]);
}

bool tc_colors_put(tc_colors *c, const uint8_t *bytes, size_t size) {
  if (size > 3 * (c->voxels - c->at) - (uint64_t)c->n_rest) return false;
  for (size_t i = 0; i < size; i++) {
    c->rest[c->n_rest++] = bytes[i];
    if (c->n_rest < 3) continue;
    put_voxel(c, c->rest);
    c->n_rest = 0;
  }
  return true;
}

static tc_segment segment_of(uint32_t label, uint32_t r, uint32_t g, uint32_t b) {
  return (tc_segment){.label = label, .has_color = true, .color = {(float)r / 255, (float)g / 255, (float)b / 255}};
}

static uint32_t widened(uint32_t five) { return five << 3 | five >> 2; }

bool tc_colors_end(tc_colors *c) {
  if (c->at != c->voxels) return false;
  GArray *all = g_array_new(FALSE, FALSE, sizeof(tc_segment));
  for (uint32_t i = 0; i < c->n; i++) {
    const tc_segment s = segment_of(i + 1, c->colors[i] >> 16, c->colors[i] >> 8 & 255, c->colors[i] & 255);
    g_array_append_val(all, s);
  }
  for (uint32_t i = 0; i < COARSE; i++) {
    if (!c->coarse[i]) continue;
    const tc_segment s = segment_of(COARSE + i, widened(i >> 10), widened(i >> 5 & 31), widened(i & 31));
    g_array_append_val(all, s);
  }
  tc_volume_set_segments(c->labels, (const tc_segment *)(const void *)all->data, all->len);
  g_array_unref(all);
  tc_volume_seal(c->labels);
  tc_volume_set_colors(c->volume, c->labels);
  c->labels = NULL;
  return true;
}
