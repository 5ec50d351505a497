/* A temporary folder for a test, removed with its contents. */
#ifndef TC_TEST_FOLDER_H
#define TC_TEST_FOLDER_H

#include <glib.h>
#include <glib/gstdio.h>

static char *folder;

static inline void remove_tree(const char *path) {
  GDir *dir = g_dir_open(path, 0, NULL);
  for (const char *name; dir && (name = g_dir_read_name(dir));) {
    char *child = g_build_filename(path, name, NULL);
    if (g_file_test(child, G_FILE_TEST_IS_DIR) && !g_file_test(child, G_FILE_TEST_IS_SYMLINK))
      remove_tree(child);
    else
      g_unlink(child);
    g_free(child);
  }
  if (dir) g_dir_close(dir);
  g_rmdir(path);
}

static inline char *temp_folder(void) { return g_dir_make_tmp("tomocast-test-XXXXXX", NULL); }

static inline int make_folder(void **state) { return (folder = temp_folder()) ? 0 : -1; }

static inline int remove_folder(void **state) {
  remove_tree(folder);
  g_clear_pointer(&folder, g_free);
  return 0;
}

#endif
