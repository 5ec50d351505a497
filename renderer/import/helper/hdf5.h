/* HDF5 read through libhdf5 from an input: no path is opened, whatever a file names. */
#ifndef TC_IMPORT_HDF5_H
#define TC_IMPORT_HDF5_H

#include <hdf5.h>

#include "renderer/import/helper/source.h"

static inline void tc_hdf5_close(hid_t *id) {
  if (*id >= 0) H5Idec_ref(*id);
}

/* Any identifier of the library, or a negative number, given back where its scope ends. */
#define TC_HDF5_ID __attribute__((cleanup(tc_hdf5_close))) hid_t

/* The file, whose closing closes all that is open of it; negative with an error. The input outlives it. */
hid_t tc_hdf5_open(const tc_input *input, GError **error);

/* A data set of at most 32 dimensions whose bytes are in the file itself, in chunks of at most 256 MiB; negative where
 * there is none. *rank and `dims` say its size. */
hid_t tc_hdf5_data(hid_t file, const char *path, int *rank, hsize_t dims[H5S_MAX_RANK]);

/* Extent of its chunks along a dimension; 1 where it has none. */
hsize_t tc_hdf5_chunk(hid_t data, int dimension);

/* n numbers of an attribute, whatever type they have; false where it has not exactly n. */
bool tc_hdf5_numbers(hid_t object, const char *name, double *to, size_t n);

/* A text of fixed length, cut to fit; "" without one. */
void tc_hdf5_text(hid_t object, const char *name, char *to, size_t size);

#endif
