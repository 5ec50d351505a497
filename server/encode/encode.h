/* Frames to image bytes: JPEG by TurboJPEG, PNG by libspng.
 *
 * An encoder holds one codec handle and one scratch buffer: one per worker thread, used by one thread at a time. */
#ifndef TC_SERVER_ENCODE_H
#define TC_SERVER_ENCODE_H

#include <glib.h>
#include <stdbool.h>

#include "renderer/scene/scene.h"
#include "renderer/tomocast.h"

typedef struct tcs_encoder tcs_encoder;

/* Removes the TJ_* environment variables, which would silently change TurboJPEG's output. Call once at the start of the
 * program, before any thread. */
void tcs_encode_prepare_process(void);

/* TC_ERROR_MEMORY or TC_ERROR_INTERNAL on failure. Free with tcs_encoder_free(). */
tcs_encoder *tcs_encoder_new(GError **error);
void tcs_encoder_free(tcs_encoder *encoder); /* NULL is fine */

/* Encodes `frame` (its rgba) in scene->image.format into *out, replacing its content. quality_override 1..100 replaces
 * scene->image.quality for JPEG; 0 or less keeps the scene's. Writes a grey-scale JPEG when the mode is mip, minip,
 * average or mpr and every pixel is grey. A PNG is RGB, or RGBA with straight alpha when the background is transparent.
 * A transparent background with JPEG is TC_ERROR_INVALID. On failure *out is empty. */
bool tcs_encode(tcs_encoder *encoder, const tc_frame *frame, const tc_scene *scene, int quality_override,
                GByteArray *out, GError **error);

/* "image/jpeg" or "image/png"; static. */
const char *tcs_encode_content_type(tc_image_format format);
/* "jpeg" or "png"; static. */
const char *tcs_encode_format_name(tc_image_format format);

#endif
