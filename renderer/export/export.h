/* Volumes and meshes to files. The ending of the name chooses the format:
 *   .nrrd, .mha, .nii, .nii.gz      a volume, read back by renderer/import with the same values and place
 *   .ply, .stl, .obj                a mesh, in LPS mm, said so where readers look for that ("SPACE=LPS")
 * A file appears under its name once it is complete: what was there before is replaced at once, or kept after a failure
 * (TC_ERROR_IO). Any thread. */
#ifndef TC_EXPORT_H
#define TC_EXPORT_H

#include "renderer/mesh/mesh.h"
#include "renderer/volume/volume.h"

typedef enum tc_export_kind { TC_EXPORT_UNKNOWN, TC_EXPORT_VOLUME, TC_EXPORT_MESH, TC_EXPORT_MODEL } tc_export_kind;

/* Which of these a name's ending means; a model (.vmd) is written by splat/vmd.h. */
tc_export_kind tc_export_kind_of(const char *path);

/* Values as they are: NIfTI keeps voxels, slope and intercept; the others, which have no place for these, get the
 * values themselves in the smallest of the voxel types that holds them all, else f32. gzip: compressed (.nii.gz always
 * is). */
bool tc_export_volume(const tc_volume *volume, const char *path, bool gzip, GError **error);

/* Binary unless `ascii`; OBJ is text. Coordinates are single precision in STL; in PLY and OBJ double where single would
 * lose a thousandth of a mm. Colours go with PLY and OBJ ("v x y z r g b", 0 to 1); STL has no place for them. */
bool tc_export_mesh(const tc_mesh *mesh, const char *path, bool ascii, GError **error);
/* How far that moves a coordinate at most, mm. */
double tc_export_mesh_loss(const tc_mesh *mesh, const char *path);

#endif
