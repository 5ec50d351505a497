/* Opening volumes: one entry for every format.
 *
 * PATH is a file (.nii, .hdr and .img of NIfTI and Analyze, .nrrd, .nhdr, .mha, .mhd, .mgh, .PAR with .REC, .dcm, each also with .gz or
 * .bz2; .mgz, .mnc of MINC 2, .vmd, .zip, .png, .tif), a folder of DICOM, its DICOMDIR, a folder of PNG or TIFF, or demo:NAME.
 * The kind is found by content first, by name second. A folder or zip with several DICOM series takes
 * a suffix "#N" (1-based, as listed) or "#UID" to choose; without one the series with most slices is
 * taken, ties by the first listed, and the others are named in desc.note. "#volume=N" after that chooses a volume of
 * the series (time points, echoes, acquisitions that lie among each other ...; see dicom_group.h); without it the one
 * with most slices is taken, if it has at least half of them. Pictures without a spacing take "#spacing=X,Y,Z" (mm).
 *
 * Storage rule. u8, i8, u16, i16, f32 stay as they are. 32/64-bit integers become i16/u16 (or i8/u8) when every
 * voxel fits, else f32 (rounded to nearest). f64 becomes f32. RGB/RGBA becomes Rec. 709 luma in u8, complex and
 * vectors their magnitude in f32. Of a 4-D file the first frame is taken, or the one that "#volume=N" names;
 * desc.frames tells how many there were.
 * Every conversion is said in desc.note.
 * Every format is decoded by a confined helper process (helper.h). Parsers read through one bounded reader; sizes
 * multiply with overflow checks; nothing larger than the file can justify is allocated; a failure is one clear error. */
#ifndef TC_RENDERER_IMPORT_H
#define TC_RENDERER_IMPORT_H

#include "renderer/volume/provenance.h"

/* Progress callback with 0..1; returning false cancels the import (TC_ERROR_CANCELLED). */
typedef bool (*tc_progress_fn)(void *user, double fraction);

/* Memory callback: called once the header is read, before any voxel is decoded, with the memory in bytes that the import needs in
 * all, and again whenever this number changes. Returning false, with an error, ends the import. */
typedef bool (*tc_reserve_fn)(void *user, uint64_t bytes, GError **error);

typedef struct tc_import_options {
  tc_progress_fn progress; /* NULL: none; called at least every few MiB read or decoded */
  tc_reserve_fn reserve;   /* NULL: none */
  tc_reserve_fn decoder;   /* NULL: none; called several times a second with the memory of the helper program */
  void *user;              /* passed to all three callbacks */
  const char *helpers;       /* folder of the helper programs; NULL: the running program's folder, then PATH */
  uint64_t max_voxel_bytes;  /* larger volumes are refused (TC_ERROR_LIMIT); 0 = no limit */
  uint32_t volume;           /* number of the volume in a file of several (not DICOM), from 1; 0: as the path says, else 1 */
  bool bridge_nothing;       /* refuse a series with a missing slice (TC_ERROR_FORMAT) */
  bool patient;              /* a list of series includes patient and date; otherwise nothing identifying */
  bool self_contained;       /* the file may name no other file for its voxels (TC_ERROR_FORMAT) */
} tc_import_options;

/* Loads PATH. Caller owns the reference. options may be NULL. Any thread. */
tc_volume *tc_import(const char *path, const tc_import_options *options, GError **error);

typedef struct tc_mesh tc_mesh; /* mesh/mesh.h */

/* Facts about a mesh file. */
typedef struct tc_mesh_file {
  char format[16];     /* "obj", "ply" or "stl" */
  uint64_t degenerate; /* triangles left out because two corners coincide */
} tc_mesh_file;

/* Whether a path ends like a mesh file. The content decides the format. */
bool tc_import_names_mesh(const char *path);

/* Loads the mesh PATH: .obj, .ply or .stl (each also with .gz or .bz2), recognised by content first, in mm, LPS unless a
 * comment says "SPACE=RAS". Polygons, concave ones too, become triangles; corners of an STL in one place become one
 * vertex; normals are the file's, or none. Coordinates beyond 8192 mm keep their precision through the mesh's origin. options->max_voxel_bytes limits
 * the mesh's bytes. `source` may be NULL. */
tc_mesh *tc_import_mesh(const char *path, const tc_import_options *options, tc_mesh_file *source, GError **error);

/* One volume of a DICOM series found under a path (tc_import_list). Strings are non-identifying. */
typedef struct tc_series {
  /* label: series number and, where present, protocol-free description-free text such as "series 3" */
  char uid[72], modality[16], label[64];
  int number;                       /* number of the series, as in "#N" */
  int files, frames, rows, columns; /* of the whole series; rows and columns of its first picture */
  int volume, slices;               /* which volume of the series, from 1, and its slices */
  char what[48];                    /* difference from the other volumes of the series, such as "echo time 90 ms", or "" */
  char description[64];             /* series description, UTF-8, or "" */
  char time[32];                    /* time of day, "14:03:22"; with options.patient "2026-01-31 14:03:22"; or "" */
  char patient[128];                /* name and number, with options.patient only; else "" */
} tc_series;

/* Lists the volumes of all DICOM series of a folder, file or zip; *series is g_malloc'ed, caller frees with g_free(). Other formats give
 * 0. */
bool tc_import_list(const char *path, const tc_import_options *options, tc_series **series, size_t *count,
                    GError **error);

/* Opens what `name` in the folder leads to, where that lies in one of the link roots (links.h); else -1. `name` has no "..". */
int tc_links_open(int folder_fd, const char *name, int flags);

#endif
