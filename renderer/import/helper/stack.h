/* Stacks of pictures: a TIFF of several pages, or a folder or zip of PNG and TIFF files, one slice per picture in the
 * natural order of their names (numbers compare as numbers). */
#ifndef TC_IMPORT_STACK_H
#define TC_IMPORT_STACK_H

#include "renderer/import/helper/dicom_sources.h"
#include "renderer/import/helper/order.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Whether the sources are pictures and none is DICOM. */
bool tc_stack_is(const tc_dicom_sources *sources);

/* Reads the pictures as a volume. `choice`: "", or "spacing=X,Y,Z" in mm, "volume=N", or both with a '#' between. */
bool tc_stack_read(const tc_dicom_sources *sources, const char *choice, const tc_order *order, GError **error);

#ifdef __cplusplus
}
#endif
#endif
