/* A zip of one volume of any format but DICOM, including the files that its header names, such as a REC next to a
 * PAR. */
#ifndef TC_IMPORT_ZIPPED_H
#define TC_IMPORT_ZIPPED_H

#include "renderer/import/helper/dicom_sources.h"
#include "renderer/import/helper/order.h"

#ifdef __cplusplus
extern "C" {
#endif

bool tc_zipped_is(const tc_dicom_sources *sources);
/* `choice`: the text after the '#' of the path, or "". */
bool tc_zipped_read(const tc_dicom_sources *sources, const char *choice, const tc_order *order, GError **error);

#ifdef __cplusplus
}
#endif
#endif
