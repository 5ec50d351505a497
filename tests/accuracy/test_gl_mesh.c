/* Mode mesh on the gl back end against the cpu's rasteriser: equal within 1/255 but for ties, which are counted and proven.
 *
 * A tie is a sample at which rounding decides what is seen. Both rasterisers round vertices to a 256th of a pixel, so that no
 * edge is further than that from where it is exactly; depths are rounded, and interpolated between rounded corners. Here all
 * triangles are projected in double precision. A triangle covers a sample for certain if the sample is inside by more than
 * a 256th of a pixel, and perhaps if it is outside by no more; its nearness there is an interval. What may be seen are the
 * triangles of which no part of the interval is behind all of one that covers for certain; and the background where none
 * does. Two or more of these: a tie. Of translucent layers, each in front of what is opaque must cover for certain, and no
 * two intervals meet: else a tie. A pixel of n samples, k of which are ties, differs by no more than k/n. */
#include "tests/support/test.h"

#include <inttypes.h>

#include "renderer/mesh/clip.h"
#include "renderer/mesh/gl/mesh.h"
#include "renderer/mesh/surfaces.h"
#include "renderer/raycast/mpr.h"
#include "renderer/raycast/rays.h"
#include "renderer/tomocast.h"
#include "tests/support/grid.h"
#include "tests/support/image.h"
#include "tests/support/renderers.h"

enum { SIDE = 300, PIXELS = SIDE * SIDE };
#define MOVED (1.0 / 256) /* pixels: how far an edge may be from its place */

/* ---- what may be seen ---- */

typedef struct polygon {
  int n;
  bool clear; /* of a translucent surface */
  double at[TC_CLIP_MOST_CORNERS][2], near[TC_CLIP_MOST_CORNERS]; /* pixels; nearness (view.h) */
} polygon;

typedef struct truth {
  tc_clusters *mesh;
  tc_mesh_view view;
  polygon *polygons;
  GArray *of_pixel[PIXELS]; /* numbers of polygons whose boxes touch the pixel */
} truth;

static bool everything(const void *user, uint32_t label) { return label != 0; }

/* Of the list's item, as mode mpr has it. */
static tc_mesh_source source_of(const tc_scene *scene, const tc_mesh_surface *item) {
  if (item->source != TC_SURFACE_OF_PLANE) return (tc_mesh_source){.kind = TC_SURFACE_OF_VALUE, .iso = item->value};
  tc_mesh_source of = {.kind = TC_SURFACE_OF_PLANE};
  tc_scene slice = *scene; /* borrows */
  double right[3], up[3];
  slice.mpr.orientation = item->plane;
  tc_slice_basis(&slice, right, up, of.plane);
  for (int k = 0; k < 3; k++) of.plane[3] -= of.plane[k] * scene->mpr.center[k];
  return of;
}

static tc_clusters *surfaces(tc_volume *volume, const tc_render_request *request, const tc_scene *scene) {
  GError *error = NULL;
  tc_mesh_source of[TC_MAX_SURFACES] = {{.kind = TC_SURFACE_OF_VALUE, .iso = scene->isosurface.value}};
  const size_t n = scene->mesh.n_surfaces;
  for (size_t i = 0; i < n; i++)
    if (scene->mesh.surfaces[i].source == TC_SURFACE_OF_MESH)
      of[i] = (tc_mesh_source){.kind = TC_SURFACE_OF_MESH, .serial = request->meshes[i]->serial, .mesh = request->meshes[i]};
    else
      of[i] = source_of(scene, &scene->mesh.surfaces[i]);
  const tc_surfaces_wish wish = {.volume = volume, .sources = request->labels ? NULL : of, .n_sources = n ? n : 1, .labels = request->labels,
                                 .shows = everything, .max_bytes = 1 << 30};
  tc_surfaces *s = tc_surfaces_begin();
  if (!tc_surfaces_go_on(s, &wish, &error)) fail_msg("%s", error->message);
  return tc_surfaces_take(s);
}

static void project(const tc_mesh_view *v, const double p[3], double at[2], double *near) {
  double behind = tc_mesh_view_row(v->depth, p), d = v->perspective ? behind + v->reference : 1;
  at[0] = v->centre[0] + v->scale * tc_mesh_view_row(v->right, p) / d;
  at[1] = v->centre[1] + v->scale * tc_mesh_view_row(v->down, p) / d;
  *near = -behind / d;
}

static void add_triangle(truth *t, const tc_cluster *k, int i, uint32_t number) {
  const size_t room = tc_cluster_padded(k->n_vertices), corners = tc_cluster_padded(k->n_triangles);
  const float *at = t->mesh->positions + 3 * (size_t)k->vertex;
  const uint8_t *v = t->mesh->triangles + 3 * (size_t)k->triangle + i;
  tc_clip_corner c[TC_CLIP_MOST_CORNERS];
  polygon *p = &t->polygons[number];
  for (size_t j = 0; j < 3; j++)
    c[j] = (tc_clip_corner){{at[v[j * corners]], at[room + v[j * corners]], at[2 * room + v[j * corners]]}, 0};
  p->n = tc_clip(&t->view, (1u << t->view.n_planes) - 1, c);
  double lo[2] = {INFINITY, INFINITY}, hi[2] = {-INFINITY, -INFINITY};
  for (int j = 0; j < p->n; j++) {
    project(&t->view, c[j].at, p->at[j], &p->near[j]);
    for (int d = 0; d < 2; d++) lo[d] = fmin(lo[d], p->at[j][d]), hi[d] = fmax(hi[d], p->at[j][d]);
  }
  for (int y = (int)fmax(floor(lo[1] - MOVED), 0); y <= fmin(hi[1] + MOVED, SIDE - 1); y++)
    for (int x = (int)fmax(floor(lo[0] - MOVED), 0); x <= fmin(hi[0] + MOVED, SIDE - 1); x++) {
      GArray **list = &t->of_pixel[y * SIDE + x];
      if (!*list) *list = g_array_new(FALSE, FALSE, sizeof number);
      g_array_append_val(*list, number);
    }
}

static truth *find_truth(tc_volume *volume, const tc_render_request *request, const tc_scene *scene) {
  truth *t = calloc(1, sizeof *t);
  double planes[TC_VIEW_MOST_CLIP][4] = {{0}};
  int n = 0;
  for (int k = 0; k < 3 && scene->clip.has_box; k++) {
    planes[n][k] = 1, planes[n++][3] = -scene->clip.box[0][k];
    planes[n][k] = -1, planes[n++][3] = scene->clip.box[1][k];
  }
  for (int i = 0; i < scene->clip.n_planes; i++) memcpy(planes[n++], scene->clip.planes[i], sizeof *planes);
  t->mesh = surfaces(volume, request, scene);
  tc_mesh_view_set_up(&t->view, t->mesh, &scene->camera, SIDE, SIDE);
  tc_mesh_view_clip(&t->view, t->mesh, (const double(*)[4])planes, n);
  t->polygons = calloc(t->mesh->n_triangles + 1, sizeof *t->polygons);
  uint32_t number = 0;
  for (size_t c = 0; c < t->mesh->n; c++)
    for (int i = 0; i < t->mesh->clusters[c].n_triangles; i++, number++) {
      add_triangle(t, &t->mesh->clusters[c], i, number);
      t->polygons[number].clear = scene->mesh.n_surfaces && scene->mesh.surfaces[t->mesh->clusters[c].part].opacity < 1;
    }
  return t;
}

static void free_truth(truth *t) {
  for (int i = 0; i < PIXELS; i++)
    if (t->of_pixel[i]) g_array_unref(t->of_pixel[i]);
  tc_clusters_free(t->mesh);
  free(t->polygons);
  free(t);
}

/* How far the point is inside, pixels; below 0: outside. Exact where it is near an edge. */
static double inside(const polygon *p, double x, double y) {
  double least = INFINITY, area = 0;
  for (int i = 0; i < p->n; i++) {
    const double *a = p->at[i], *b = p->at[(i + 1) % p->n];
    area += a[0] * b[1] - b[0] * a[1];
  }
  for (int i = 0; i < p->n; i++) {
    const double *a = p->at[i], *b = p->at[(i + 1) % p->n], dx = b[0] - a[0], dy = b[1] - a[1], length = hypot(dx, dy);
    if (length > 0) least = fmin(least, (area < 0 ? -1 : 1) * (dx * (y - a[1]) - dy * (x - a[0])) / length);
  }
  return least;
}

/* Nearness at the point, by the plane through the corners that span most; and how much it may be off. */
static void near_at(const polygon *p, double x, double y, double *least, double *most) {
  double best = 0, gx = 0, gy = 0, at = p->near[0], lo = INFINITY, hi = -INFINITY;
  for (int i = 1; i + 1 < p->n; i++) {
    const double bx = p->at[i][0] - p->at[0][0], by = p->at[i][1] - p->at[0][1], bn = p->near[i] - p->near[0];
    const double cx = p->at[i + 1][0] - p->at[0][0], cy = p->at[i + 1][1] - p->at[0][1], cn = p->near[i + 1] - p->near[0];
    const double area = bx * cy - by * cx;
    if (fabs(area) <= best) continue;
    best = fabs(area);
    gx = (bn * cy - cn * by) / area, gy = (cn * bx - bn * cx) / area;
    at = p->near[0] + gx * (x - p->at[0][0]) + gy * (y - p->at[0][1]);
  }
  for (int i = 0; i < p->n; i++) lo = fmin(lo, p->near[i]), hi = fmax(hi, p->near[i]);
  const double rounding = 0x1p-20 * (1 + fabs(at)), slope = 2 * MOVED * (fabs(gx) + fabs(gy));
  *least = fmax(at - slope, lo) - rounding, *most = fmin(at + slope, hi) + rounding;
}

/* How many things may be seen at the point; whether one of them is at this depth (mm along the ray; NAN: not asked). */
static int may_be_seen(const truth *t, int pixel, double x, double y, double depth, bool *there) {
  const tc_mesh_view *v = &t->view;
  const GArray *list = t->of_pixel[pixel];
  double hides = -INFINITY, least, most;
  int n = 0;
  for (guint i = 0; list && i < list->len; i++) {
    const polygon *p = &t->polygons[g_array_index(list, uint32_t, i)];
    if (p->n < 3 || inside(p, x, y) <= MOVED) continue;
    near_at(p, x, y, &least, &most);
    hides = fmax(hides, least);
  }
  n = hides == -INFINITY;
  *there = isnan(depth) || (n && isinf(depth));
  const double across = (x - v->centre[0]) / v->scale, along = (y - v->centre[1]) / v->scale;
  const double length = v->perspective ? sqrt(1 + across * across + along * along) : 1, d = depth / length;
  const double near = v->perspective ? (v->reference - d) / d : v->reference - d;
  for (guint i = 0; list && i < list->len; i++) {
    const polygon *p = &t->polygons[g_array_index(list, uint32_t, i)];
    if (p->n < 3 || inside(p, x, y) < -MOVED) continue;
    near_at(p, x, y, &least, &most);
    if (most < hides) continue;
    n++;
    *there = *there || (near > least - 1e-5 * (1 + fabs(near)) && near < most + 1e-5 * (1 + fabs(near)));
  }
  return n;
}

/* With translucent surfaces all layers before what is opaque count: whether one of them perhaps covers the point, or two are
 * at one depth. */
static bool layers_may_differ(const truth *t, int pixel, double x, double y) {
  const GArray *list = t->of_pixel[pixel];
  double hides = -INFINITY, least[64], most[64];
  int n = 0;
  for (int round = 0; round < 2; round++)
    for (guint i = 0; list && i < list->len && n < 64; i++) {
      const polygon *p = &t->polygons[g_array_index(list, uint32_t, i)];
      const double in = p->n < 3 ? -1 : inside(p, x, y);
      if (in < -MOVED) continue;
      near_at(p, x, y, &least[n], &most[n]);
      if (!round && !p->clear && in > MOVED) hides = fmax(hides, least[n]);
      if (!round || most[n] < hides) continue;
      if (in <= MOVED) return true;
      for (int k = 0; k < n; k++)
        if (most[k] >= least[n] && most[n] >= least[k]) return true;
      n++;
    }
  return false;
}

/* ---- comparing ---- */

typedef struct verdict {
  int seen, over, unproven; /* pixels: with a surface; off by more than 1/255; of these, with no tie */
  int colourful;            /* pixels */
  int ties;                 /* of every 16th pixel */
  double most, apart, mean; /* of the others: difference of colours, and of depths, mm; mean of these */
  double shaded;            /* pairs of pixel and triangle, of the cpu's */
  int deep;                 /* of the others: with a depth */
} verdict;

/* Whether as many samples are ties as a difference of `worst` takes. */
static bool is_tie(const truth *t, const tc_rays *rays, bool layered, const tc_frame *const frames[2], int pixel, double worst) {
  int ties = 0;
  for (int s = 0; s < rays->count; s++) {
    bool tie = false, there[2] = {true, true};
    const double x = pixel % SIDE + fmin(rint((rays->of_pixel[s].x + 0.5) * 256), 255) / 256;
    const double y = pixel / SIDE + fmin(rint((rays->of_pixel[s].y + 0.5) * 256), 255) / 256;
    for (int f = 0; f < 2; f++) { /* of layers the nearest has the pixel's depth */
      const double depth = rays->count == 1 && frames[f] ? (double)frames[f]->depth[pixel] : NAN;
      tie = may_be_seen(t, pixel, x, y, depth, &there[f]) > 1;
    }
    if (layered) tie = layers_may_differ(t, pixel, x, y);
    ties += tie && there[0] && there[1]; /* each has drawn one of what may be seen */
  }
  return ties > 0 && worst <= (double)ties / rays->count + 1.0 / 255;
}

/* of: labels and meshes. other: what gl draws instead; NULL: the same. */
static verdict compare(tc_volume *volume, const tc_render_request *of, const tc_scene *scene, const tc_scene *other) {
  const tc_render_request request = {.want_linear = true, .want_depth = true, .labels = of->labels, .meshes = of->meshes};
  tc_explanation plan;
  verdict v = {0};
  const tc_frame *cpu = test_draw(test_widest(), volume, scene, &request, NULL);
  const tc_frame *gl = test_draw(GL, volume, other ? other : scene, &request, &plan);
  const tc_frame *const frames[2] = {gl, cpu}, *const none[2] = {NULL, NULL};
  v.shaded = (double)gl->stats.shaded / (double)cpu->stats.shaded;
  if (scene->mode == TC_MODE_MESH) {
    g_autofree char *said = g_strdup_printf("; %" PRIu64 " pixels shaded; what is hidden fails", gl->stats.shaded);
    assert_non_null(strstr(plan.stages[TC_STAGE_MESH].reason, said));
  }
  assert_non_null(strstr(plan.kernel, ".gl"));
  assert_null(strstr(plan.stages[TC_STAGE_MESH].reason, "drawn by the cpu"));
  truth *t = find_truth(volume, of, scene);
  tc_rays rays;
  tc_rays_set_up(&rays, volume, scene, SIDE, SIDE);
  const bool layered = scene->mesh.n_surfaces > 0;
  for (int i = 0; i < PIXELS; i++) {
    const double worst = test_pixel_off(gl->linear, cpu->linear, (size_t)i);
    int level = 0;
    for (int c = 4 * i; c < 4 * i + 4; c++) level = MAX(level, abs(gl->rgba[c] - cpu->rgba[c]));
    v.seen += cpu->linear[4 * i + 3] > 0;
    v.colourful += abs(cpu->rgba[4 * i] - cpu->rgba[4 * i + 1]) > 30;
    if (i % 16 == 0) v.ties += is_tie(t, &rays, layered, none, i, 0);
    if (worst <= 1.0 / 255 && level <= 1) {
      v.most = fmax(v.most, worst);
      if (isfinite(cpu->depth[i])) {
        const double apart = fabs((double)cpu->depth[i] - (double)gl->depth[i]);
        v.apart = fmax(v.apart, apart), v.mean += (apart - v.mean) / ++v.deep;
      }
      continue;
    }
    v.over++;
    if (is_tie(t, &rays, layered, frames, i, worst)) continue;
    if (v.unproven++ < 3)
      printf("    no tie at %d,%d: cpu %g %g %g, %g mm; gl %g %g %g, %g mm\n", i % SIDE, i / SIDE, cpu->linear[4 * i],
             cpu->linear[4 * i + 1], cpu->linear[4 * i + 2], cpu->depth[i], gl->linear[4 * i], gl->linear[4 * i + 1],
             gl->linear[4 * i + 2], gl->depth[i]);
  }
  printf("  %zu triangles, %d pixels show something: %d off by more than 1/255, of which %d are no ties; ties are possible "
         "at %.2f %%; others differ by %.1e and %.1e mm at most, %.1e mm in the mean; %.4f of the cpu's shaded\n",
         t->mesh->n_triangles, v.seen, v.over, v.unproven, 100.0 * v.ties / (PIXELS / 16), v.most, v.apart, v.mean, v.shaded);
  free_truth(t);
  return v;
}

static const tc_render_request nothing_else;

static verdict expect_equal(tc_volume *volume, const tc_render_request *of, const tc_scene *scene) {
  const verdict v = compare(volume, of, scene, NULL);
  assert_true(v.seen > PIXELS / 20 && v.unproven == 0 && v.over < PIXELS / 200);
  assert_true(v.mean < 2e-3); /* corners are rounded to a 256th of a pixel, which is some tenths of a millimetre */
  if (scene->mode == TC_MODE_MESH) assert_true(fabs(v.shaded - 1) < 0.002); /* ties */
  return v;
}

/* ---- scenes ---- */

static tc_volume *waves(void) {
  return test_volume(&(test_grid){.dims = {80, 72, 76}, .type = TC_U8, .slope = 0.004, .spacing = {1, 1.3, 0.8},
                                  .origin = {-1000, 300, 50}}, test_waves, &(double){24});
}

/* For layers, which in software are drawn one by one. */
static tc_volume *fewer_waves(void) {
  return test_volume(&(test_grid){.dims = {40, 36, 38}, .type = TC_U8, .slope = 0.004, .spacing = {2, 2.6, 1.6},
                                  .origin = {-1000, 300, 50}}, test_waves, &(double){18});
}

static void mesh_scene(tc_scene *scene, const tc_volume *volume, tc_projection projection) {
  test_scene(scene, SIDE, SIDE);
  test_scene_frame(scene, volume, projection, (double[3]){1, -0.6, 0.4});
  scene->mode = TC_MODE_MESH;
  scene->isosurface.value = 0.55;
  scene->shading.model = TC_SHADING_BLINN_PHONG;
}

TEST(pictures_are_equal_but_for_ties) {
  needs(test_renderers[GL]);
  g_autoptr(tc_volume) volume = waves();
  for (int round = 0; round < 6; round++) {
    g_auto(tc_scene) scene;
    mesh_scene(&scene, volume, round & 1 ? TC_ORTHOGRAPHIC : TC_PERSPECTIVE);
    scene.shading.model = (tc_shading_model[]){TC_SHADING_BLINN_PHONG, TC_SHADING_GOOCH, TC_SHADING_LAMBERT}[round / 2];
    if (round == 1) scene.clip.planes[0][1] = 1, scene.clip.planes[0][3] = -340, scene.clip.n_planes = 1;
    if (round == 2) {
      scene.clip.has_box = true;
      const double box[2][3] = {{-985, 320, 60}, {-940, 370, 95}};
      memcpy(scene.clip.box, box, sizeof box);
    }
    if (round == 3) scene.sampling.rays_per_pixel = 4;
    if (round == 4) /* from the inside */
      test_scene_look(&scene, TC_PERSPECTIVE, (double[3]){-960, 345, 80}, (double[3]){-900, 380, 100}, 80);
    if (round == 2) { /* two lights, one of them at the camera */
      scene.mesh.lights[0] = (tc_mesh_light){.at_camera = true, .color = {1, 0.5, 0.2}, .intensity = 0.6};
      scene.mesh.lights[1] = (tc_mesh_light){.direction = {30, -20, 10}, .color = {0.2, 0.6, 1}, .intensity = 1.2};
      scene.mesh.n_lights = 2;
    }
    if (round == 5) scene.image.linear_light = scene.image.transparent = true;
    expect_equal(volume, &nothing_else, &scene);
  }
}

/* What calls a tie a tie is no excuse: a picture that is a fiftieth of a pixel off has pixels that are none. */
TEST(another_picture_is_no_tie) {
  needs(test_renderers[GL]);
  g_autoptr(tc_volume) volume = waves();
  g_auto(tc_scene) scene, other;
  mesh_scene(&scene, volume, TC_ORTHOGRAPHIC);
  mesh_scene(&other, volume, TC_ORTHOGRAPHIC);
  other.camera.height_mm *= 1 + 0.04 / SIDE;
  const verdict v = compare(volume, &nothing_else, &scene, &other);
  assert_true(v.unproven > 10);
}

static const tc_mesh_surface clear_list[5] = {
    {.value = 0.4, .color = {0.9, 0.3, 0.2}, .opacity = 0.3, .has_color = true, .visible = true, .two_sided = true},
    {.value = 0.5, .color = {0.9, 0.9, 0.2}, .opacity = 0.4, .has_color = true, .visible = true, .two_sided = true},
    {.value = 0.6, .color = {0.2, 0.9, 0.3}, .opacity = 0.6, .has_color = true, .visible = true},
    {.value = 0.7, .color = {0.3, 0.3, 1}, .opacity = 0.5, .has_color = true, .visible = true, .two_sided = true},
    {.value = 0.8, .color = {0.8, 0.8, 1}, .opacity = 1, .has_color = true, .visible = true, .two_sided = true}};

/* Nor where samples are several or surfaces translucent: a picture that is off by parts of a pixel, that has one surface less,
 * or two whose order is wrong, has pixels that are no ties. */
TEST(other_samples_and_layers_are_no_ties) {
  needs(test_renderers[GL]);
  tc_gl_mesh_peels_in_software = true;
  g_autoptr(tc_volume) volume = fewer_waves();
  for (int round = 0; round < 6; round += STRIDE(3)) {
    g_auto(tc_scene) scene, other;
    const bool layers = round != 1;
    for (int i = 0; i < 2; i++) {
      tc_scene *s = i ? &other : &scene;
      mesh_scene(s, volume, TC_ORTHOGRAPHIC);
      s->sampling.rays_per_pixel = (int[]){1, 4, 4, 1, 1, 4}[round];
      if (layers) tc_scene_set_surfaces(s, g_memdup2(clear_list, sizeof clear_list), 5);
    }
    if (round < 3) other.camera.height_mm *= 1 + 0.2 / SIDE;
    if (round == 3) other.mesh.surfaces[3].opacity = 0.47; /* mostly behind the others */
    if (round > 3) { /* as if the two were sorted wrongly */
      const tc_mesh_surface first = other.mesh.surfaces[0];
      for (int c = 0; c < 3; c++) other.mesh.surfaces[0].color[c] = clear_list[1].color[c], other.mesh.surfaces[1].color[c] = first.color[c];
    }
    const verdict v = compare(volume, &nothing_else, &scene, &other);
    assert_true(v.unproven > 10 && v.unproven > v.over / 20);
  }
  tc_gl_mesh_peels_in_software = false;
}

TEST(translucent_layers_are_sorted) {
  needs(test_renderers[GL]);
  tc_gl_mesh_peels_in_software = true;
  g_autoptr(tc_volume) volume = fewer_waves();
  tc_scene scene;
  const tc_mesh_surface list[] = {
      {.value = 0.45, .color = {0.9, 0.3, 0.2}, .opacity = 0.3, .has_color = true, .visible = true, .two_sided = true},
      {.value = 0.6, .color = {0.2, 0.9, 0.3}, .opacity = 0.6, .has_color = true, .visible = true},
      {.value = 0.8, .color = {0.8, 0.8, 1}, .opacity = 1, .has_color = true, .visible = true, .two_sided = true}};
  for (int round = 0; round < 3; round++) {
    mesh_scene(&scene, volume, round & 1 ? TC_ORTHOGRAPHIC : TC_PERSPECTIVE);
    tc_scene_set_surfaces(&scene, g_memdup2(list, sizeof list), 3);
    if (round == 2) scene.clip.planes[0][1] = 1, scene.clip.planes[0][3] = -340, scene.clip.n_planes = 1;
    expect_equal(volume, &nothing_else, &scene);
    tc_scene_clear(&scene);
  }
  tc_gl_mesh_peels_in_software = false;
}

static double waves_with_gaps(double x, double y, double z, const void *period) {
  return (int)x % 7 == 3 && (int)y % 5 < 2 && (int)z % 6 < 3 ? NAN : test_waves(x, y, z, period);
}

/* Slices through one point, alone, before a surface, cut, through gaps, seen through, and in every type of voxels. */
TEST(slices_are_the_cpus) {
  needs(test_renderers[GL]);
  tc_gl_mesh_peels_in_software = true;
  const tc_mesh_surface list[] = {{.source = TC_SURFACE_OF_PLANE, .plane = TC_SAGITTAL, .opacity = 1, .visible = true, .two_sided = true},
                                  {.source = TC_SURFACE_OF_PLANE, .plane = TC_CORONAL, .opacity = 1, .visible = true, .two_sided = true},
                                  {.source = TC_SURFACE_OF_PLANE, .plane = TC_OBLIQUE, .opacity = 1, .visible = true, .two_sided = true},
                                  {.value = 0.8, .color = {0.8, 0.3, 1}, .opacity = 1, .has_color = true, .visible = true, .two_sided = true}};
  static const tc_voxel_type types[6] = {TC_U8, TC_I16, TC_F32, TC_U16, TC_I8, TC_F32};
  for (int round = 0; round < 6; round++) {
    const bool gaps = round == 5, translucent = round == 4;
    g_autoptr(tc_volume) volume = test_volume(
        &(test_grid){.dims = {40, 36, 38}, .type = types[round], .slope = types[round] == TC_F32 ? 1 : 0.008, .spacing = {2, 2.6, 1.6},
                     .origin = {-1000, 300, 50}}, gaps ? waves_with_gaps : test_waves, &(double){18});
    g_auto(tc_scene) scene;
    mesh_scene(&scene, volume, round & 1 ? TC_ORTHOGRAPHIC : TC_PERSPECTIVE);
    scene.window.center = 0.5, scene.window.width = 0.6;
    scene.mpr.has_center = true;
    memcpy(scene.mpr.center, (double[3]){-959.3, 348.1, 82.7}, sizeof scene.mpr.center);
    memcpy(scene.mpr.normal, (double[3]){0.3, 0.4, 0.866}, sizeof scene.mpr.normal);
    scene.sampling.rays_per_pixel = round == 3 ? 4 : 1;
    scene.image.linear_light = round == 2;
    if (round == 1) scene.clip.planes[0][1] = 1, scene.clip.planes[0][3] = -340, scene.clip.n_planes = 1;
    tc_scene_set_surfaces(&scene, g_memdup2(list, sizeof list), round ? 4 : 3);
    if (translucent) scene.mesh.surfaces[0].opacity = 0.6, scene.mesh.surfaces[2].opacity = 0.4;
    expect_equal(volume, &nothing_else, &scene);
    const tc_frame *gl = test_draw(GL, volume, &scene, &(tc_render_request){.want_linear = true}, NULL);
    int greys = 0, blacks = 0;
    for (int i = 0; i < PIXELS; i++) {
      const float *c = gl->linear + 4 * i;
      greys += c[3] > 0.99f && c[0] == c[1] && c[1] == c[2] && c[0] > 0.2f && c[0] < 0.8f;
      blacks += c[3] == 1 && c[0] == 0;
    }
    print_message("    %d grey pixels, %d black\n", greys, blacks);
    assert_true(!gl->stats.stand_in && greys > PIXELS / (translucent ? 100 : 20) && (!gaps || blacks > PIXELS / 100));
  }
  tc_gl_mesh_peels_in_software = false;
}

/* A surface and a slice, each there twice: triangles of equal depth, in the order of their numbers. */
TEST(layers_of_equal_depth_are_all_drawn) {
  needs(test_renderers[GL]);
  tc_gl_mesh_peels_in_software = true;
  g_autoptr(tc_volume) volume = fewer_waves();
  const tc_mesh_surface list[4] = {
      {.value = 0.6, .color = {0.9, 0.2, 0.1}, .opacity = 0.3, .has_color = true, .visible = true, .two_sided = true},
      {.value = 0.6, .color = {0.1, 0.3, 0.9}, .opacity = 0.5, .has_color = true, .visible = true, .two_sided = true},
      {.source = TC_SURFACE_OF_PLANE, .plane = TC_CORONAL, .opacity = 0.4, .visible = true, .two_sided = true},
      {.source = TC_SURFACE_OF_PLANE, .plane = TC_CORONAL, .opacity = 0.7, .visible = true, .two_sided = true}};
  for (int round = 0; round < 2; round++) {
    g_auto(tc_scene) scene;
    mesh_scene(&scene, volume, round ? TC_ORTHOGRAPHIC : TC_PERSPECTIVE);
    scene.sampling.rays_per_pixel = round ? 2 : 1;
    tc_scene_set_surfaces(&scene, g_memdup2(list, sizeof list), 4);
    expect_equal(volume, &nothing_else, &scene);
  }
  tc_gl_mesh_peels_in_software = false;
}

/* Four surfaces, each of which a ray meets several times, by 4 and 8 samples a pixel. */
TEST(translucent_layers_of_several_samples_are_sorted) {
  needs(test_renderers[GL]);
  g_autoptr(tc_volume) volume = fewer_waves();
  for (int round = 0; round < 2; round += STRIDE(2)) {
    g_auto(tc_scene) scene;
    mesh_scene(&scene, volume, round ? TC_ORTHOGRAPHIC : TC_PERSPECTIVE);
    scene.sampling.rays_per_pixel = round ? 8 : 4;
    tc_scene_set_surfaces(&scene, g_memdup2(clear_list, sizeof clear_list), 5 - (size_t)round); /* the last is opaque, or there is none */
    tc_gl_mesh_peels_in_software = true;
    expect_equal(volume, &nothing_else, &scene);
    tc_explanation plan;
    tc_gl_mesh_peels_in_software = false; /* as the service has it: on a GPU gl, in software the cpu */
    const bool by_cpu = test_draw(GL, volume, &scene, NULL, &plan)->stats.stand_in;
    assert_true(by_cpu == (strstr(plan.stages[TC_STAGE_MESH].reason, "drawn by the cpu: OpenGL in software would") != NULL));
  }
}

static double ball(double x, double y, double z, const void *unused) {
  const double r = 8.3, p = (x - 12) * (x - 12), q = (x - 26) * (x - 26), s = (y - 20) * (y - 20) + (z - 20) * (z - 20);
  return p + s < r * r ? 3 : q + s < r * r ? 7 : 0;
}

/* A mesh that no buffer holds is refused in words. */
TEST(a_mesh_too_large_for_a_buffer_is_refused) {
  if (!test_renderers[GL]) return;
  const double period = 24;
  g_autoptr(tc_volume) volume =
      test_volume(&(test_grid){.dims = {30, 30, 30}, .type = TC_U8, .slope = 0.004}, test_waves, &period);
  g_auto(tc_scene) scene;
  GError *error = NULL;
  mesh_scene(&scene, volume, TC_PERSPECTIVE);
  tc_gl_mesh_most_bytes = 1000;
  assert_false(tc_render(test_renderers[GL], volume, &scene, NULL, &test_frames[GL], &error));
  tc_gl_mesh_most_bytes = 0;
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_LIMIT) && strstr(error->message, "--backend cpu"));
  g_clear_error(&error);
  assert_true(tc_render(test_renderers[GL], volume, &scene, NULL, &test_frames[GL], NULL));
}

TEST(labels_have_their_colours) {
  needs(test_renderers[GL]);
  g_autoptr(tc_volume) labels = test_volume(&(test_grid){.dims = {40, 40, 40}, .type = TC_U8}, ball, NULL);
  g_auto(tc_scene) scene;
  mesh_scene(&scene, labels, TC_PERSPECTIVE);
  test_scene_look(&scene, TC_ORTHOGRAPHIC, (double[3]){20, -50, 20}, (double[3]){20, 20, 20}, 40);
  strcpy(scene.labels.volume, "balls");
  scene.labels.opacity = 0.25;
  expect_equal(labels, &(tc_render_request){.labels = labels}, &scene);
}

/* Of several parts only one has colours, and another look; one and several samples. */
TEST(colours_of_vertices_are_the_cpus) {
  needs(test_renderers[GL]);
  g_autoptr(tc_volume) volume = waves();
  g_autoptr(tc_mesh) mesh = tc_mesh_extract(volume, 0.6, &(tc_mesh_options){.normals = true}, NULL);
  assert_true(tc_mesh_add_colors(mesh, NULL));
  for (size_t v = 0; v < mesh->n_vertices; v++) mesh->colors[v] = (uint32_t)v * 0x9e3779b1u >> 8; /* noise */
  const tc_mesh_surface list[2] = {{.value = 0.4, .color = {0.8, 0.8, 1}, .opacity = 1, .has_color = true, .visible = true, .two_sided = true},
                                   {.source = TC_SURFACE_OF_MESH, .opacity = 1, .visible = true, .two_sided = true}};
  tc_mesh *const meshes[2] = {NULL, mesh};
  const tc_render_request request = {.meshes = meshes}, one = {.meshes = meshes + 1};
  for (int round = 0; round < 3; round++) {
    g_auto(tc_scene) scene;
    mesh_scene(&scene, volume, round == 1 ? TC_ORTHOGRAPHIC : TC_PERSPECTIVE);
    scene.sampling.rays_per_pixel = round == 2 ? 4 : 1, scene.image.linear_light = round == 1;
    tc_scene_set_surfaces(&scene, g_memdup2(list + (round == 0), (round ? 2 : 1) * sizeof *list), round ? 2 : 1);
    const verdict v = expect_equal(volume, round ? &request : &one, &scene);
    print_message("  %d of %d pixels colourful\n", v.colourful, v.seen);
    assert_true(v.colourful > v.seen / 5);
  }
}

/* Surfaces within the volume, in dvr and mip: gl casts the rays' parts, and gives the cpu's picture. */
TEST(surfaces_within_a_volume_are_the_cpus) {
  needs(test_renderers[GL]);
  g_autoptr(tc_volume) volume = waves();
  const tc_mesh_surface list[] = {
      {.value = 0.45, .color = {0.9, 0.3, 0.2}, .opacity = 0.3, .has_color = true, .visible = true, .two_sided = true},
      {.value = 0.7, .color = {0.8, 0.8, 1}, .opacity = 1, .has_color = true, .visible = true, .two_sided = true}};
  const tc_knot fog[2] = {{0, {0.2, 0.4, 0.6}, 0.002}, {1, {0.9, 0.4, 0.1}, 0.05}};
  for (int round = 0; round < 3; round++) {
    g_auto(tc_scene) scene;
    mesh_scene(&scene, volume, round == 1 ? TC_ORTHOGRAPHIC : TC_PERSPECTIVE);
    scene.mode = round == 1 ? TC_MODE_MIP : TC_MODE_DVR;
    scene.window.center = 0.5, scene.window.width = 1;
    scene.sampling.rays_per_pixel = round == 2 ? 2 : 1;
    test_scene_knots(&scene, TC_KNOT_EXTINCTION, fog, 2);
    tc_scene_set_surfaces(&scene, g_memdup2(list, sizeof list), 2);
    scene.mesh.with_volume = true;
    expect_equal(volume, &nothing_else, &scene);
    if (round == 0) assert_true(test_resumes(GL, volume, &scene) >= 2);
  }
}

TEST(frames_stop_and_go_on_to_the_same_picture) {
  needs(test_renderers[GL]);
  g_autoptr(tc_volume) volume = waves();
  g_auto(tc_scene) scene;
  mesh_scene(&scene, volume, TC_PERSPECTIVE);
  /* At least three tiles: a GPU draws up to 1024x1024 pixels as one. */
  if (!strstr(tc_renderer_about(test_renderers[GL])->device, "llvmpipe")) scene.image.width = scene.image.height = 1536;
  assert_true(test_resumes(GL, volume, &scene) >= 2);
}

TESTS(test_renderers_open, test_renderers_close)
