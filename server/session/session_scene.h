/* Checks of a scene that the parser cannot make: limits, the renderer, other volumes. I/O thread only. */
#ifndef TCS_SESSION_SESSION_SCENE_H
#define TCS_SESSION_SESSION_SCENE_H

#include "protocol/protocol.h"
#include "renderer/tomocast.h"
#include "server/catalogue/catalogue.h"
#include "server/config/config.h"

/* Whether the scene's text is so long (10 KiB and more) that a worker writes it. */
static inline bool tcs_scene_is_long(const tc_scene *scene) {
  return scene->transfer_function.count + scene->labels.n_colors + scene->labels.n_visible > 500;
}

/* The meshes of its surfaces, as tcs_job has them: references to what is resident. NULL: it has none. */
tc_mesh **tcs_scene_meshes(tcs_server *server, const tc_scene *scene);

/* A picture's size against the configured limits. image: JSON pointer of what holds width and height ("" for the
 * document itself). */
bool tcs_image_check(const tcs_limits *limits, const char *image, int64_t width, int64_t height, GError **error);
/* How a scene came about. valid: as in tc_plan_check(); patch: what made the scene of it. Either may be NULL. */
typedef struct tcs_scene_change {
  const tc_scene *valid;
  const cJSON *patch;
} tcs_scene_change;

/* Checks a scene against the limits and what the renderer can do, and finds its label volume (NULL when it has none;
 * the catalogue's). a label volume named by the change's
 * patch must look like labels (labels_check.h), unless labels.force is set. */
bool tcs_scene_check(tcs_server *server, const tc_volume *volume, const tc_scene *scene, tcs_scene_change change,
                     tc_volume **labels, GError **error);
/* The defaults for a resident volume, with `patch` (may be NULL) on top. *scene holds nothing before, nor after a
 * failure. lists: the patch's, or NULL. */
bool tcs_scene_make(tcs_server *server, const tcs_entry *entry, const cJSON *patch, const tcp_lists *lists,
                    tc_scene *scene, GError **error);
/* The window that fits the mode a document asks for: before the document is laid on the scene. */
void tcs_scene_fit_window(tc_scene *scene, const tc_fit *fit, const cJSON *document);
/* A merge patch onto a scene of the volume; not checked. */
bool tcs_scene_patch(tc_scene *scene, const tc_scene *defaults, const tcs_entry *entry, const cJSON *patch,
                     const tcp_lists *lists, GError **error);

#endif
