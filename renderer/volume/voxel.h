/* Reads single voxels of any type, for code that is not performance-critical. */
#ifndef TC_VOXEL_H
#define TC_VOXEL_H

#include "renderer/volume/volume.h"

/* voxels[i] as stored, exact. */
static inline double tc_voxel_at(tc_voxel_type type, const void *voxels, size_t i) {
  switch (type) {
  case TC_U8: return ((const uint8_t *)voxels)[i];
  case TC_I8: return ((const int8_t *)voxels)[i];
  case TC_U16: return ((const uint16_t *)voxels)[i];
  case TC_I16: return ((const int16_t *)voxels)[i];
  case TC_F32: return (double)((const float *)voxels)[i];
  case TC_VOXEL_TYPE_COUNT: break;
  }
  return 0;
}

#endif
