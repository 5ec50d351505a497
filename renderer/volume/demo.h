/* Demo volumes for who may have to give them up; volume.h has the rest of them. */
#ifndef TC_RENDERER_DEMO_H
#define TC_RENDERER_DEMO_H

#include "renderer/volume/volume.h"

/* tc_volume_demo(), telling how far it is and asking whether to go on: TC_ERROR_CANCELLED as soon as `goes_on` (NULL:
 * nobody is asked) says no. */
tc_volume *tc_volume_demo_while(const char *name, bool (*goes_on)(void *user, double fraction), void *user,
                                GError **error);

#endif
