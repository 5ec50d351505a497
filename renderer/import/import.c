/* One entry for all formats: splits a path into file and series, and chooses the helper that reads the file. */
#include "renderer/import/import.h"

#include <string.h>
#include <sys/stat.h>

#include "renderer/import/helper.h"
#include "renderer/volume/demo.h"

typedef struct target {
  char *path;   /* without a series suffix; owned */
  char *series; /* text after '#', or NULL; owned */
  bool folder;
} target;

static void target_clear(target *t) {
  g_clear_pointer(&t->path, g_free);
  g_clear_pointer(&t->series, g_free);
}

/* A DICOMDIR lists pictures in its own folder and in folders below. */
static void use_folder_of_dicomdir(target *t) {
  char *name = g_path_get_basename(t->path);
  if (!t->folder && g_ascii_strcasecmp(name, "DICOMDIR") == 0) {
    char *folder = g_path_get_dirname(t->path);
    g_free(t->path);
    t->path = folder;
    t->folder = true;
  }
  g_free(name);
}

/* A '#' may be part of a file name, so it starts a suffix only if the whole path does not exist. A suffix has one or
 * two parts ("#2#volume=3"). */
static bool find_target(const char *path, target *t, GError **error) {
  struct stat st;
  *t = (target){.path = g_strdup(path)};
  bool found = stat(path, &st) == 0;
  for (int part = 0; !found && part < 2; part++) {
    char *hash = strrchr(t->path, '#');
    if (!hash || hash == t->path) break;
    *hash = '\0';
    g_free(t->series);
    t->series = g_strdup(path + (hash - t->path) + 1);
    found = stat(t->path, &st) == 0;
  }
  if (!found) {
    tc_set_error(error, TC_ERROR_NOT_FOUND, NULL, "no such file or folder");
    target_clear(t);
    return false;
  }
  t->folder = S_ISDIR(st.st_mode);
  use_folder_of_dicomdir(t);
  return true;
}

/* Chooses by content. Packed files are recognised by name only. */
static tc_helper helper_for(const target *t) {
  const bool packed = g_str_has_suffix(t->path, ".dcm.gz") || g_str_has_suffix(t->path, ".dcm.bz2");
  return t->folder || packed ? TC_HELPER_DICOM : tc_helper_for(t->path);
}

/* Adds the file's base name to the error, on one line and in printable characters. */
static void say_which(const char *path, GError *trouble, GError **error) {
  char *name = g_path_get_basename(path);
  for (char *at = name; *at; at++)
    if (g_ascii_iscntrl(*at)) *at = '?';
  g_propagate_prefixed_error(error, trouble, "open %s: ", name);
  g_free(name);
}

tc_volume *tc_import(const char *path, const tc_import_options *options, GError **error) {
  if (g_str_has_prefix(path, "demo:")) {
    const uint64_t bytes = tc_volume_demo_bytes(path + 5);
    if (bytes && options && options->reserve && !options->reserve(options->user, bytes, error)) return NULL;
    return tc_volume_demo_while(path + 5, options ? options->progress : NULL, options ? options->user : NULL, error);
  }
  target t = {0};
  tc_volume *volume = NULL;
  GError *trouble = NULL;
  if (find_target(path, &t, &trouble)) {
    volume = tc_helper_load(helper_for(&t), t.path, t.series, options, &trouble);
    target_clear(&t);
  }
  if (!volume) say_which(path, trouble, error);
  return volume;
}

bool tc_import_names_mesh(const char *path) {
  static const char *const endings[] = {".obj", ".ply", ".stl", ".gz", ".bz2"};
  char *lower = g_ascii_strdown(path, -1);
  bool named = false;
  for (int i = 4; i >= 0; i--) {
    if (!g_str_has_suffix(lower, endings[i])) continue;
    named |= i < 3;
    if (i >= 3) lower[strlen(lower) - strlen(endings[i])] = 0; /* packed: the ending before .gz decides */
  }
  g_free(lower);
  return named;
}

tc_mesh *tc_import_mesh(const char *path, const tc_import_options *options, tc_mesh_file *source, GError **error) {
  target t = {0};
  tc_mesh *mesh = NULL;
  GError *trouble = NULL;
  tc_mesh_file unused;
  if (find_target(path, &t, &trouble)) {
    mesh = tc_helper_load_mesh(t.path, t.series, options, source ? source : &unused, &trouble);
    target_clear(&t);
  }
  if (!mesh) say_which(path, trouble, error);
  return mesh;
}

bool tc_import_list(const char *path, const tc_import_options *options, tc_series **series, size_t *count,
                    GError **error) {
  target t;
  GError *trouble = NULL;
  *series = NULL;
  *count = 0;
  if (g_str_has_prefix(path, "demo:")) return true;
  bool ok = find_target(path, &t, &trouble);
  if (ok && helper_for(&t) == TC_HELPER_DICOM) ok = tc_helper_list(t.path, options, series, count, &trouble);
  target_clear(&t);
  if (!ok) say_which(path, trouble, error);
  return ok;
}
