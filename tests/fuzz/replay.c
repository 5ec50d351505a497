/* main() for a fuzz target built without a fuzzer: feeds it every file of the folders (or files) named on the command
 * line, small ones also cut short. A folder that does not exist counts as empty; no file at all is a failure, for then nothing was tested. */
#include <glib.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

#ifndef EVERY_PREFIX_BYTES /* files of up to so many are cut behind each byte; 0 where a run takes long */
#define EVERY_PREFIX_BYTES 2048
#endif

extern bool fuzz_opened __attribute__((weak)); /* of a target whose files must not open as whole ones when they are cut */

/* Exactly its bytes, without the zero that GLib appends: an over-read is seen. */
static void feed(const char *bytes, gsize size) {
  uint8_t *exact = g_memdup2(bytes, size);
  LLVMFuzzerTestOneInput(exact ? exact : (const uint8_t *)"", size);
  g_free(exact);
}

/* A small file also cut behind each of its bytes. */
static int feed_file(const char *path) {
  char *bytes = NULL;
  gsize size = 0;
  if (!g_file_get_contents(path, &bytes, &size, NULL)) return 0;
  fprintf(stderr, "%s\n", path);
  for (gsize n = size <= EVERY_PREFIX_BYTES ? 0 : size; n <= size; n++) {
    feed(bytes, n);
    if (&fuzz_opened && fuzz_opened && n < size) {
      fprintf(stderr, "the first %zu of %zu bytes opened\n", n, size);
      abort();
    }
  }
  g_free(bytes);
  return 1;
}

static int by_name(gconstpointer a, gconstpointer b) { return strcmp(*(char *const *)a, *(char *const *)b); }

static int feed_folder(const char *folder) {
  GDir *dir = g_dir_open(folder, 0, NULL);
  GPtrArray *names = g_ptr_array_new_with_free_func(g_free);
  const char *name;
  int fed = 0;
  while (dir && (name = g_dir_read_name(dir))) g_ptr_array_add(names, g_build_filename(folder, name, NULL));
  if (dir) g_dir_close(dir);
  g_ptr_array_sort(names, by_name);
  for (guint i = 0; i < names->len; i++) fed += feed_file(names->pdata[i]);
  g_ptr_array_free(names, TRUE);
  return fed;
}

int main(int argc, char **argv) {
  int fed = 0;
  for (int i = 1; i < argc; i++)
    fed += g_file_test(argv[i], G_FILE_TEST_IS_DIR) ? feed_folder(argv[i]) : feed_file(argv[i]);
  fprintf(stderr, "%d inputs\n", fed);
  return fed ? 0 : 1;
}
