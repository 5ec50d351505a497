#include "server/catalogue/beneath.h"
#include "renderer/import/import.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/openat2.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

/* Fallback for kernels and sandboxes without openat2(): opens one component at a time, follows no link, refuses "..".
 */
static int open_by_steps(int folder_fd, const char *relative) {
  char **parts = g_strsplit(relative, "/", -1);
  int fd = fcntl(folder_fd, F_DUPFD_CLOEXEC, 0);
  for (char **part = parts; fd >= 0 && *part; part++) {
    if (!**part || strcmp(*part, ".") == 0) continue;
    const int next = strcmp(*part, "..") == 0 ? -1 : openat(fd, *part, O_PATH | O_CLOEXEC | O_NOFOLLOW);
    struct stat status;
    close(fd);
    fd = next;
    if (fd >= 0 && (fstat(fd, &status) != 0 || S_ISLNK(status.st_mode))) {
      close(fd);
      fd = -1;
    }
  }
  g_strfreev(parts);
  return fd;
}

static bool goes_up(const char *relative) {
  char **parts = g_strsplit(relative, "/", -1);
  const bool up = g_strv_contains((const char *const *)parts, "..");
  g_strfreev(parts);
  return up;
}

static int open_beneath(const char *folder, const char *relative) {
  const int folder_fd = open(folder, O_PATH | O_DIRECTORY | O_CLOEXEC);
  if (folder_fd < 0) return -1;
  struct open_how how = {.flags = O_PATH | O_CLOEXEC, .resolve = RESOLVE_BENEATH | RESOLVE_NO_MAGICLINKS};
  int fd = (int)syscall(SYS_openat2, folder_fd, relative, &how, sizeof how);
  if (fd < 0 && errno == ENOSYS) fd = relative[0] == '/' ? -1 : open_by_steps(folder_fd, relative);
  if (fd < 0 && !goes_up(relative)) fd = tc_links_open(folder_fd, relative, O_PATH);
  close(folder_fd);
  return fd;
}

/* The path of an open file that was checked to be inside; NULL unless it is a regular file or a folder. */
static char *name_of(int fd) {
  struct stat status;
  if (fstat(fd, &status) != 0 || !(S_ISREG(status.st_mode) || S_ISDIR(status.st_mode))) return NULL;
  char link[64];
  snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
  return g_file_read_link(link, NULL);
}

char *tcs_beneath(const char *folder, const char *relative, GError **error) {
  if (!*relative) {
    tc_set_error(error, TC_ERROR_INVALID, "/path", "the path is empty; give one inside the data folder");
    return NULL;
  }
  const char *series = NULL; /* "#2", "#volume=3" or "#2#volume=3" */
  char *plain = g_strdup(relative), *mark;
  int fd = open_beneath(folder, relative);
  for (int part = 0; fd < 0 && part < 2 && (mark = strrchr(plain, '#')); part++) {
    *mark = 0;
    series = relative + (mark - plain);
    fd = open_beneath(folder, *plain ? plain : ".");
  }
  g_free(plain);
  char *path = fd >= 0 ? name_of(fd) : NULL;
  if (fd >= 0) close(fd);
  if (!path) {
    tc_set_error(error, TC_ERROR_NOT_FOUND, "/path", "no such file in the data folder; GET /v1/volumes lists them");
    return NULL;
  }
  if (series) {
    char *chosen = g_strconcat(path, series, NULL);
    g_free(path);
    path = chosen;
  }
  return path;
}

typedef struct scan {
  GPtrArray *found;
  const char *folder;
  bool meshes; /* mesh files instead of volume files */
  int limit, folders;
} scan;

typedef struct found_file {
  char *path;
  double bytes;
} found_file;

static void free_found(void *item) {
  found_file *file = item;
  g_free(file->path);
  g_free(file);
}

static bool has_volume_name(const char *name) {
  static const char *const suffixes[] = {".nii", ".hdr", ".nrrd", ".nhdr", ".mha", ".mhd", ".mgh",
                                         ".mgz", ".par", ".mnc",  ".dcm",  ".zip", ".vmd"};
  static const char *const packings[] = {".gz", ".bz2"};
  char *lower = g_ascii_strdown(name, -1);
  bool found = false;
  for (size_t i = 0; i < G_N_ELEMENTS(packings); i++)
    if (g_str_has_suffix(lower, packings[i])) lower[strlen(lower) - strlen(packings[i])] = '\0';
  for (size_t i = 0; i < G_N_ELEMENTS(suffixes) && !found; i++) found = g_str_has_suffix(lower, suffixes[i]);
  g_free(lower);
  return found;
}

static void add_found(scan *s, const char *path, double bytes) {
  found_file *file = g_new(found_file, 1);
  file->path = g_strdup(path);
  file->bytes = bytes;
  g_ptr_array_add(s->found, file);
}

/* Bounds of a scan: folders entered, and depth. A larger data folder needs a database of its own. */
#define MAX_FOLDERS 4096
#define MAX_DEPTH 12

static bool has_dicom_mark(int folder_fd, const char *name) {
  char mark[4] = "";
  const int fd = openat(folder_fd, name, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  const bool found = fd >= 0 && pread(fd, mark, sizeof mark, 128) == sizeof mark && memcmp(mark, "DICM", 4) == 0;
  if (fd >= 0) close(fd);
  return found;
}

/* Whether a file is a slice: named *.dcm or as a picture, or without suffix. Only the first file without a suffix in a
 * folder is opened, and decides for all of them. `nameless`: 0 = none seen yet, 1 = they are slices, -1 = they are not.
 */
static bool is_slice(int folder_fd, const char *name, int *nameless) {
  static const char *const endings[] = {".dcm", ".png", ".tif", ".tiff"};
  for (size_t i = 0; i < G_N_ELEMENTS(endings); i++)
    if (g_str_has_suffix(name, endings[i])) return true;
  if (strchr(name, '.')) return false;
  if (*nameless == 0) *nameless = has_dicom_mark(folder_fd, name) ? 1 : -1;
  return *nameless > 0;
}

/* Replaces a link's status by its target's, if the target is a file that may be opened. Links to folders are skipped,
 * since they could lead in circles. */
static void follow(const scan *s, const char *path, struct stat *status) {
  const int fd = S_ISLNK(status->st_mode) ? open_beneath(s->folder, path) : -1;
  struct stat there;
  if (fd >= 0 && fstat(fd, &there) == 0 && S_ISREG(there.st_mode)) *status = there;
  if (fd >= 0) close(fd);
}

static void scan_folder(scan *s, int parent_fd, const char *name, const char *path, int depth) {
  if (depth > MAX_DEPTH || s->folders++ > MAX_FOLDERS) return;
  const int fd = openat(parent_fd, name, O_RDONLY | O_DIRECTORY | O_CLOEXEC | O_NOFOLLOW);
  DIR *folder = fd >= 0 ? fdopendir(fd) : NULL;
  if (!folder) {
    if (fd >= 0) close(fd);
    return;
  }
  int slices = 0, nameless = 0;
  double slice_bytes = 0;
  char *first_slice = NULL;
  for (struct dirent *item; (int)s->found->len < s->limit && (item = readdir(folder));) {
    struct stat status;
    if (item->d_name[0] == '.' || fstatat(fd, item->d_name, &status, AT_SYMLINK_NOFOLLOW) != 0) continue;
    char *child = *path ? g_strconcat(path, "/", item->d_name, NULL) : g_strdup(item->d_name);
    follow(s, child, &status);
    if (S_ISDIR(status.st_mode)) {
      scan_folder(s, fd, item->d_name, child, depth + 1);
    } else if (S_ISREG(status.st_mode) && !s->meshes && is_slice(fd, item->d_name, &nameless)) {
      slices++;
      slice_bytes += (double)status.st_size;
      if (!first_slice) first_slice = g_strdup(child);
    } else if (S_ISREG(status.st_mode) && (s->meshes ? tc_import_names_mesh : has_volume_name)(item->d_name)) {
      add_found(s, child, (double)status.st_size);
    }
    g_free(child);
  }
  if (slices == 1 || (slices > 1 && !*path))
    add_found(s, slices == 1 ? first_slice : ".", slice_bytes);
  else if (slices > 1)
    add_found(s, path, slice_bytes);
  g_free(first_slice);
  closedir(folder);
}

static int compare_found(const void *a, const void *b) {
  const found_file *const *x = a, *const *y = b;
  return strcmp((*x)->path, (*y)->path);
}

cJSON *tcs_available(const char *folder, bool meshes, int limit) {
  scan s = {.folder = folder, .meshes = meshes, .found = g_ptr_array_new_with_free_func(free_found), .limit = limit};
  if (folder) scan_folder(&s, AT_FDCWD, folder, "", 0);
  g_ptr_array_sort(s.found, compare_found);
  cJSON *list = cJSON_CreateArray();
  for (guint i = 0; i < s.found->len; i++) {
    const found_file *file = g_ptr_array_index(s.found, i);
    if (!g_utf8_validate(file->path, -1, NULL)) continue; /* cannot be named in JSON */
    cJSON *item = cJSON_CreateObject();
    cJSON_AddStringToObject(item, "path", file->path);
    cJSON_AddNumberToObject(item, "bytes", file->bytes);
    cJSON_AddItemToArray(list, item);
  }
  g_ptr_array_unref(s.found);
  return list;
}
