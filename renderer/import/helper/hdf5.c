#include "renderer/import/helper/hdf5.h"

#include <string.h>

enum { MOST_CHUNK_BYTES = 256 << 20 };

/* ---- the input as a file of the library ---- */

typedef struct input_file {
  H5FD_t base;
  const tc_input *input;
  haddr_t end; /* end of the bytes that the library considers in use */
} input_file;

/* This driver also serves files that the file links to and opens the same input for them, so no other file can be
 * reached. */
static H5FD_t *open_input(const char *name, unsigned flags, hid_t fapl, haddr_t most) {
  const tc_input *const *given = H5Pget_driver_info(fapl);
  if (!given || flags & (H5F_ACC_RDWR | H5F_ACC_CREAT | H5F_ACC_TRUNC)) return NULL;
  input_file *file = g_new0(input_file, 1);
  file->input = *given;
  return &file->base;
}

static herr_t close_input(H5FD_t *file) {
  g_free(file);
  return 0;
}

static int compare(const H5FD_t *a, const H5FD_t *b) {
  const tc_input *x = ((const input_file *)a)->input, *y = ((const input_file *)b)->input;
  return x < y ? -1 : x > y;
}

static herr_t query(const H5FD_t *file, unsigned long *flags) {
  *flags = H5FD_FEAT_DATA_SIEVE | H5FD_FEAT_ACCUMULATE_METADATA_READ;
  return 0;
}

static haddr_t get_end(const H5FD_t *file, H5FD_mem_t type) { return ((const input_file *)file)->end; }

static herr_t set_end(H5FD_t *file, H5FD_mem_t type, haddr_t at) {
  ((input_file *)file)->end = at;
  return 0;
}

static haddr_t get_size(const H5FD_t *file, H5FD_mem_t type) { return ((const input_file *)file)->input->size; }

static herr_t read_input(H5FD_t *file, H5FD_mem_t type, hid_t plist, haddr_t at, size_t n, void *to) {
  return tc_input_read(((input_file *)file)->input, at, to, n, NULL) ? 0 : -1;
}

static herr_t write_nothing(H5FD_t *file, H5FD_mem_t type, hid_t plist, haddr_t at, size_t n, const void *from) {
  return -1;
}

static const H5FD_class_t driver = {.name = "input",
                                    .maxaddr = INT64_MAX,
                                    .fc_degree = H5F_CLOSE_STRONG,
                                    .fapl_size = sizeof(tc_input *),
                                    .open = open_input,
                                    .close = close_input,
                                    .cmp = compare,
                                    .query = query,
                                    .get_eoa = get_end,
                                    .set_eoa = set_end,
                                    .get_eof = get_size,
                                    .read = read_input,
                                    .write = write_nothing,
                                    .fl_map = H5FD_FLMAP_DICHOTOMY};

hid_t tc_hdf5_open(const tc_input *input, GError **error) {
  static hid_t registered = -1;
  if (registered < 0 && H5open() >= 0) {
    H5Eset_auto2(H5E_DEFAULT, NULL, NULL);
    H5PLset_loading_state(0); /* disables filter plug-ins */
    registered = H5FDregister(&driver);
  }
  TC_HDF5_ID access = H5Pcreate(H5P_FILE_ACCESS);
  hid_t file = -1;
  if (H5Pset_driver(access, registered, &input) >= 0 && H5Pset_fclose_degree(access, H5F_CLOSE_STRONG) >= 0)
    file = H5Fopen("input", H5F_ACC_RDONLY, access);
  if (file < 0) tc_set_error(error, TC_ERROR_FORMAT, NULL, "HDF5: the file is damaged or cut short");
  return file;
}

/* ---- what is in it ---- */

static bool lies_in_file(hid_t data) {
  TC_HDF5_ID list = H5Dget_create_plist(data);
  TC_HDF5_ID type = H5Dget_type(data);
  hsize_t chunk[H5S_MAX_RANK];
  const H5D_layout_t layout = H5Pget_layout(list);
  if (layout == H5D_VIRTUAL || H5Pget_external_count(list) != 0) return false;
  if (layout != H5D_CHUNKED) return true;
  const int rank = H5Pget_chunk(list, H5S_MAX_RANK, chunk);
  uint64_t bytes = H5Tget_size(type);
  for (int k = 0; k < rank; k++)
    if (__builtin_mul_overflow(bytes, chunk[k], &bytes)) return false;
  return rank > 0 && bytes <= MOST_CHUNK_BYTES;
}

hid_t tc_hdf5_data(hid_t file, const char *path, int *rank, hsize_t dims[H5S_MAX_RANK]) {
  hid_t data = H5Dopen2(file, path, H5P_DEFAULT);
  if (data < 0) return -1;
  if (lies_in_file(data)) {
    TC_HDF5_ID space = H5Dget_space(data);
    *rank = H5Sget_simple_extent_dims(space, dims, NULL);
    if (*rank >= 0) return data;
  }
  H5Dclose(data);
  return -1;
}

hsize_t tc_hdf5_chunk(hid_t data, int dimension) {
  TC_HDF5_ID list = H5Dget_create_plist(data);
  hsize_t chunk[H5S_MAX_RANK];
  if (H5Pget_layout(list) != H5D_CHUNKED) return 1;
  return H5Pget_chunk(list, H5S_MAX_RANK, chunk) > dimension ? chunk[dimension] : 1;
}

bool tc_hdf5_numbers(hid_t object, const char *name, double *to, size_t n) {
  if (H5Aexists(object, name) <= 0) return false;
  TC_HDF5_ID attribute = H5Aopen(object, name, H5P_DEFAULT);
  TC_HDF5_ID space = H5Aget_space(attribute);
  return H5Sget_simple_extent_npoints(space) == (hssize_t)n && H5Aread(attribute, H5T_NATIVE_DOUBLE, to) >= 0;
}

void tc_hdf5_text(hid_t object, const char *name, char *to, size_t size) {
  *to = 0;
  if (H5Aexists(object, name) <= 0) return;
  TC_HDF5_ID attribute = H5Aopen(object, name, H5P_DEFAULT);
  TC_HDF5_ID space = H5Aget_space(attribute);
  TC_HDF5_ID type = H5Aget_type(attribute);
  TC_HDF5_ID wanted = H5Tcopy(H5T_C_S1);
  if (H5Tget_class(type) != H5T_STRING || H5Tis_variable_str(type) != 0 || H5Sget_simple_extent_npoints(space) != 1)
    return;
  if (H5Tset_size(wanted, size) < 0 || H5Aread(attribute, wanted, to) < 0) *to = 0;
  to[size - 1] = 0;
}
