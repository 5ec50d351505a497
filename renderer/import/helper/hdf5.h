/* Reads HDF5 through libhdf5 from an input. No path is opened, whatever the file names. */
#ifndef TC_IMPORT_HDF5_H
#define TC_IMPORT_HDF5_H

#include <hdf5.h>

#include "renderer/import/helper/source.h"

static inline void tc_hdf5_close(hid_t *id) {
  if (*id >= 0) H5Idec_ref(*id);
}

/* An identifier of the library, or a negative number; closed at the end of its scope. */
#define TC_HDF5_ID __attribute__((cleanup(tc_hdf5_close))) hid_t

/* Opens the file; closing the identifier closes all its objects. Negative with an error. The input must outlive it. */
hid_t tc_hdf5_open(const tc_input *input, GError **error);

/* Opens a data set of at most 32 dimensions, stored in the file itself in chunks of at most 256 MiB; negative if
 * there is none. *rank and `dims` receive its size. */
hid_t tc_hdf5_data(hid_t file, const char *path, int *rank, hsize_t dims[H5S_MAX_RANK]);

/* Size of the chunks along a dimension; 1 without chunks. */
hsize_t tc_hdf5_chunk(hid_t data, int dimension);

/* Reads n numbers of an attribute, converting their type; false unless it has exactly n. */
bool tc_hdf5_numbers(hid_t object, const char *name, double *to, size_t n);

/* Reads a fixed-length text attribute, cut to fit; "" if it is missing. */
void tc_hdf5_text(hid_t object, const char *name, char *to, size_t size);

#endif
