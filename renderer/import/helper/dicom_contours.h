/* Rasterises closed contours in parallel planes (DICOM structure sets) into labels on a grid. A voxel belongs to a
 * region if its centre is inside an odd number of the region's contours in its plane, so a contour within another is
 * a hole. Each layer takes the region's nearest plane: between two planes that are at most twice the region's least
 * plane distance apart, and up to half that distance beyond its first and last plane. */
#ifndef TC_IMPORT_DICOM_CONTOURS_H
#define TC_IMPORT_DICOM_CONTOURS_H

#include "renderer/import/helper/overlaps.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct tc_dicom_contour {
  uint32_t label;
  size_t first, count; /* index and number of its corners, x, y, z each */
  double layer;        /* after placing: the z index of its plane */
} tc_dicom_contour;

typedef struct tc_dicom_contours {
  tc_dicom_contour *list; /* [count]; after placing: sorted by label, then layer */
  size_t count;
  double *corners; /* LPS mm; after placing: index coordinates */
  size_t outside;  /* after placing: number of contours outside the grid's layers */
} tc_dicom_contours;

/* Fills dims, spacing, origin and direction with a grid made from the contours' planes. TC_ERROR_FORMAT if the planes
 * are not parallel. */
bool tc_dicom_contours_grid(const tc_dicom_contours *contours, tc_volume_desc *desc, GError **error);

/* Converts the contours to index coordinates of a grid. TC_ERROR_FORMAT if a contour is not parallel to the layers. */
bool tc_dicom_contours_place(tc_dicom_contours *contours, const tc_volume_desc *desc, GError **error);

/* Writes the labels of a layer, [dims[1]][dims[0]]. */
void tc_dicom_contours_fill(const tc_dicom_contours *contours, const tc_volume_desc *desc, int layer, tc_overlaps *overlaps,
                            uint16_t *labels);

#ifdef __cplusplus
}
#endif
#endif
