/* Splats in voxels of many pixels, seen along the axes of the grid: surfaces that the eye looks along have voxels whose only free
 * faces are edge-on. Outlines end where the surface does, and walls have no holes. */
#include "tests/support/splats.h"

#include "renderer/base/vector.h"

enum { WIDE = 320 };
static const double middle[3] = {19.5, 19.5, 19.5};

/* A camera on axis `way` / 2, that sees `mm` of height. */
static void look_along(tc_scene *scene, int way, tc_projection projection, double mm) {
  const double away = projection == TC_PERSPECTIVE ? 300 : 100;
  double from[3], side[3];
  test_scene(scene, WIDE, WIDE);
  scene->splat.opaque = scene->splat.culling = true;
  direction(way, side);
  for (int k = 0; k < 3; k++) from[k] = middle[k] + away * side[k];
  test_scene_look(scene, projection, from, middle, projection == TC_PERSPECTIVE ? 360 / M_PI * atan(0.5 * mm / away) : mm);
}

static bool is_shown(const drawing *d, int x, int y) { return d->frame.linear[4 * (y * WIDE + x) + 3] > 0.5f; }

/* Pixels a voxel are WIDE / mm, nine and four; in perspective the ball's outline is somewhat wider than the ball. */
TEST(a_ball_is_round) {
  g_auto(object) o = object_of(&cube, blob, ball);
  g_auto(drawing) d = {0};
  for (int i = 0; i < 24; i++) {
    const tc_projection projection = i % 12 < 6 ? TC_ORTHOGRAPHIC : TC_PERSPECTIVE;
    const double mm = i < 12 ? 36 : 78, radius = projection == TC_PERSPECTIVE ? 15 / sqrt(1 - 15.0 * 15 / (300 * 300)) : 15;
    g_auto(tc_scene) scene;
    double over = 0, under = 0;
    look_along(&scene, i % 6, projection, mm);
    draw_now(&o, &scene, (wish){0}, &d);
    for (int y = 0; y < WIDE; y++)
      for (int x = 0; x < WIDE; x++) {
        const double from_middle = hypot(x + 0.5 - WIDE / 2, y + 0.5 - WIDE / 2) * mm / WIDE;
        if (is_shown(&d, x, y)) over = fmax(over, from_middle - radius);
        else under = fmax(under, radius - from_middle);
      }
    print_message("view %d: up to %.2f voxels beyond the outline, %.2f missing before it\n", i, over, under);
    assert_true(over < 0.1 && under < 0.1);
  }
}

typedef struct rod {
  int axis; /* that it slants from */
  double slant[2], radius;
} rod;

static void rod_way(const rod *r, double way[3]) {
  way[r->axis] = 1, way[(r->axis + 1) % 3] = r->slant[0], way[(r->axis + 2) % 3] = r->slant[1];
  normalise3(way);
}

static double rod_at(double x, double y, double z, const void *context) {
  const rod *r = context;
  double p[3] = {x - middle[0], y - middle[1], z - middle[2]}, way[3];
  rod_way(r, way);
  const double along = dot3(p, way);
  return r->radius - sqrt(fmax(dot3(p, p) - along * along, 0));
}

/* Its wall goes back a voxel every few voxels. */
TEST(slanting_rods_have_no_holes) {
  const rod rods[] = {{1, {0.35, -0.2}, 4}, {0, {0.2, 0.5}, 3}, {2, {-0.15, 0.3}, 5}, {1, {0.25, 0.2}, 2.5}};
  for (int i = 0; i < (int)G_N_ELEMENTS(rods); i++)
    for (int side = 0; side < 2; side++) {
      const rod *r = &rods[i];
      const double mm = 20;
      g_auto(object) o = object_of(&cube, rod_at, r);
      g_auto(drawing) d = {0};
      g_auto(tc_scene) scene;
      double over = 0, under = 0, way[3];
      look_along(&scene, 2 * r->axis + side, TC_ORTHOGRAPHIC, mm);
      draw_now(&o, &scene, (wish){0}, &d);
      tc_rays rays;
      tc_rays_set_up(&rays, o.volume, &scene, WIDE, WIDE);
      rod_way(r, way);
      for (int y = 0; y < WIDE; y++)
        for (int x = 0; x < WIDE; x++) {
          double p[3], across[3], along, beside; /* the pixel from the rod's middle, in the plane of the picture */
          for (int k = 0; k < 3; k++) p[k] = rays.anchor0[k] + (x + 0.5) * rays.anchor_du[k] + (y + 0.5) * rays.anchor_dv[k] - middle[k];
          memcpy(across, way, sizeof across);
          p[r->axis] = across[r->axis] = 0;
          normalise3(across);
          along = dot3(p, across), beside = sqrt(fmax(dot3(p, p) - along * along, 0));
          if (fabs(along) > 2) continue; /* its ends are elsewhere */
          if (is_shown(&d, x, y)) over = fmax(over, beside - r->radius);
          else under = fmax(under, r->radius - beside);
        }
      print_message("rod %d, side %d: up to %.2f voxels beyond the outline, %.2f missing before it\n", i, side, over, under);
      assert_true(over < 0.25 && under < 0.25);
    }
}

/* A solid that its grid ends: of the field's, what is at most half a voxel beyond the outermost voxels. */
static double within_sides(test_field field, const void *context, const double p[3]) {
  double depth = field(p[0], p[1], p[2], context);
  for (int k = 0; k < 3; k++) depth = fmin(depth, fmin(p[k] + 0.5, cube.dims[k] - 0.5 - p[k]));
  return depth;
}

/* A pixel's ray in index coordinates: a place on it, and its direction (a unit vector). */
static void pixel_ray(const tc_rays *rays, int x, int y, double at[3], double way[3]) {
  for (int r = 0; r < 3; r++) {
    way[r] = 0;
    for (int k = 0; k < 3; k++) way[r] += rays->to_index[3 * r + k] * (rays->view0[k] + (x + 0.5) * rays->view_du[k] + (y + 0.5) * rays->view_dv[k]);
    at[r] = rays->anchor0[r] + (x + 0.5) * rays->anchor_du[r] + (y + 0.5) * rays->anchor_dv[r];
  }
  normalise3(way);
}

typedef struct solid {
  test_field field;
  const void *context;
} solid;

/* The greater of `deepest` and the greatest depth between from and to on a line, by bisection. Depths are distances, so they change by at
 * most half an interval's length from its middle to its ends. */
static double deepest_between(const solid *s, const double at[3], const double way[3], double from, double to, double deepest) {
  const double half = 0.5 * (to - from), t = from + half;
  const double depth = within_sides(s->field, s->context, (double[]){at[0] + t * way[0], at[1] + t * way[1], at[2] + t * way[2]});
  deepest = fmax(deepest, depth);
  if (half < 0.0625 || depth + half <= deepest) return deepest;
  return deepest_between(s, at, way, t, to, deepest_between(s, at, way, from, t, deepest));
}

/* Of a pixel's ray, how deep it goes into the solid; negative: by how much it misses the solid. */
static double deepest_of(const tc_rays *rays, const solid *s, int x, int y) {
  double at[3], way[3], nearest = 0; /* to the middle */
  pixel_ray(rays, x, y, at, way);
  for (int k = 0; k < 3; k++) nearest += (middle[k] - at[k]) * way[k];
  return deepest_between(s, at, way, nearest - 40, nearest + 40, -INFINITY);
}

static double everywhere(double x, double y, double z, const void *context) { return 50; }

/* An object that ends with its grid ends in a plane, wherever from that is seen: rods, a ball wider than its grid, and all of the grid. */
TEST(ends_with_the_grid_are_flat) {
  static const rod rods[] = {{2, {0.3, -0.15}, 8}, {1, {0, 0}, 10}, {0, {0.4, 0.2}, 5}};
  static const double wide_ball[2] = {23, 0};
  const solid solids[] = {{rod_at, &rods[0]}, {rod_at, &rods[1]}, {rod_at, &rods[2]}, {blob, wide_ball}, {everywhere, NULL}};
  for (int i = 0; i < (int)G_N_ELEMENTS(solids); i += STRIDE(2)) {
    g_auto(object) o = object_of(&cube, solids[i].field, solids[i].context);
    g_auto(drawing) d = {0};
    double over = 0, under = 0;
    for (int view = 0; view < 10; view += STRIDE(3)) {
      g_auto(tc_scene) scene;
      double side[3], from[3];
      tc_rays rays;
      direction(view + 4, side);
      test_scene(&scene, WIDE, WIDE);
      scene.splat.opaque = scene.splat.culling = true;
      for (int k = 0; k < 3; k++) from[k] = middle[k] + 200 * side[k];
      test_scene_look(&scene, view % 2 ? TC_PERSPECTIVE : TC_ORTHOGRAPHIC, from, middle, view % 2 ? 15 : 50);
      draw_now(&o, &scene, (wish){0}, &d);
      tc_rays_set_up(&rays, o.volume, &scene, WIDE, WIDE);
      for (int y = 0; y < WIDE; y += 2)
        for (int x = 0; x < WIDE; x += 2) {
          const double deepest = deepest_of(&rays, &solids[i], x, y);
          if (is_shown(&d, x, y)) over = fmax(over, -deepest);
          else under = fmax(under, deepest);
        }
    }
    print_message("solid %d: up to %.2f voxels beyond the outline, %.2f missing before it\n", i, over, under);
    assert_true(over < 0.5 && under < 0.15);
  }
}

/* How many voxels a pixel's ray goes through the box of all voxels; negative: it misses the box. */
static double way_through(const tc_rays *rays, int x, int y) {
  double at[3], way[3], from = -INFINITY, to = INFINITY;
  pixel_ray(rays, x, y, at, way);
  for (int k = 0; k < 3; k++) {
    const double lo = (-0.5 - at[k]) / way[k], hi = (cube.dims[k] - 0.5 - at[k]) / way[k];
    from = fmax(from, fmin(lo, hi)), to = fmin(to, fmax(lo, hi));
  }
  return to - from;
}

/* Two ends meet without a crack, wherever from they are seen; from view 72 on pixels' middles lie on an edge. */
TEST(ends_meet) {
  g_auto(object) o = object_of(&cube, everywhere, NULL);
  g_auto(drawing) d = {0};
  int open = 0, n = 0;
  for (int view = 0; view < 84; view++) {
    static const double mm[] = {60, 40, 25, 140, 33};
    g_auto(tc_scene) scene;
    double side[3], from[3], to[3];
    const double height = mm[view / 18];
    const int axis = view % 3, next = (axis + 1) % 3; /* of the edge; and across it */
    tc_rays rays;
    direction(6 + view % 18, side);
    memcpy(to, middle, sizeof to);
    if (view >= 72) {
      const double way = view % 2 ? 1 : -1;
      side[axis] = 0, side[next] = M_SQRT1_2, side[3 - axis - next] = way * M_SQRT1_2;
      to[next] += 0.5 * M_SQRT1_2 * height / WIDE, to[3 - axis - next] -= way * 0.5 * M_SQRT1_2 * height / WIDE;
    }
    test_scene(&scene, WIDE, WIDE);
    scene.splat.opaque = scene.splat.culling = true;
    for (int k = 0; k < 3; k++) from[k] = to[k] + 200 * side[k];
    const tc_projection projection = view % 2 && view < 72 ? TC_PERSPECTIVE : TC_ORTHOGRAPHIC;
    test_scene_look(&scene, projection, from, to, projection == TC_PERSPECTIVE ? 360 / M_PI * atan(height / 400) : height);
    draw_now(&o, &scene, (wish){0}, &d);
    tc_rays_set_up(&rays, o.volume, &scene, WIDE, WIDE);
    for (int i = 0; i < WIDE * WIDE; i++) {
      const bool inside = way_through(&rays, i % WIDE, i / WIDE) > 0.5;
      n += inside, open += inside && !is_shown(&d, i % WIDE, i / WIDE);
    }
  }
  print_message("%d pixels of %d show through\n", open, n);
  assert_true(n > 1000000 && open == 0);
}

/* A wall to the eye's right, whose surface faces the eye: it moves out by context[0] voxels a voxel along z. */
static double wall_at(double x, double y, double z, const void *context) {
  return 27.4 + *(const double *)context * (z - middle[2]) - x;
}

/* Whole bricks of such a wall have no face that looks to the eye. */
TEST(culling_changes_no_bit_of_flat_walls) {
  static const test_grid deep = {.dims = {40, 40, 200}, .type = TC_F32};
  for (int i = 0; i < 4; i += STRIDE(3)) {
    const double slope = i < 2 ? 0.02 : 0.03;
    g_auto(object) o = object_of(&deep, wall_at, &slope);
    g_auto(drawing) d = {0};
    g_auto(tc_scene) scene;
    look_along(&scene, 4, i & 1 ? TC_PERSPECTIVE : TC_ORTHOGRAPHIC, 24);
    draw_now(&o, &scene, (wish){0}, &d);
    g_autofree float *culled = g_memdup2(d.frame.linear, 16 * WIDE * WIDE);
    scene.splat.culling = false;
    draw_now(&o, &scene, (wish){0}, &d);
    assert_memory_equal(d.frame.linear, culled, 16 * WIDE * WIDE);
  }
}

TESTS(NULL, NULL)
