#include "server/session/watcher.h"

bool tcs_watcher_wants(const tcs_watcher *watcher, uint64_t revision, bool final) {
  if (watcher->resized) return revision >= watcher->shown_revision;
  if (revision != watcher->shown_revision) return revision > watcher->shown_revision;
  return final && !watcher->shown_final;
}

bool tcs_watcher_wants_error(const tcs_watcher *watcher, const tcs_picture *picture) {
  return watcher->ops->headers && tcs_picture_is_judged(picture) && watcher->shown_revision == picture->revision &&
         !watcher->shown_error;
}

uint64_t tcs_watcher_seq_in(const tcs_watcher *watcher, const tcs_picture *picture, uint64_t current_revision) {
  if (picture->revision == current_revision) return watcher->seq; /* the picture has every patch so far */
  for (guint i = 0; picture->marks && i < picture->marks->len; i++) {
    const tcs_mark *mark = &g_array_index(picture->marks, tcs_mark, i);
    if (mark->watcher == watcher->id) return mark->seq;
  }
  return 0; /* the viewer joined after the picture was begun */
}
