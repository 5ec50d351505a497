/* Writes volumes and meshes to files. The ending of the name chooses the format: .nrrd, .mha, .nii and .nii.gz for a
 * volume, which renderer/import reads back with the same values and geometry; .ply, .stl and .obj for a mesh, in LPS
 * mm, with the comment "SPACE=LPS" for readers. The file appears under its name only when it is complete and then
 * replaces an older one atomically; after a failure (TC_ERROR_IO) the older file stays. A device, a pipe or a symbolic
 * link is not replaced but written to, and then keeps what was written before a failure. Any thread. */
#ifndef TC_EXPORT_H
#define TC_EXPORT_H

#include "renderer/mesh/mesh.h"
#include "renderer/volume/volume.h"

typedef enum tc_export_kind { TC_EXPORT_UNKNOWN, TC_EXPORT_VOLUME, TC_EXPORT_MESH, TC_EXPORT_MODEL } tc_export_kind;

/* Kind of file that the name's ending means; models (.vmd) are encoded by splat/vmd.h. */
tc_export_kind tc_export_kind_of(const char *path);

/* NIfTI keeps voxels, slope and intercept. The other formats have no fields for these, so they get the rescaled
 * values in the smallest voxel type that holds all of them, else f32. gzip: compress (.nii.gz is always compressed). */
bool tc_export_volume(const tc_volume *volume, const char *path, bool gzip, GError **error);

/* Binary unless `ascii`; OBJ is always text. Coordinates are single precision in STL; in PLY and OBJ double where
 * single precision would lose a thousandth of a mm. PLY and OBJ keep colours ("v x y z r g b", 0 to 1); STL cannot. */
bool tc_export_mesh(const tc_mesh *mesh, const char *path, bool ascii, GError **error);
/* Largest displacement of a coordinate by the file's precision, mm. */
double tc_export_mesh_loss(const tc_mesh *mesh, const char *path);

/* Writes any other file, such as a picture or a report. */
bool tc_export_bytes(const void *bytes, size_t size, const char *path, GError **error);

#endif
