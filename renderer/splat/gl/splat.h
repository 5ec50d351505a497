/* Mode splat through OpenGL: as the cpu's splatter draws them (splat/splatter.h).
 *
 * Compute shaders put the cores' depths into a tile, then the weights and normals of what is not behind them, as sums of
 * whole numbers: neither the order of splats nor culling changes a bit. What lies at a footprint's rim, or between two
 * steps of the footprint's table, may round another way than on the cpu. Translucent sheets are sums of whole numbers, too. */
#ifndef TC_SPLAT_GL_SPLAT_H
#define TC_SPLAT_GL_SPLAT_H

#include "renderer/raycast/gl/passes.h"

extern const tc_gl_drawer tc_gl_splat_drawer;

#endif
