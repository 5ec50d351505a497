/* Splats cut open by planes: faces are solid and lie on their planes, and end where the surface or another plane does. */
#include "tests/support/splats.h"

#include "renderer/base/vector.h"

/* A ball cut through the middle shows a flat solid face, on the plane. */
TEST(a_cut_shows_a_solid_face) {
  g_auto(object) o = object_of(&cube, blob, ball);
  g_auto(drawing) d = {0};
  tc_scene scene;
  for (int i = 0; i < 2; i++) {
    look(&scene, &o, 6 + i, 1); /* from no axis */
    double *p = scene.clip.planes[0], side[3], away = 0;
    direction(6 + i, side);
    for (int k = 0; k < 3; k++) p[k] = -side[k], p[3] += side[k] * scene.camera.target[k];
    scene.clip.n_planes = 1;
    draw_now(&o, &scene, (wish){0}, &d);
    for (int k = 0; k < 3; k++) away += (scene.camera.position[k] - scene.camera.target[k]) * side[k];
    for (int y = 36; y < 60; y++)
      for (int x = 36; x < 60; x++) {
        assert_true(d.frame.linear[4 * (y * SIDE + x) + 3] == 1);
        assert_true(fabs((double)d.frame.depth[y * SIDE + x] - away) < 2.5);
      }
    tc_scene_clear(&scene);
  }
}

/* Keeps what lies on the normal's side of the plane that passes the camera's target at `mm` along it. */
static void cut_along(tc_scene *scene, const double normal[3], double mm) {
  double *p = scene->clip.planes[0];
  memcpy(p, normal, 3 * sizeof *p);
  normalise3(p);
  p[3] = -dot3(p, scene->camera.target) - mm;
  scene->clip.n_planes = 1;
}

/* Unit vector of a pixel's ray in perspective. */
static void ray_of(const tc_rays *rays, int x, int y, double way[3]) {
  for (int k = 0; k < 3; k++) way[k] = rays->view0[k] + (x + 0.5) * rays->view_du[k] + (y + 0.5) * rays->view_dv[k];
  normalise3(way);
}

/* From the camera to its target. */
static void ahead_of(const tc_scene *scene, double ahead[3]) {
  for (int k = 0; k < 3; k++) ahead[k] = scene->camera.target[k] - scene->camera.position[k];
}

/* Across the view, along no axis, and different for each i. */
static void across_of(const double ahead[3], int i, double across[3]) {
  const double some[3] = {0.3 + 0.2 * i, -0.5, 0.7};
  for (int k = 0; k < 3; k++) across[k] = some[(k + 1) % 3] * ahead[(k + 2) % 3] - some[(k + 2) % 3] * ahead[(k + 1) % 3];
}

/* The walls of what is cut away, seen from behind, hide none of the face. */
TEST(nothing_stands_before_a_cut) {
  g_auto(object) o = object_of(&cube, blob, ball);
  g_auto(drawing) d = {0};
  for (int i = 0; i < 4; i++) {
    g_auto(tc_scene) scene;
    look(&scene, &o, 7 + 2 * i, 1.5);
    double ahead[3], way[3], nearer = 0;
    ahead_of(&scene, ahead);
    const double mm = length3(ahead) + 6; /* to the face, six voxels behind the middle: there the ball's walls face away */
    cut_along(&scene, ahead, 6);
    draw_now(&o, &scene, (wish){0}, &d);
    tc_rays rays;
    tc_rays_set_up(&rays, o.volume, &scene, SIDE, SIDE);
    int seen = 0;
    for (int p = 0; p < SIDE * SIDE; p++) {
      ray_of(&rays, p % SIDE, p / SIDE, way);
      const double cosine = dot3(way, scene.clip.planes[0]), far = mm / cosine;
      if (far * sqrt(1 - fmin(cosine * cosine, 1)) > 13.3) continue; /* the face's radius is 13.7 */
      nearer = fmax(nearer, far - (double)d.frame.depth[p]);
      seen++;
    }
    print_message("view %d: %d pixels, up to %.2f voxels before the face\n", i, seen, nearer);
    assert_true(seen > 1000 && nearer < 0.5);
  }
}

/* The face of a cut ends at the object's surface: kernels of the face go no further than the surface beside them. */
TEST(a_cut_face_ends_at_the_surface) {
  enum { LARGE_SIDE = 300 };
  g_auto(object) o = object_of(&cube, blob, ball);
  g_auto(drawing) d = {0};
  for (int i = 0; i < 4; i++) {
    g_auto(tc_scene) scene;
    look(&scene, &o, 7 + 2 * i, 1.5);
    scene.image.width = scene.image.height = LARGE_SIDE;
    double ahead[3], way[3], over = 0, under = 0;
    int wrong = 0, right = 0;
    ahead_of(&scene, ahead);
    const double mm = length3(ahead) + 6, radius = 13.7; /* as above */
    cut_along(&scene, ahead, 6);
    draw_now(&o, &scene, (wish){0}, &d);
    tc_rays rays;
    tc_rays_set_up(&rays, o.volume, &scene, LARGE_SIDE, LARGE_SIDE);
    for (int p = 0; p < LARGE_SIDE * LARGE_SIDE; p++) {
      ray_of(&rays, p % LARGE_SIDE, p / LARGE_SIDE, way);
      const double cosine = dot3(way, scene.clip.planes[0]), from_axis = mm / cosine * sqrt(1 - fmin(cosine * cosine, 1));
      const bool shown = d.frame.linear[4 * p + 3] > 0.5f;
      right += from_axis < radius, wrong += shown != (from_axis < radius);
      if (shown) over = fmax(over, from_axis - radius);
      else under = fmax(under, radius - from_axis);
    }
    const double apart = 0.5 * radius * wrong / right; /* areas: wrong of 2 pi radius apart, right of pi radius^2 */
    print_message("view %d: the face ends %.2f voxels from the surface on average, up to %.2f beyond and %.2f before it\n", i, apart, over, under);
    assert_true(apart < 0.15 && over < 0.3 && under < 0.5);
  }
}

/* A plate along no axis, context[0] voxels thick; 40 voxels a side. */
static double plate(double x, double y, double z, const void *context) {
  const double *c = context, p[3] = {x - 19.5, y - 19.5, z - 19.5};
  double normal[3] = {0.3, 0.9, -0.2};
  normalise3(normal);
  return 0.5 * c[0] - fabs(dot3(p, normal));
}

/* Cut across, sheets and lines of single voxels end where they do elsewhere: no face is wider than the object. */
TEST(a_cut_is_no_wider_than_thin_objects) {
  enum { LARGE_SIDE = 400 };
  const struct { test_field field; double size, most; } objects[] = {{plate, 1, 0.5}, {plate, 1.3, 0.4}, {tubes, 0.7, 0.7}};
  for (int i = 0; i < (int)G_N_ELEMENTS(objects); i++) {
    g_auto(object) o = object_of(&cube, objects[i].field, &objects[i].size);
    g_auto(drawing) d = {0};
    for (int view = 0; view < 3; view++) {
      g_auto(tc_scene) scene;
      look(&scene, &o, 7 + 2 * view, 2); /* perspective */
      scene.image.width = scene.image.height = LARGE_SIDE;
      double ahead[3], way[3], over = -1, at[3];
      int seen = 0;
      ahead_of(&scene, ahead);
      cut_along(&scene, ahead, 0);
      draw_now(&o, &scene, (wish){0}, &d);
      tc_rays rays;
      tc_rays_set_up(&rays, o.volume, &scene, LARGE_SIDE, LARGE_SIDE);
      for (int p = 0; p < LARGE_SIDE * LARGE_SIDE; p++) {
        ray_of(&rays, p % LARGE_SIDE, p / LARGE_SIDE, way);
        for (int k = 0; k < 3; k++) at[k] = scene.camera.position[k] + (double)d.frame.depth[p] * way[k];
        if (!(fabs(dot3(scene.clip.planes[0], at) + scene.clip.planes[0][3]) < 0.3)) continue; /* not the face */
        over = fmax(over, -objects[i].field(at[0], at[1], at[2], &objects[i].size));
        seen++;
      }
      print_message("object %d, view %d: the cut reaches %.2f voxels beyond the object (%d pixels)\n", i, view, over, seen);
      assert_true(seen > 100 && over < objects[i].most);
    }
  }
}

/* Where two planes meet, the face of one ends at the other in a straight line. */
TEST(a_cut_face_ends_at_other_planes) {
  enum { LARGE_SIDE = 300 };
  g_auto(object) o = object_of(&cube, blob, ball);
  g_auto(drawing) d = {0};
  for (int i = 0; i < 4; i++) {
    g_auto(tc_scene) scene;
    look(&scene, &o, 7 + 2 * i, 4);
    scene.image.width = scene.image.height = LARGE_SIDE;
    double ahead[3], across[3], way[3], over = 0, under = 0;
    ahead_of(&scene, ahead);
    across_of(ahead, i, across);
    cut_along(&scene, across, 0);
    memcpy(scene.clip.planes[1], scene.clip.planes[0], sizeof scene.clip.planes[0]);
    cut_along(&scene, ahead, 0);
    scene.clip.n_planes = 2;
    draw_now(&o, &scene, (wish){0}, &d);
    tc_rays rays;
    tc_rays_set_up(&rays, o.volume, &scene, LARGE_SIDE, LARGE_SIDE);
    for (int p = 0; p < LARGE_SIDE * LARGE_SIDE; p++) {
      ray_of(&rays, p % LARGE_SIDE, p / LARGE_SIDE, way);
      const double kept = dot3(way, scene.clip.planes[1]) * length3(ahead) / dot3(way, scene.clip.planes[0]); /* on the face */
      if (d.frame.linear[4 * p + 3] > 0.5f) over = fmax(over, -kept);
      else under = fmax(under, kept);
    }
    print_message("view %d: %.2f voxels beyond the other plane, %.2f missing before it\n", i, over, under);
    assert_true(over < 0.2 && under < 0.3);
  }
}

/* Seen along the plane, the cut is a straight line: neither stairs of voxels nor what of kernels lies beyond. */
TEST(a_cut_ends_at_its_plane) {
  g_auto(object) o = object_of(&cube, blob, ball);
  g_auto(drawing) d = {0};
  for (int i = 0; i < 4; i++) {
    g_auto(tc_scene) scene;
    look(&scene, &o, 7 + 2 * i, 4);
    double ahead[3], across[3], way[3], over = 0, under = 0;
    ahead_of(&scene, ahead);
    across_of(ahead, i, across);
    cut_along(&scene, across, 0);
    draw_now(&o, &scene, (wish){0}, &d);
    tc_rays rays;
    tc_rays_set_up(&rays, o.volume, &scene, SIDE, SIDE);
    for (int p = 0; p < SIDE * SIDE; p++) {
      ray_of(&rays, p % SIDE, p / SIDE, way);
      const double kept = dot3(way, scene.clip.planes[0]) * length3(ahead); /* mm, where the ball is; a voxel is one */
      if (d.frame.linear[4 * p + 3] > 0.5f) over = fmax(over, -kept);
      else under = fmax(under, kept);
    }
    print_message("view %d: %.2f voxels beyond the plane, %.2f missing before it\n", i, over, under);
    assert_true(over < 0.3 && under < 0.3);
  }
}

TESTS(NULL, NULL)
