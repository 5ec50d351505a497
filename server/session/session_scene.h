/* Checks of a scene that need more than the parser has: limits, the renderer, other volumes. I/O thread only. */
#ifndef TCS_SESSION_SESSION_SCENE_H
#define TCS_SESSION_SESSION_SCENE_H

#include "protocol/protocol.h"
#include "renderer/tomocast.h"
#include "server/catalogue/catalogue.h"
#include "server/config/config.h"

/* Whether the scene's text is so long (10 KiB and more) that a worker should write it. */
static inline bool tcs_scene_is_long(const tc_scene *scene) {
  return scene->transfer_function.count + scene->labels.n_colors + scene->labels.n_visible > 500;
}

/* References to the resident meshes of the scene's surfaces, as an array for tcs_job. NULL: none. */
tc_mesh **tcs_scene_meshes(tcs_server *server, const tc_scene *scene);

/* Checks a picture's size against the configured limits. image: JSON pointer to the object with width and height (""
 * for the document itself). */
bool tcs_image_check(const tcs_limits *limits, const char *image, int64_t width, int64_t height, GError **error);
/* The origin of a scene. valid: as in tc_plan_check(); patch: the patch that produced the scene. Either may be NULL. */
typedef struct tcs_scene_change {
  const tc_scene *valid;
  const cJSON *patch;
} tcs_scene_change;

/* Checks a scene against the limits and the renderer's abilities. *labels: its label volume, owned by the catalogue, or
 * NULL. A label volume named by the patch must look like labels (labels_check.h) unless labels.force is set. */
bool tcs_scene_check(tcs_server *server, const tc_volume *volume, const tc_scene *scene, tcs_scene_change change,
                     tc_volume **labels, GError **error);
/* Makes a scene from the defaults of a resident volume and `patch` (may be NULL). *scene is uninitialised before, and
 * after a failure. lists: those of the patch, or NULL. */
bool tcs_scene_make(tcs_server *server, const tcs_entry *entry, const cJSON *patch, const tcp_lists *lists,
                    tc_scene *scene, GError **error);
/* Sets the window that suits the mode of a document. Call before the document is applied to the scene. */
void tcs_scene_fit_window(tc_scene *scene, const tc_fit *fit, const cJSON *document);
/* Applies a merge patch to a scene of the volume, without checks. */
bool tcs_scene_patch(tc_scene *scene, const tc_scene *defaults, const tcs_entry *entry, const cJSON *patch,
                     const tcp_lists *lists, GError **error);

#endif
