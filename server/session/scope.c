#include "server/session/scope.h"

#include <string.h>

static bool brings_volume(const tcs_session *session, const cJSON *patch) {
  const cJSON *labels = cJSON_GetObjectItemCaseSensitive(patch, "labels");
  const char *id = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(labels, "volume"));
  return id && *id && strcmp(id, session->scene.labels.volume) != 0 && strcmp(id, session->entry->id) != 0;
}

const char *tcs_patch_forbidden(const tcs_caller *caller, const tcs_session *session, const cJSON *patch) {
  if (caller->role < TCS_ROLE_EDIT) return "changing the scene needs the role edit; yours is view";
  if (caller->session[0] && brings_volume(session, patch))
    return "labels.volume: a share link cannot bring another volume into its session";
  return NULL;
}

const char *tcs_show_forbidden(const tcs_caller *caller, const tcs_session *session, const tcs_entry *entry) {
  const bool related = entry && (entry == session->entry || (entry->series && entry->series == session->entry->series));
  if (caller->session[0] && !related) return "volume: a share link cannot bring a volume of another file into its session";
  return NULL;
}
