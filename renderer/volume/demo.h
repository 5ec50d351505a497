/* Interruptible generation of demo volumes; volume.h declares the other functions. */
#ifndef TC_RENDERER_DEMO_H
#define TC_RENDERER_DEMO_H

#include "renderer/volume/volume.h"

/* tc_volume_demo() with progress: calls goes_on (NULL: none) on the calling thread with the finished fraction, and
 * fails with TC_ERROR_CANCELLED when it returns false. */
tc_volume *tc_volume_demo_while(const char *name, bool (*goes_on)(void *user, double fraction), void *user,
                                GError **error);

#endif
