/* Mode mesh through OpenGL: triangles into a visibility buffer, whose pixels a compute shader colours once each, as the
 * cpu's rasteriser does (mesh/raster.h).
 *
 * A tile is drawn once for each sample of a pixel, moved by the sample's place: samples lie exactly where the cpu has them.
 * Clusters outside the tile or facing away are not drawn. Translucent surfaces are peeled, layer by layer until there is
 * none, and added up nearest first. Slices sample the volume's texture. Pictures differ from the cpu's where rounding
 * decides: which of two triangles a sample on their edge belongs to, and which of two that lie at one depth is nearer. */
#ifndef TC_MESH_GL_MESH_H
#define TC_MESH_GL_MESH_H

#include "renderer/raycast/gl/passes.h"

extern const tc_gl_drawer tc_gl_mesh_drawer;

/* Bytes that a part of a mesh may have in a buffer, where the driver allows more; 0: what it allows. Tests set less. */
extern int64_t tc_gl_mesh_most_bytes;

/* Translucent layers are drawn by OpenGL in software too, where the cpu is far faster. Tests set it. */
extern bool tc_gl_mesh_peels_in_software;

#endif
