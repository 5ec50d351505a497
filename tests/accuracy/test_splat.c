/* Splatting: what culling leaves out changes no bit, constant solids are constant, and it is where it should be. */
#include "tests/support/splats.h"
#include <limits.h>

#include "renderer/base/vector.h"

/* ---- culling ---- */

static void clip(tc_scene *scene, int i) {
  if (i % 3 == 0) return;
  double *p = scene->clip.planes[scene->clip.n_planes++];
  direction(i + 5, p);
  p[3] = 3 - (p[0] * scene->camera.target[0] + p[1] * scene->camera.target[1] + p[2] * scene->camera.target[2]);
}

TEST(culling_changes_no_bit) {
  object objects[3] = {object_of(&cube, blob, rough), object_of(&flat_grid, blob, ball),
                       object_of(&flat_grid, tubes, &(double){0.8})};
  tc_pool *pool = tc_pool_new(3, NULL);
  drawing a = {0}, b = {0};
  static const double zooms[] = {0.2, 1, 2.5, 6};
  uint64_t culled = 0, all = 0;
  for (int i = 0; i < 2; i++) assert_true(objects[i].splats->bytes < 6 * (size_t)objects[i].splats->n);
  for (int i = 0; i < 24; i++)
    for (int which = 0; which < 3; which++) {
      g_auto(tc_scene) scene;
      look(&scene, &objects[which], i, zooms[i % 4]);
      scene.splat.kernel_radius = i % 5 == 4 ? 2.5 : i % 11 == 5 ? 16 : 1;
      scene.filter = i % 7 == 6 ? TC_FILTER_CUBIC : TC_FILTER_LINEAR;
      tc_scene_light(&scene, i % 4 != 3);
      clip(&scene, i);
      const char *isa = i % 2 ? "scalar" : NULL;
      draw_now(&objects[which], &scene, (wish){.isa = isa, .pool = pool}, &a);
      scene.splat.culling = false;
      draw_now(&objects[which], &scene, (wish){.isa = isa}, &b);
      assert_memory_equal(a.frame.linear, b.frame.linear, SIDE * SIDE * 4 * sizeof(float));
      assert_memory_equal(a.frame.depth, b.frame.depth, SIDE * SIDE * sizeof(float));
      assert_memory_equal(a.frame.rgba, b.frame.rgba, SIDE * SIDE * 4);
      culled += a.counts.depths + a.counts.drawn, all += b.counts.depths + b.counts.drawn;
    }
  print_message("splats put down: %llu culled, %llu all\n", (unsigned long long)culled, (unsigned long long)all);
  assert_true(culled * 4 < all);
  drawing_finish(&a);
  drawing_finish(&b);
  tc_pool_free(pool);
  for (int i = 0; i < 3; i++) object_free(&objects[i]);
}

TEST(scalar_and_vector_agree) {
  g_auto(object) o = object_of(&flat_grid, blob, rough);
  g_auto(drawing) a = {0}, b = {0};
  size_t different = 0;
  for (int i = 0; i < 12; i++) {
    g_auto(tc_scene) scene;
    look(&scene, &o, i, 1.5);
    tc_scene_light(&scene, true);
    draw_now(&o, &scene, (wish){.isa = "scalar"}, &a);
    draw_now(&o, &scene, (wish){0}, &b);
    for (int p = 0; p < SIDE * SIDE * 4; p++) different += abs(a.frame.rgba[p] - b.frame.rgba[p]) > 1;
  }
  print_message("values more than 1/255 apart: %zu of %d\n", different, 12 * SIDE * SIDE * 4);
  assert_true(different < 12 * SIDE * SIDE * 4 / 1000); /* a rim falls on the other side of a pixel's centre */
}

/* ---- flatness ---- */

/* Whether the ray through a pixel passes within 0.9 of the ball's radius: there it covers all. */
static bool inside_outline(const tc_scene *scene, const object *o, int x, int y) {
  tc_rays rays;
  tc_rays_set_up(&rays, o->volume, scene, SIDE, SIDE);
  double p[3], d[3], view, to[3] = {0}, along = 0, square = 0, length = 0;
  for (int k = 0; k < 3; k++)
    p[k] = rays.anchor0[k] + (x + 0.5) * rays.anchor_du[k] + (y + 0.5) * rays.anchor_dv[k] - 19.5;
  for (int k = 0; k < 3; k++) {
    d[k] = 0;
    for (int c = 0; c < 3; c++) {
      view = rays.view0[c] + (x + 0.5) * rays.view_du[c] + (y + 0.5) * rays.view_dv[c];
      d[k] += rays.to_index[3 * k + c] * view;
    }
  }
  for (int k = 0; k < 3; k++) along += p[k] * d[k], length += d[k] * d[k];
  for (int k = 0; k < 3; k++) to[k] = p[k] - d[k] * along / length, square += to[k] * to[k];
  return square < 0.81 * ball[0] * ball[0];
}

TEST(constant_solids_are_constant) {
  object objects[2] = {object_of(&cube, blob, ball), object_of(&flat_grid, blob, ball)};
  drawing d = {0};
  static const double zooms[] = {0.1, 0.3, 0.7, 1, 1.3, 2, 4, 8}, radii[] = {0.9, 1, 1.5, 3};
  double worst = 0;
  size_t looked_at = 0;
  for (int i = 0; i < 24; i++)
    for (int z = 0; z < 8; z++) {
      const object *o = &objects[(i + z) % 2];
      g_auto(tc_scene) scene;
      look(&scene, o, i, zooms[z]);
      scene.splat.kernel_radius = radii[(i + z) % 4];
      draw_now(o, &scene, (wish){0}, &d);
      for (int p = 0; p < SIDE * SIDE; p += 3) {
        if (!inside_outline(&scene, o, p % SIDE, p / SIDE)) continue;
        looked_at++;
        for (int c = 0; c < 3; c++)
          worst = fmax(worst, fabs((double)d.frame.linear[4 * p + c] - scene.isosurface.color[c]));
        worst = fmax(worst, fabs((double)d.frame.linear[4 * p + 3] - 1));
      }
    }
  print_message("flatness: at most %.4f from constant in %zu pixels\n", worst, looked_at);
  assert_true(worst < 0.01 && looked_at > 50000);
  drawing_finish(&d);
  for (int i = 0; i < 2; i++) object_free(&objects[i]);
}

/* ---- place ---- */

/* Against the isosurface of the same ball: outline, depth and light. */
TEST(splats_are_where_the_surface_is) {
  g_auto(object) o = object_of(&flat_grid, blob, ball);
  g_autoptr(tc_renderer) renderer = tc_renderer_new(&(tc_renderer_options){.backend = TC_BACKEND_CPU}, NULL);
  g_auto(drawing) d = {0};
  g_auto(tc_frame) truth = {0};
  const tc_render_request request = {.want_linear = true, .want_depth = true};
  for (int i = 0; i < 12; i++) {
    g_auto(tc_scene) scene;
    look(&scene, &o, i, 1);
    tc_scene_light(&scene, true);
    draw_now(&o, &scene, (wish){0}, &d);
    scene.mode = TC_MODE_ISOSURFACE;
    scene.isosurface.value = 0;
    assert_true(tc_render(renderer, o.volume, &scene, &request, &truth, NULL));
    double light = 0, depth = 0, deepest = 0;
    int both = 0, one = 0;
    for (int p = 0; p < SIDE * SIDE; p++) {
      const bool here = d.frame.linear[4 * p + 3] > 0.5f, there = truth.linear[4 * p + 3] > 0.5f;
      one += here != there;
      if (!here || !there || !isfinite(d.frame.depth[p])) continue;
      const double apart = (double)(d.frame.depth[p] - truth.depth[p]);
      both++, depth += apart, deepest = fmax(deepest, fabs(apart));
      for (int c = 0; c < 3; c++) light += pow((double)(d.frame.linear[4 * p + c] - truth.linear[4 * p + c]), 2) / 3;
    }
    print_message("view %d: light rms %.4f; depth %.2f mm on average, at most %.2f; outline %.1f %% of the pixels\n", i,
                  sqrt(light / both), depth / both, deepest, 100.0 * one / both);
    assert_true(sqrt(light / both) < 0.06 && fabs(depth / both) < 1 &&
                one < 0.2 * both); /* a voxel of 15 and a pixel of 25 wider */
  }
}

/* Walls of three voxels with nothing within: of a ball, a rugged ball, and a box along the axes and across them. */
static double wall_of(double depth) { return fmin(depth, 3 - depth); }
static double shell(double x, double y, double z, const void *context) { return wall_of(blob(x, y, z, context)); }
static double box_shell(double x, double y, double z, const void *turn) {
  const double c = cos(*(const double *)turn), s = sin(*(const double *)turn);
  const double dx = x - 19.5, dy = y - 19.5, dz = z - 19.5, u = c * dx + s * dy, v = c * (c * dy - s * dx) + s * dz,
               w = c * dz - s * (c * dy - s * dx);
  return wall_of(11 - fmax(fabs(u), fmax(fabs(v), fabs(w))));
}

/* Whether what is within two pixels, and within a voxel, is one surface: its depths are within 5 mm. */
static bool within_a_surface(const tc_frame *truth, int x, int y, int reach, float *far) {
  float near = INFINITY;
  *far = 0;
  if (x < reach || y < reach || x >= SIDE - reach || y >= SIDE - reach) return false;
  for (int v = y - reach; v <= y + reach; v++)
    for (int u = x - reach; u <= x + reach; u++) {
      near = fminf(near, truth->depth[v * SIDE + u]);
      *far = fmaxf(*far, truth->depth[v * SIDE + u]);
    }
  return *far < near + 5;
}

enum { SPARSE = STRIDE(5) }; /* one of SPARSE views is drawn */

/* A wall hides everything behind it at any size of voxels in the picture, except for four pixels in a million. */
TEST(walls_have_no_holes) {
  static const double turns[] = {0, 0.3, 0.7};
  static const struct {
    test_field field;
    const void *context;
    const test_grid *grid;
  } walls[] = {{shell, ball, &cube},          {shell, rough, &cube},          {box_shell, &turns[0], &cube}, {box_shell, &turns[1], &cube},
               {box_shell, &turns[2], &cube}, {shell, rough, &flat_grid}, {box_shell, &turns[1], &flat_grid}};
  static const double zooms[] = {0.4, 0.8, 1.2, 2, 3, 5};
  g_autoptr(tc_renderer) renderer = tc_renderer_new(&(tc_renderer_options){.backend = TC_BACKEND_CPU}, NULL);
  g_auto(drawing) d = {0};
  g_auto(tc_frame) truth = {0};
  const tc_render_request request = {.want_depth = true};
  int holes = 0, n = 0;
  for (size_t w = 0; w < G_N_ELEMENTS(walls); w++) {
    g_auto(object) o = object_of(walls[w].grid, walls[w].field, walls[w].context);
    const int before = holes;
    for (int i = (int)w % SPARSE; i < 24 * 6; i += SPARSE) {
      g_auto(tc_scene) scene;
      look(&scene, &o, i % 24, zooms[i / 24]);
      draw_now(&o, &scene, (wish){0}, &d);
      scene.mode = TC_MODE_ISOSURFACE;
      scene.isosurface.value = 0;
      assert_true(tc_render(renderer, o.volume, &scene, &request, &truth, NULL));
      const int reach = (int)ceil(2 + 1.2 * zooms[i / 24]);
      int here = 0;
      float far;
      for (int y = 0; y < SIDE; y++)
        for (int x = 0; x < SIDE; x++)
          /* The ball's depth is known at each pixel; of the others the farthest depth nearby counts. */
          if (w == 0 ? inside_outline(&scene, &o, x, y) && (far = truth.depth[y * SIDE + x], true) : within_a_surface(&truth, x, y, reach, &far))
            n++, here += d.frame.depth[y * SIDE + x] > far + 2;
      if (here) print_message("wall %zu view %d zoom %g: %d holes\n", w, i, zooms[i / 24], here);
      holes += here;
    }
    print_message("wall %zu: %d holes\n", w, holes - before);
  }
  print_message("%d holes in %d pixels of walls\n", holes, n);
  assert_true(n > 2000000 / SPARSE && holes < MAX(n / 250000, 2));
}

/* Voxels of many pixels show no steps: the light is near the isosurface's. */
TEST(large_voxels_are_lit_smoothly) {
  g_auto(object) o = object_of(&cube, blob, ball);
  g_autoptr(tc_renderer) renderer = tc_renderer_new(&(tc_renderer_options){.backend = TC_BACKEND_CPU}, NULL);
  g_auto(drawing) d = {0};
  g_auto(tc_frame) truth = {0};
  double sum = 0;
  int n = 0;
  for (int i = 6; i < 12; i++) {
    g_auto(tc_scene) scene;
    look(&scene, &o, i, 5);
    tc_scene_light(&scene, true);
    draw_now(&o, &scene, (wish){0}, &d);
    scene.mode = TC_MODE_ISOSURFACE;
    scene.isosurface.value = 0;
    assert_true(tc_render(renderer, o.volume, &scene, &(tc_render_request){.want_linear = true}, &truth, NULL));
    for (int p = 0; p < SIDE * SIDE; p++, n++) sum += pow((double)(d.frame.linear[4 * p] - truth.linear[4 * p]), 2);
  }
  print_message("light rms %.4f\n", sqrt(sum / n));
  assert_true(sqrt(sum / n) < 0.0055);
}

/* Pixel of an index position in an orthographic picture of `side` pixels. */
static void pixel_of(const object *o, const tc_scene *scene, int side, const double index[3], double at[2]) {
  const tc_camera *c = &scene->camera;
  double lps[3], forward[3], right[3], down[3];
  tc_volume_index_to_lps(o->volume, index, lps);
  for (int k = 0; k < 3; k++) forward[k] = c->target[k] - c->position[k], lps[k] -= c->position[k];
  cross3(forward, c->up, right);
  cross3(forward, right, down);
  normalise3(right), normalise3(down);
  at[0] = dot3(lps, right) * side / c->height_mm + 0.5 * side, at[1] = dot3(lps, down) * side / c->height_mm + 0.5 * side;
}

/* How many times from `from` to `to` a line in the picture goes before it is covered, up to two. */
static double bare_way(const tc_frame *frame, int side, const double from[2], const double to[2]) {
  double way = 0;
  for (; way < 2; way += 0.005) {
    const int x = (int)(from[0] + (to[0] - from[0]) * way), y = (int)(from[1] + (to[1] - from[1]) * way);
    if (x >= 0 && y >= 0 && x < side && y < side && frame->linear[4 * (y * side + x) + 3] > 0.5f) break;
  }
  return way;
}

/* Lines of one voxel's width end where the surface does: voxels apart. */
TEST(ends_of_lines_are_the_surfaces) {
  enum { LARGE_SIDE = 400 };
  g_autoptr(tc_renderer) renderer = tc_renderer_new(&(tc_renderer_options){.backend = TC_BACKEND_CPU}, NULL);
  double sum = 0;
  int n = 0;
  for (int thickness = 0; thickness < 2; thickness++) {
    g_auto(object) o = object_of(&cube, tubes, &(double){thickness ? 0.8 : 0.6});
    for (int i = 6; i < 18; i += 2) {
      g_auto(tc_scene) scene;
      g_auto(drawing) d = {0};
      g_auto(tc_frame) truth = {0};
      look(&scene, &o, i, 1.4);
      scene.image.width = scene.image.height = LARGE_SIDE;
      draw_now(&o, &scene, (wish){0}, &d);
      scene.mode = TC_MODE_ISOSURFACE;
      scene.isosurface.value = 0;
      assert_true(tc_render(renderer, o.volume, &scene, &(tc_render_request){.want_linear = true}, &truth, NULL));
      for (int end = 0; end < 6; end++) {
        const double *to = tube_ends[end / 2][end % 2], *other = tube_ends[end / 2][1 - end % 2];
        double place[2], pixels[2], from[3], line[3], length;
        for (int k = 0; k < 3; k++) line[k] = to[k] - other[k];
        length = length3(line);
        for (int k = 0; k < 3; k++) from[k] = to[k] + 3 / length * line[k]; /* three voxels further out */
        pixel_of(&o, &scene, LARGE_SIDE, from, place), pixel_of(&o, &scene, LARGE_SIDE, to, pixels);
        if (hypot(pixels[0] - place[0], pixels[1] - place[1]) < 10) continue; /* nearly along the view */
        sum += 3 * fabs(bare_way(&d.frame, LARGE_SIDE, place, pixels) - bare_way(&truth, LARGE_SIDE, place, pixels)), n++;
      }
    }
  }
  print_message("%d ends, %.2f voxels apart on average\n", n, sum / n);
  assert_true(n > 40 && sum / n < 0.25);
}

/* Lines are lit as cylinders, whatever the voxels' spacings. What is left is where they lie: a voxel's centre is up to half
 * a voxel from the tube's. As flat bands that face the eye they were 0.28 and 0.29 off. */
TEST(lines_are_lit_across) {
  enum { LARGE_SIDE = 300 };
  g_autoptr(tc_renderer) renderer = tc_renderer_new(&(tc_renderer_options){.backend = TC_BACKEND_CPU}, NULL);
  for (int kind = 0; kind < 2; kind++) {
    g_auto(object) o = object_of(kind ? &flat_grid : &cube, tubes, &(double){0.75});
    double sum = 0;
    int n = 0;
    for (int i = 6; i < 18; i++) {
      g_auto(tc_scene) scene;
      g_auto(drawing) d = {0};
      g_auto(tc_frame) truth = {0};
      look(&scene, &o, i, 1.5);
      scene.image.width = scene.image.height = LARGE_SIDE;
      tc_scene_light(&scene, true);
      draw_now(&o, &scene, (wish){0}, &d);
      scene.mode = TC_MODE_ISOSURFACE;
      scene.isosurface.value = 0;
      assert_true(tc_render(renderer, o.volume, &scene, &(tc_render_request){.want_linear = true}, &truth, NULL));
      for (int p = 0; p < LARGE_SIDE * LARGE_SIDE; p++) {
        if (d.frame.linear[4 * p + 3] < 1 || truth.linear[4 * p + 3] < 1) continue;
        sum += pow((double)(d.frame.linear[4 * p] - truth.linear[4 * p]), 2), n++;
      }
    }
    print_message("%s voxels: light rms %.3f in %d pixels\n", kind ? "flat" : "cubic", sqrt(sum / n), n);
    assert_true(n > 10000 && sqrt(sum / n) < 0.25);
  }
}

/* The same tubes in a grid of three times as many voxels a side, of radius context[0] there. */
static double threads(double x, double y, double z, const void *context) {
  return 3 * tubes(x / 3, y / 3, z / 3, &(double){*(const double *)context / 3});
}

/* Bricks are read as they were written: their splats are the model's voxels, each once. */
static void expect_bricks(const object *o) {
  const tc_splats *s = o->splats;
  const int *n = o->model->head.grid.dims;
  uint8_t *seen = calloc((size_t)n[0] * (size_t)n[1], (size_t)n[2]);
  tc_splat_brick brick = {0};
  size_t from = 0;
  for (uint32_t b = 0; b < s->n_bricks; b++) {
    unsigned faces = 0;
    tc_splats_next(s, &from, &brick);
    for (uint32_t i = brick.first; i < brick.first + brick.count; i++) {
      int at[3];
      for (int k = 0; k < 3; k++) at[k] = 16 * brick.at[k] + (int)(s->words[i] >> 4 * k & 15);
      assert_true(at[0] < n[0] && at[1] < n[1] && at[2] < n[2] && tc_vmd_voxel(o->model, at[0], at[1], at[2]));
      assert_int_equal(seen[((size_t)at[2] * (size_t)n[1] + (size_t)at[1]) * (size_t)n[0] + (size_t)at[0]]++, 0);
      faces |= s->words[i] >> 12 & 63;
    }
    assert_int_equal(faces & ~(unsigned)brick.faces, 0);
  }
  assert_int_equal(brick.first + brick.count, s->n);
  free(seen);
}

/* Memory follows what is seen, also where few splats share a brick. */
TEST(thin_objects_take_six_bytes_a_splat) {
  static const test_grid large = {.dims = {120, 120, 120}, .type = TC_F32};
  object objects[] = {object_of(&cube, tubes, &(double){1.6}), object_of(&cube, tubes, &(double){0.8}),
                      object_of(&large, threads, &(double){0.8}), object_of(&large, threads, &(double){0.55})};
  for (int i = 0; i < 4; i++) {
    const tc_splats *s = objects[i].splats;
    print_message("%u splats in %u bricks: %.2f bytes each\n", s->n, s->n_bricks, (double)s->bytes / s->n);
    assert_true(s->bytes <= 6 * (size_t)s->n);
    expect_bricks(&objects[i]);
    object_free(&objects[i]);
  }
}

/* Outlines of voxels of nine pixels are the surface's, not a chain of beads: pixels apart, in the mean over the
 * isosurface's outline. */
static void expect_outlines(test_field of, const void *context, double most) {
  enum { LARGE_SIDE = 300 };
  g_auto(object) o = object_of(&cube, of, context);
  g_autoptr(tc_renderer) renderer = tc_renderer_new(&(tc_renderer_options){.backend = TC_BACKEND_CPU}, NULL);
  g_auto(drawing) d = {0};
  g_auto(tc_frame) truth = {0};
  for (int i = 6; i < 9; i++) {
    g_auto(tc_scene) scene;
    int rim = 0, apart = 0;
    look(&scene, &o, i, 2);
    scene.image.width = scene.image.height = LARGE_SIDE;
    draw_now(&o, &scene, (wish){0}, &d);
    scene.mode = TC_MODE_ISOSURFACE;
    scene.isosurface.value = 0;
    assert_true(tc_render(renderer, o.volume, &scene, &(tc_render_request){.want_linear = true}, &truth, NULL));
    for (int p = LARGE_SIDE; p < LARGE_SIDE * LARGE_SIDE; p++) {
      const bool here = d.frame.linear[4 * p + 3] > 0.5f, there = truth.linear[4 * p + 3] > 0.5f;
      rim += there != (truth.linear[4 * p - 1] > 0.5f) || there != (truth.linear[4 * (p - LARGE_SIDE) + 3] > 0.5f);
      apart += here != there;
    }
    print_message("view %d: outlines %.2f pixels apart\n", i, (double)apart / rim);
    assert_true(apart < most * rim);
  }
}

TEST(large_voxels_end_where_the_surface_does) {
  expect_outlines(blob, ball, 0.6);
  expect_outlines(tubes, &(double){1.6}, 1.5);
  expect_outlines(tubes, &(double){0.8}, 2.3);
}

/* What is picked is what is drawn: as far away, whatever kernels' shapes are (their normals have seven bits when drawn),
 * and exactly so where kernels are balls. On a cut's face a pick takes a voxel's middle: within half a voxel of 1.7 mm. */
static void expect_picks(const object *o, const tc_volume *volume, const tc_volume *labels, bool cut) {
  g_auto(drawing) d = {0};
  for (int i = 6; i < 12; i++) {
    g_auto(tc_scene) scene;
    double apart = 0;
    int both = 0, one = 0;
    look(&scene, o, i, (double[]){2.5, 6, 0.7}[i / 2 - 3]);
    scene.splat.threshold[0] = 0, scene.splat.threshold[1] = INFINITY;
    if (cut) clip(&scene, i % 3 ? i : i + 1);
    draw_now(o, &scene, (wish){0}, &d);
    for (int y = 3; y < SIDE; y += 8)
      for (int x = 3; x < SIDE; x += 8) {
        tc_splat_hit hit;
        const double drawn = (double)d.frame.depth[y * SIDE + x];
        const bool there = tc_splat_pick(volume, labels, &scene, (double[]){x + 0.5, y + 0.5}, &hit);
        one += there != isfinite(drawn), both += there && isfinite(drawn);
        if (there && isfinite(drawn)) apart += fabs(hit.distance_mm - drawn);
      }
    print_message("view %d: %d picks %.3f mm from what is drawn; %d of one only\n", i, both, apart / both, one);
    assert_true(both > 10 && apart < (cut ? 0.7 : i < 10 ? 0.03 : 1e-3) * both && one <= cut);
  }
}

static double inside_ball(double x, double y, double z, const void *context) { return blob(x, y, z, context) >= 0; }

/* Of values; of a run-length model, with its own normals and without; of labels. */
TEST(picks_are_as_deep_as_the_picture) {
  g_auto(object) o = object_of(&flat_grid, blob, ball);
  expect_picks(&o, o.volume, NULL, false);
  expect_picks(&o, o.volume, NULL, true);
  g_autoptr(tc_volume) labels = test_volume(&flat_grid, inside_ball, ball);
  for (int own = 0; own < 2; own++) {
    const tc_vmd_options wish = {.low = 0, .high = INFINITY, .attributes = own ? "value,normal" : "value"};
    tc_vmd *model = tc_vmd_of_volume(o.volume, &wish, NULL, NULL);
    g_autoptr(tc_volume) sparse = tc_vmd_volume(model, NULL);
    tc_splats_free(o.splats);
    o.splats = tc_splats_build(model, (tc_splat_normals){0}, false, NULL, NULL);
    expect_picks(&o, sparse, NULL, false);
    if (!own) expect_picks(&o, o.volume, labels, false);
  }
}

/* From within a solid its walls face away: nothing is drawn, and nothing is picked. A parallel projection, too, begins at the eye. */
TEST(nothing_is_seen_from_within_a_solid) {
  g_auto(object) o = object_of(&cube, blob, ball);
  g_auto(drawing) d = {0};
  for (int projection = 0; projection < TC_PROJECTION_COUNT; projection++) {
    g_auto(tc_scene) scene;
    tc_splat_hit hit;
    look(&scene, &o, 7, 1);
    test_scene_look(&scene, (tc_projection)projection, (double[3]){19, 20, 21}, (double[3]){30, 20, 21}, 12);
    scene.splat.threshold[0] = 0, scene.splat.threshold[1] = 100;
    draw_now(&o, &scene, (wish){0}, &d);
    for (int i = 0; i < SIDE; i += 5) {
      assert_true(d.frame.linear[4 * (i * SIDE + i) + 3] == 0);
      assert_false(tc_splat_pick(o.volume, NULL, &scene, (double[]){i + 0.5, i + 0.5}, &hit));
    }
  }
}

/* Faces of the volume that cut an object are lit as what they are, whatever its values are within. */
TEST(faces_of_the_volume_are_lit) {
  static const double large[2] = {40, 3};
  g_auto(object) o = object_of(&cube, blob, large);
  g_auto(drawing) d = {0};
  for (int i = 0; i < 6; i++) {
    g_auto(tc_scene) scene;
    double darkest = 1;
    look(&scene, &o, i, 1.2);
    tc_scene_light(&scene, true);
    draw_now(&o, &scene, (wish){0}, &d);
    for (int y = 36; y < 60; y++)
      for (int x = 36; x < 60; x++)
        darkest = fmin(darkest, (double)d.frame.linear[4 * (y * SIDE + x)] / scene.isosurface.color[0]);
    print_message("face %d: at least %.2f of the colour\n", i, darkest);
    assert_true(darkest > 0.9);
  }
}

static double negative(double x, double y, double z, const void *context) { return -5 - 0.01 * (x + y + z); }

/* An object of all values, all below 0, ends with the grid alone, and nothing beyond that is read. */
TEST(a_range_of_all_values_ends_with_the_grid) {
  g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {6, 5, 4}, .type = TC_F32}, negative, NULL);
  g_autoptr(tc_vmd_object) subject = tc_vmd_object_new(volume, -INFINITY, INFINITY);
  for (int corner = 0; corner < 8; corner++) {
    double n[3];
    tc_vmd_normal_at(subject, corner & 1 ? 5 : 0, corner & 2 ? 4 : 0, corner & 4 ? 3 : 0, n);
    for (int k = 0; k < 3; k++) assert_true(corner >> k & 1 ? n[k] > 0 : n[k] < 0);
  }
}

/* blob, its middle elsewhere. */
static double blob_at(double x, double y, double z, const void *context) {
  const double away = *(const double *)context;
  return blob(x - away, y - away, z - away, rough);
}

/* The same object in ever larger grids costs the same: no brick, no splat more is looked at. */
TEST(cost_follows_the_voxels_seen) {
  g_auto(drawing) d = {0};
  g_auto(tc_scene) scene;
  uint64_t put[4], visited[4], entries[4];
  for (int i = 0; i < 4; i++) {
    const double away = 16 * i; /* whole bricks */
    const int side = 40 + 32 * i;
    const test_grid grid = {.dims = {side, side, side}, .type = TC_F32, .origin = {-away, -away, -away}};
    g_auto(object) o = object_of(&grid, blob_at, &away);
    if (!i) look(&scene, &o, 7, 1);
    draw_now(&o, &scene, (wish){0}, &d);
    put[i] = d.counts.depths + d.counts.drawn;
    visited[i] = d.counts.visited, entries[i] = d.counts.entries;
    print_message("grid of %d: %llu splats put down of %llu looked at in %llu bricks\n", side,
                  (unsigned long long)put[i], (unsigned long long)visited[i], (unsigned long long)entries[i]);
    assert_true(put[i] == put[0] && visited[i] == visited[0] && entries[i] == entries[0] && visited[i] > 0);
  }
}

/* A bowl of 2.4 voxels: its rim is seen from both sides. */
static double bowl(double x, double y, double z, const void *context) {
  const double dx = x - 19.5, dy = y - 19.5, dz = z - 19.5;
  return fmin(1.2 - fabs(sqrt(dx * dx + dy * dy + dz * dz) - 14), 3 - dz);
}

/* The brightest channel of the pixels around one. */
static double brightest(const float *linear, int x, int y, int reach) {
  double most = 0;
  for (int v = MAX(y - reach, 0); v <= MIN(y + reach, SIDE - 1); v++)
    for (int u = MAX(x - reach, 0); u <= MIN(x + reach, SIDE - 1); u++)
      most = fmax(most, (double)linear[4 * (v * SIDE + u)]);
  return most;
}

/* What faces away at a rim is not lit as if it faced the eye: few pixels are brighter than all of the isosurface near.
 */
TEST(rims_do_not_shine) {
  g_auto(object) o = object_of(&cube, bowl, NULL);
  g_autoptr(tc_renderer) renderer = tc_renderer_new(&(tc_renderer_options){.backend = TC_BACKEND_CPU}, NULL);
  g_auto(drawing) d = {0};
  g_auto(tc_frame) truth = {0};
  int shining = 0, shown = 0;
  for (int i = 6; i < 18; i++) {
    g_auto(tc_scene) scene;
    look(&scene, &o, i, 1);
    tc_scene_light(&scene, true);
    draw_now(&o, &scene, (wish){0}, &d);
    scene.mode = TC_MODE_ISOSURFACE;
    scene.isosurface.value = 0;
    assert_true(tc_render(renderer, o.volume, &scene, &(tc_render_request){.want_linear = true}, &truth, NULL));
    for (int p = 0; p < SIDE * SIDE; p++) {
      shown += d.frame.linear[4 * p + 3] > 0.5f;
      shining += (double)d.frame.linear[4 * p] > brightest(truth.linear, p % SIDE, p / SIDE, 3) + 0.15;
    }
  }
  print_message("%d of %d pixels shine\n", shining, shown);
  assert_true(shining * 200 < shown);
}

/* ---- interruption ---- */

TEST(paused_pictures_end_the_same) {
  g_auto(object) o = object_of(&cube, blob, rough);
  g_autoptr(tc_pool) pool = tc_pool_new(2, NULL);
  g_auto(drawing) whole = {0}, parts = {0};
  g_auto(tc_scene) scene;
  look(&scene, &o, 7, 2);
  scene.image.width = scene.image.height = 300;
  scene.splat.kernel_radius = 16;
  draw_now(&o, &scene, (wish){0}, &whole);
  tc_interrupt interrupt;
  tc_interrupt_init(&interrupt);
  atomic_store(&interrupt.pause_us, 0);
  int pauses = 0;
  GError *error = NULL;
  tc_halt_probe_begin(LLONG_MAX);
  while (!draw(&o, &scene, (wish){.pool = pool, .interrupt = &interrupt, .resume = pauses > 0}, &parts, &error)) {
    assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_PAUSED));
    g_clear_error(&error);
    if (pauses++ > 200) atomic_store(&interrupt.pause_us, LLONG_MAX);
  }
  tc_halt_probed.on = false;
  print_message("%d pauses; at most %.2f ms of processor time without a look\n", pauses,
                (double)atomic_load(&tc_halt_probed.longest_us) / 1000);
  assert_true(pauses > 0 && atomic_load(&tc_halt_probed.longest_us) < 20000);
  assert_memory_equal(whole.frame.rgba, parts.frame.rgba, 300 * 300 * 4);
}

/* As a whole: what is read is built, and the picture drawn, in as many pieces as a caller likes. */
TEST(frames_are_made_in_pieces) {
  const int side = SANITIZED ? 64 : 100;
  const test_grid large = {.dims = {side, side, side}, .type = TC_U8};
  const unsigned seed = 7;
  g_autoptr(tc_volume) volume = test_volume(&large, test_noise, &seed); /* values 0 and 1, each half of the voxels */
  g_autoptr(tc_renderer) renderer =
      tc_renderer_new(&(tc_renderer_options){.backend = TC_BACKEND_CPU, .threads = 2}, NULL);
  g_auto(tc_frame) whole = {0}, parts = {0};
  g_auto(tc_scene) scene;
  test_scene(&scene, 200, 150);
  test_scene_frame(&scene, volume, TC_PERSPECTIVE, (double[]){1, 0.4, 0.3});
  scene.mode = TC_MODE_SPLAT;
  scene.splat.threshold[0] = 0.5;
  scene.clip.n_planes = 1;
  scene.clip.planes[0][0] = -1, scene.clip.planes[0][3] = scene.camera.target[0];
  assert_true(tc_render(renderer, volume, &scene, NULL, &whole, NULL));
  tc_renderer_forget(renderer, volume);
  tc_interrupt interrupt;
  tc_interrupt_init(&interrupt);
  atomic_store(&interrupt.pause_us, 0);
  tc_render_request request = {.interrupt = &interrupt};
  int pauses = 0;
  GError *error = NULL;
  tc_halt_probe_begin(LLONG_MAX);
  while (!tc_render(renderer, volume, &scene, &request, &parts, &error)) {
    assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_PAUSED) && pauses++ < 1000);
    g_clear_error(&error);
    request.resume = true;
  }
  tc_halt_probed.on = false;
  print_message("%d pauses; at most %.2f ms of processor time without a look\n", pauses,
                (double)atomic_load(&tc_halt_probed.longest_us) / 1000);
  assert_true(pauses > 0);
  assert_memory_equal(whole.rgba, parts.rgba, 200 * 150 * 4);
  atomic_store(&interrupt.cancel, true);
  assert_false(tc_render(renderer, volume, &scene, &request, &parts, &error));
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_CANCELLED));
  g_clear_error(&error);
}

TESTS(NULL, NULL)
