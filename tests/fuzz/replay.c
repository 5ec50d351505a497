/* main() for a fuzz target built without a fuzzer: feeds it every file of the folders (or files) named on the command
 * line. A folder that does not exist counts as empty; no file at all is a failure, for then nothing was tested. */
#include <glib.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

static int feed_file(const char *path) {
  char *bytes = NULL;
  gsize size = 0;
  if (!g_file_get_contents(path, &bytes, &size, NULL)) return 0;
  uint8_t *exact = g_memdup2(bytes, size); /* without the zero that GLib appends: an over-read is seen */
  fprintf(stderr, "%s\n", path);
  LLVMFuzzerTestOneInput(exact ? exact : (const uint8_t *)"", size);
  g_free(exact);
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
