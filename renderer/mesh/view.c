#include "renderer/mesh/view.h"

#include <math.h>
#include <string.h>

#include "renderer/base/vector.h"

/* Inside is at least 0: along (right or down) * sign <= limit pixels from the axis, whose middle is `centre`. */
static void set_side(const tc_mesh_view *v, const double row[4], double sign, double limit, double plane[4]) {
  double wide = limit / v->scale;
  for (int k = 0; k < 4; k++) plane[k] = v->perspective ? wide * v->depth[k] - sign * row[k] : -sign * row[k];
  plane[3] += v->perspective ? wide * v->reference : wide;
  const double norm = length3(plane);
  for (int k = 0; k < 4; k++) plane[k] /= norm;
}

static void set_sides(tc_mesh_view *v) {
  for (int i = 0; i < 4; i++) {
    const double *row = i < 2 ? v->right : v->down, sign = i & 1 ? -1 : 1, middle = v->centre[i / 2];
    set_side(v, row, sign, middle + 1, v->sides[i]);
    set_side(v, row, sign, TC_VIEW_REACH + sign * (0 - middle), v->planes[TC_VIEW_GUARD + i]);
  }
}

void tc_mesh_view_set_up(tc_mesh_view *view, const tc_clusters *mesh, const tc_camera *camera, int width, int height) {
  double right[3], down[3], middle = 0;
  *view = (tc_mesh_view){.width = width, .height = height, .perspective = camera->projection == TC_PERSPECTIVE,
                    .centre = {0.5 * width, 0.5 * height}, .n_planes = TC_VIEW_CLIP};
  for (int k = 0; k < 3; k++) {
    view->forward[k] = camera->target[k] - camera->position[k];
    view->eye[k] = camera->position[k] - mesh->origin[k];
  }
  normalise3(view->forward);
  cross3(view->forward, camera->up, right);
  normalise3(right);
  cross3(view->forward, right, down);
  for (int k = 0; k < 3; k++) {
    view->right[k] = right[k], view->down[k] = down[k], view->depth[k] = view->forward[k];
    middle += view->forward[k] * (mesh->centre[k] - view->eye[k]);
  }
  view->right[3] = -dot3(right, view->eye);
  view->down[3] = -dot3(down, view->eye);
  /* Positive, so that nearness grows towards the eye wherever that is. */
  view->reference = view->perspective ? fmax(middle, fmax(0.25 * (double)mesh->radius, 1e-30)) : middle;
  view->depth[3] = -dot3(view->forward, view->eye) - view->reference;
  view->scale = view->perspective ? 0.5 * height / tan(camera->fov_y_deg * (M_PI / 360)) : height / camera->height_mm;
  set_sides(view);
  double *near = view->planes[TC_VIEW_NEAR];
  memcpy(near, view->depth, sizeof view->depth);
  near[3] += view->perspective ? view->reference * (1 - 0x1p-16) : view->reference;
}

void tc_mesh_view_clip(tc_mesh_view *view, const tc_clusters *mesh, const double (*clip)[4], int n_clip) {
  for (int i = 0; i < n_clip; i++) {
    double norm = length3(clip[i]), *plane = view->planes[view->n_planes++];
    for (int k = 0; k < 3; k++) plane[k] = clip[i][k] / norm;
    plane[3] = (clip[i][3] + dot3(clip[i], mesh->origin)) / norm;
  }
}

bool tc_mesh_view_is_outside(const tc_mesh_view *view, const tc_clusters *mesh) {
  double to[3];
  for (int k = 0; k < 3; k++) to[k] = mesh->centre[k] - view->eye[k];
  return (view->perspective ? length3(to) : dot3(to, view->forward)) > mesh->radius;
}
