/* The helper's files. They are opened relative to the input folder; links to files are followed as far as Landlock
 * allows (see confine.c); zip members are reached by number; nothing is written. */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "renderer/import/helper/decode.h"
#include "renderer/import/helper/dicom_sources.h"

enum { WALK_DEPTH = 16, WALK_FILES = 200000 };

static bool fail(GError **error, tc_error_code code, const char *what) {
  tc_set_error(error, code, NULL, "%s", what);
  return false;
}

static int by_name(const void *a, const void *b) { return strcmp(*(char *const *)a, *(char *const *)b); }

/* Collects the files of a folder and links to files, but not links to folders, which could lead in circles. Takes
 * ownership of fd. False only if there are too many. */
static bool walk(int fd, const char *prefix, int depth, GPtrArray *names) {
  DIR *dir = fdopendir(fd);
  if (!dir) {
    close(fd);
    return true;
  }
  bool ok = true;
  for (struct dirent *e; ok && (e = readdir(dir));) {
    struct stat st;
    if (strcmp(e->d_name, ".") == 0 || strcmp(e->d_name, "..") == 0) continue;
    if (fstatat(dirfd(dir), e->d_name, &st, AT_SYMLINK_NOFOLLOW) != 0) continue;
    if (S_ISLNK(st.st_mode) && (fstatat(dirfd(dir), e->d_name, &st, 0) != 0 || !S_ISREG(st.st_mode))) continue;
    if (S_ISREG(st.st_mode)) {
      ok = names->len < WALK_FILES;
      if (ok) g_ptr_array_add(names, g_strconcat(prefix, e->d_name, NULL));
    } else if (S_ISDIR(st.st_mode) && depth > 0) {
      int child = openat(dirfd(dir), e->d_name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
      if (child < 0) continue;
      char *below = g_strconcat(prefix, e->d_name, "/", NULL);
      ok = walk(child, below, depth - 1, names);
      g_free(below);
    }
  }
  closedir(dir);
  return ok;
}

static bool open_folder(tc_dicom_sources *s, GError **error) {
  int fd = openat(s->root, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) return fail(error, TC_ERROR_IO, "the folder cannot be read");
  s->names = g_ptr_array_new_with_free_func(g_free);
  if (!walk(fd, "", WALK_DEPTH, s->names))
    return fail(error, TC_ERROR_LIMIT, "the folder holds more than 200000 files");
  g_ptr_array_sort(s->names, by_name);
  s->count = s->names->len;
  return true;
}

/* Unpacks a single compressed file, such as .dcm.gz, into memory; the process limit and the daemon bound its size. */
static bool unpack(tc_dicom_sources *s, GError **error) {
  tc_input input;
  tc_input_memory(&input, s->map, s->map_size, "");
  tc_decoder *decoder = input.packing == TC_ENCODING_RAW
                            ? NULL
                            : tc_decoder_new(&input, 0, input.packing, TC_ELEMENT_U8, 0, error);
  bool ok = input.packing == TC_ENCODING_RAW || decoder;
  size_t size = 0, room = 0, got = 1;
  char *bytes = NULL;
  while (decoder && ok && got > 0) {
    if (size == room) {
      room = 2 * room + (1 << 20);
      char *more = g_try_realloc(bytes, room);
      if (!more) ok = fail(error, TC_ERROR_LIMIT, "the packed file is too large to read");
      if (more) bytes = more;
    }
    ok = ok && tc_decoder_read(decoder, bytes + size, room - size, &got, error);
    if (ok) size += got;
  }
  if (ok && decoder && tc_decoder_cut(decoder)) ok = fail(error, TC_ERROR_FORMAT, "compressed data end before their check sum: fetch the file again");
  tc_decoder_free(decoder);
  tc_input_close(&input);
  if (!ok) g_free(bytes);
  if (!ok || !bytes) return ok;
  munmap(s->map, s->map_size);
  s->map = bytes;
  s->map_size = size;
  s->unpacked = true;
  return true;
}

bool tc_dicom_sources_open(tc_dicom_sources *s, int root, GError **error) {
  struct stat st;
  memset(s, 0, sizeof *s);
  s->root = root;
  if (fstat(root, &st) != 0) return fail(error, TC_ERROR_IO, "the input cannot be read");
  if (S_ISDIR(st.st_mode)) return open_folder(s, error);
  if (!S_ISREG(st.st_mode)) return fail(error, TC_ERROR_FORMAT, "neither a file nor a folder");
  if (st.st_size == 0) return fail(error, TC_ERROR_FORMAT, "the file is empty");
  s->map_size = (size_t)st.st_size;
  s->map = mmap(NULL, s->map_size, PROT_READ, MAP_PRIVATE, root, 0);
  if (s->map == MAP_FAILED) {
    s->map = NULL;
    return fail(error, TC_ERROR_LIMIT, "the file is too large to read");
  }
  s->count = 1;
  if (!unpack(s, error)) return false;
  if (s->map_size < 4 || memcmp(s->map, "PK", 2) != 0 || tc_dicom_looks(s->map, s->map_size)) return true;
  s->is_zip = true;
  if (!tc_dicom_zip_open(&s->zip, s->map, s->map_size, error)) return false;
  s->count = s->zip.count;
  return true;
}

void tc_dicom_sources_finish(tc_dicom_sources *s) {
  if (s->names) g_ptr_array_free(s->names, TRUE);
  tc_dicom_zip_finish(&s->zip);
  if (s->map && !s->unpacked) munmap(s->map, s->map_size);
  if (s->unpacked) g_free(s->map);
  memset(s, 0, sizeof *s);
}

static tc_dicom_source_kind kind_of(const uint8_t *head, size_t size) {
  if (tc_dicom_looks(head, size)) return TC_SOURCE_DICOM;
  return tc_picture_looks(head, size) ? TC_SOURCE_PICTURE : tc_hdf5_looks(head, size) ? TC_SOURCE_HDF5 : TC_SOURCE_OTHER;
}

static bool get_file(const tc_dicom_sources *s, const char *name, tc_dicom_source_kind kind, tc_dicom_blob *blob,
                     GError **error) {
  struct stat st;
  uint8_t head[TC_DICOM_HEAD_BYTES_NEEDED];
  int fd = openat(s->root, name, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0) return fail(error, TC_ERROR_IO, "a file of the folder cannot be opened");
  ssize_t n = pread(fd, head, sizeof head, 0);
  bool ok = n > 0 && kind_of(head, (size_t)n) == kind && fstat(fd, &st) == 0 && S_ISREG(st.st_mode);
  if (ok) {
    blob->size = (size_t)st.st_size;
    blob->map = mmap(NULL, blob->size, PROT_READ, MAP_PRIVATE, fd, 0);
    if (blob->map == MAP_FAILED) {
      blob->map = NULL;
      ok = fail(error, TC_ERROR_LIMIT, "a file of the folder is too large to read");
    }
    blob->bytes = blob->map;
  }
  close(fd);
  return ok;
}

static bool get_member(const tc_dicom_sources *s, size_t index, tc_dicom_source_kind kind, tc_dicom_blob *blob,
                       GError **error) {
  uint8_t head[TC_DICOM_HEAD_BYTES_NEEDED];
  size_t got;
  const tc_dicom_zip_member *m = &s->zip.members[index];
  if (!m->usable) return false;
  if (!tc_dicom_zip_read(&s->zip, index, head, sizeof head, &got, error)) return false;
  if (kind_of(head, got) != kind) return false;
  blob->heap = g_try_malloc(m->size ? m->size : 1);
  if (!blob->heap) return fail(error, TC_ERROR_LIMIT, "a member of the zip is too large to read");
  if (!tc_dicom_zip_read(&s->zip, index, blob->heap, m->size, &blob->size, error)) {
    tc_dicom_blob_finish(blob);
    return false;
  }
  blob->bytes = blob->heap;
  return true;
}

bool tc_dicom_sources_get_kind(const tc_dicom_sources *s, size_t index, tc_dicom_source_kind kind, tc_dicom_blob *blob,
                               GError **error) {
  memset(blob, 0, sizeof *blob);
  if (s->names) return get_file(s, g_ptr_array_index(s->names, index), kind, blob, error);
  if (s->is_zip) return get_member(s, index, kind, blob, error);
  if (kind_of(s->map, s->map_size) != kind) return false;
  blob->bytes = s->map;
  blob->size = s->map_size;
  return true;
}

bool tc_dicom_sources_get(const tc_dicom_sources *s, size_t index, tc_dicom_blob *blob, GError **error) {
  return tc_dicom_sources_get_kind(s, index, TC_SOURCE_DICOM, blob, error);
}

tc_dicom_source_kind tc_dicom_sources_kind(const tc_dicom_sources *s, size_t index) {
  uint8_t head[TC_DICOM_HEAD_BYTES_NEEDED];
  size_t size = 0;
  if (s->names) {
    const int fd = openat(s->root, g_ptr_array_index(s->names, index), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    const ssize_t n = fd >= 0 ? pread(fd, head, sizeof head, 0) : 0;
    size = (size_t)MAX(n, 0);
    if (fd >= 0) close(fd);
  } else if (!s->is_zip) {
    return kind_of(s->map, s->map_size);
  } else if (!s->zip.members[index].usable || !tc_dicom_zip_read(&s->zip, index, head, sizeof head, &size, NULL)) {
    return TC_SOURCE_OTHER;
  }
  return kind_of(head, size);
}

const char *tc_dicom_sources_name(const tc_dicom_sources *s, size_t index) {
  return s->names ? g_ptr_array_index(s->names, index) : s->is_zip ? tc_dicom_zip_name(&s->zip, index) : "";
}

void tc_dicom_blob_finish(tc_dicom_blob *blob) {
  if (blob->map) munmap(blob->map, blob->size);
  g_free(blob->heap);
  memset(blob, 0, sizeof *blob);
}
