/* Reads files in this process with the helper's decoders: faster than a helper process for thousands of small tests,
 * and visible to a fuzzer. */
#ifndef TC_TEST_READ_HERE_H
#define TC_TEST_READ_HERE_H

#include <fcntl.h>
#include <string.h>
#include <unistd.h>

#include "renderer/import/beside.h"
#include "renderer/import/colors.h"
#include "renderer/import/helper/format.h"
#include "renderer/splat/vmd.h"

typedef struct read_here {
  const tc_import_options *options; /* never NULL */
  tc_volume *volume;
  uint8_t *model; /* instead of the volume's voxels */
  tc_colors *colors; /* or these */
  size_t done, total;
  double fraction;
  uint8_t slot[TC_ORDER_MOST_BYTES];
  int folder;
} read_here;

static bool here_want(void *user, uint64_t bytes, GError **error) {
  read_here *here = user;
  return !here->options->reserve || here->options->reserve(here->options->user, bytes, error);
}

static bool here_begin(void *user, const tc_volume_desc *desc, const tc_provenance *from, GError **error) {
  read_here *here = user;
  here->volume = tc_volume_new(desc, error);
  if (!here->volume) return false;
  tc_volume_set_provenance(here->volume, from);
  here->total = tc_volume_bytes(here->volume) * (from->colors ? 3 : 1);
  if (from->colors) here->colors = tc_colors_new(here->volume, NULL);
  return here_want(here, here->total, error);
}

static bool here_begin_model(void *user, uint64_t bytes, GError **error) {
  read_here *here = user;
  here->model = g_malloc(bytes + 1);
  here->total = bytes;
  return here_want(here, bytes, error);
}

static bool here_segment(void *user, const tc_segment *segment, GError **error) {
  read_here *here = user;
  size_t count;
  const tc_segment *known = tc_volume_segments(here->volume, &count);
  tc_segment *all = g_new(tc_segment, count + 1);
  if (count) memcpy(all, known, count * sizeof *all);
  all[count] = *segment;
  tc_volume_set_segments(here->volume, all, count + 1);
  g_free(all);
  return true;
}

static void *here_room(void *user, GError **error) { return ((read_here *)user)->slot; }

static bool here_filled(void *user, size_t bytes, GError **error) {
  read_here *here = user;
  if ((!here->volume && !here->model) || bytes > here->total - here->done || bytes > sizeof here->slot) abort();
  if (here->colors && !tc_colors_put(here->colors, here->slot, bytes)) abort();
  if (!here->colors) memcpy((here->model ? here->model : (uint8_t *)tc_volume_voxels(here->volume)) + here->done, here->slot, bytes);
  here->done += bytes;
  return true;
}

static bool here_goes_on(void *user, double fraction, GError **error) {
  read_here *here = user;
  here->fraction = fraction;
  if (!here->options->progress || here->options->progress(here->options->user, fraction)) return true;
  tc_set_error(error, TC_ERROR_CANCELLED, NULL, "cancelled");
  return false;
}

static int here_open(void *user, const char *name, bool optional, GError **error) {
  return tc_beside_open(((read_here *)user)->folder, name, optional ? NULL : error);
}

static bool here_seals(void *user) { return here_goes_on(user, 1, NULL); }

/* Reads with `read`, a tc_format's function, or NULL: detects the format by content and name. `folder` holds files
 * besides the input, or -1. Closes the input. */
static inline tc_volume *read_input_here(tc_input *input, int folder,
                                         bool (*read)(const tc_input *, const tc_order *, GError **),
                                         const tc_import_options *options, GError **error) {
  static const tc_import_options none;
  read_here here = {.options = options ? options : &none, .folder = folder};
  const tc_order order = {.volume = here.options->volume,
                          .max_voxel_bytes = here.options->max_voxel_bytes,
                          .user = &here,
                          .want = here_want,
                          .begin = here_begin,
                          .begin_model = here_begin_model,
                          .segment = here_segment,
                          .room = here_room,
                          .filled = here_filled,
                          .goes_on = here_goes_on,
                          .open = here_open};
  if (folder >= 0) {
    input->open = here_open;
    input->open_user = &here;
  }
  bool ok = read ? read(input, &order, error) : tc_formats_read(input, "", &order, error);
  tc_input_close(input);
  if (ok && here.done != here.total) abort();
  if (ok && here.model) {
    tc_vmd *vmd = tc_vmd_decode(here.model, here.total, error);
    ok = vmd && (here.volume = tc_vmd_volume(vmd, error));
    if (!ok) tc_vmd_free(vmd);
  }
  g_free(here.model);
  if (ok && here.colors && !tc_colors_end(here.colors)) abort();
  tc_colors_free(here.colors);
  if (ok && !tc_volume_seal_while(here.volume, here_seals, &here)) {
    tc_set_error(error, TC_ERROR_CANCELLED, NULL, "cancelled");
    ok = false;
  }
  if (ok) return here.volume;
  tc_volume_unref(here.volume);
  return NULL;
}

static inline tc_volume *read_file_here(const char *path, const tc_import_options *options, GError **error) {
  char *folder = g_path_get_dirname(path), *name = g_path_get_basename(path);
  const int fd = open(path, O_RDONLY | O_CLOEXEC), folder_fd = open(folder, O_RDONLY | O_CLOEXEC | O_DIRECTORY);
  tc_input input;
  tc_volume *volume = NULL;
  GError *trouble = NULL;
  if (fd < 0)
    tc_set_error(&trouble, TC_ERROR_NOT_FOUND, NULL, "no such file");
  else if (tc_input_adopt(&input, fd, name, &trouble))
    volume = read_input_here(&input, folder_fd, NULL, options, &trouble);
  if (!volume) g_propagate_prefixed_error(error, trouble, "open %s: ", name);
  if (folder_fd >= 0) close(folder_fd);
  g_free(name);
  g_free(folder);
  return volume;
}

#endif
