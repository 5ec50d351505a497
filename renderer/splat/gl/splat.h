/* Mode splat in OpenGL compute shaders: the algorithm of the CPU's splatter (splat/splatter.h).
 *
 * One pass draws the cores' depths into a tile, another adds up weights and normals of the splats that are not occluded. Sums are
 * integers, also those of translucent sheets, so that neither the order of splats nor culling changes a bit. At the edge of a
 * footprint, or between two entries of the footprint table, rounding may differ from the CPU's. */
#ifndef TC_SPLAT_GL_SPLAT_H
#define TC_SPLAT_GL_SPLAT_H

#include "renderer/raycast/gl/passes.h"

extern const tc_gl_drawer tc_gl_splat_drawer;

#endif
