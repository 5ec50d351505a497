/* Closed contours in parallel planes (DICOM structure sets) to labels on a grid.
 *
 * A voxel belongs to a region where its centre is inside an odd number of the region's contours in its plane: a contour
 * within another is a hole. Layers take the region's nearest plane: those between two planes that are at most twice the
 * region's least distance of planes apart, and half that distance beyond its first and last ones. */
#ifndef TC_IMPORT_DICOM_CONTOURS_H
#define TC_IMPORT_DICOM_CONTOURS_H

#include "renderer/import/helper/overlaps.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct tc_dicom_contour {
  uint32_t label;
  size_t first, count; /* of its corners: x, y, z each */
  double layer;        /* once placed: the z index of its plane */
} tc_dicom_contour;

typedef struct tc_dicom_contours {
  tc_dicom_contour *list; /* [count]; once placed: by label, then layer */
  size_t count;
  double *corners; /* LPS mm; once placed: index coordinates */
  size_t outside;  /* once placed: contours off the grid's layers */
} tc_dicom_contours;

/* Fills dims, spacing, origin and direction with a grid of the contours' own planes. TC_ERROR_FORMAT where they have
 * none in common. */
bool tc_dicom_contours_grid(const tc_dicom_contours *contours, tc_volume_desc *desc, GError **error);

/* Puts the contours on a grid. TC_ERROR_FORMAT for one that is not parallel to the layers. */
bool tc_dicom_contours_place(tc_dicom_contours *contours, const tc_volume_desc *desc, GError **error);

/* The labels [dims[1]][dims[0]] of a layer. */
void tc_dicom_contours_fill(const tc_dicom_contours *contours, const tc_volume_desc *desc, int layer, tc_overlaps *overlaps,
                            uint16_t *labels);

#ifdef __cplusplus
}
#endif
#endif
