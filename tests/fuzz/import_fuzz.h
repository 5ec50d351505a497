/* Any bytes through one importer, from memory, with a small folder of data files beside them. Either a sound volume
 * comes out or one clear error; nothing crashes, hangs or asks for memory that the bytes cannot justify. */
#ifndef TC_FUZZ_IMPORT_H
#define TC_FUZZ_IMPORT_H

#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <zlib.h>

#include "tests/support/read_here.h"

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

enum { beside_size = 4096 };

static char beside[] = "/tmp/tc-fuzz-XXXXXX";
static const char *const beside_names[] = {"d.raw", "d.gz", "f.img", "d1", "d2", "d3", "f.REC"};

static void remove_beside(void) {
  for (size_t i = 0; i < G_N_ELEMENTS(beside_names); i++) {
    char *path = g_build_filename(beside, beside_names[i], NULL);
    unlink(path);
    g_free(path);
  }
  rmdir(beside);
}

/* Raw files, and one compressed. */
static void fill_beside(int folder) {
  uint8_t plain[beside_size], packed[beside_size];
  for (int i = 0; i < beside_size; i++) plain[i] = (uint8_t)(i * 7 >> 3);
  z_stream z = {.next_in = plain, .avail_in = sizeof plain, .next_out = packed, .avail_out = sizeof packed};
  if (deflateInit2(&z, 9, Z_DEFLATED, MAX_WBITS + 16, 8, 0) != Z_OK || deflate(&z, Z_FINISH) != Z_STREAM_END) abort();
  for (size_t i = 0; i < G_N_ELEMENTS(beside_names); i++) {
    bool gz = strcmp(beside_names[i], "d.gz") == 0;
    size_t size = gz ? z.total_out : sizeof plain;
    int fd = openat(folder, beside_names[i], O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
    if (fd < 0 || write(fd, gz ? packed : plain, size) != (ssize_t)size) abort();
    close(fd);
  }
  deflateEnd(&z);
}

static int folder_beside(void) {
  static int folder = -1;
  if (folder >= 0) return folder;
  if (!mkdtemp(beside)) abort();
  folder = open(beside, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (folder < 0) abort();
  fill_beside(folder);
  atexit(remove_beside);
  return folder;
}

static void check_volume(const tc_volume *v) {
  const tc_volume_desc *d = tc_volume_describe(v);
  const tc_volume_stats *s = tc_volume_statistics(v);
  if (!(s->min <= s->max) || !isfinite(s->min) || !isfinite(s->max)) abort();
  for (int i = 0; i < 3; i++)
    if (d->dims[i] < 1 || !(d->spacing[i] > 0) || !isfinite(d->spacing[i]) || !isfinite(d->origin[i])) abort();
  if (d->slope == 0 || !isfinite(d->slope) || !isfinite(d->intercept) || d->frames < 1) abort();
  if (!memchr(d->note, 0, sizeof d->note) || !memchr(d->unit, 0, sizeof d->unit)) abort();
}

static inline int fuzz_format(const tc_format *format, const char *name, const uint8_t *bytes, size_t size) {
  tc_import_options options = {.max_voxel_bytes = 8 << 20};
  tc_input input;
  GError *error = NULL;
  format->probe(bytes, size);
  tc_input_memory(&input, bytes, size, name);
  tc_volume *volume = read_input_here(&input, folder_beside(), format->read, &options, &error);
  if (volume) {
    if (error) abort();
    check_volume(volume);
  } else if (!error || error->domain != TC_ERROR || strpbrk(error->message, "\r\n")) {
    abort();
  }
  g_clear_error(&error);
  tc_volume_unref(volume);
  return 0;
}

#endif
