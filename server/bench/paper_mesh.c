#include "server/bench/paper_mesh.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "renderer/mesh/measure.h"
#include "server/bench/timing.h"
#include "server/cli/cli.h"

static const struct way {
  const char *name, *isa;
  tc_backend backend;
  int threads; /* 0: those of the run */
  tc_mode mode;
  bool forward;
} ways[] = {{"scalar, 1 thread", "scalar", TC_BACKEND_CPU, 1, TC_MODE_MESH},
            {"avx2, 1 thread", "avx2", TC_BACKEND_CPU, 1, TC_MODE_MESH},
            {"avx512, 1 thread", "avx512", TC_BACKEND_CPU, 1, TC_MODE_MESH},
            {"mesh", NULL, TC_BACKEND_CPU, 0, TC_MODE_MESH},
            {"forward shading", NULL, TC_BACKEND_CPU, 0, TC_MODE_MESH, true},
            {"ray-cast", NULL, TC_BACKEND_CPU, 0, TC_MODE_ISOSURFACE},
            {"gl", NULL, TC_BACKEND_GL, 0, TC_MODE_MESH}};
enum { WAYS = G_N_ELEMENTS(ways) };

/* The paper's grid, centred in the volume: the volume's width, and at most its height. */
static tc_volume *resample(const tc_volume *from, GError **error) {
  static const int dims[3] = {512, 512, 106};
  const tc_volume_desc *d = tc_volume_describe(from);
  tc_volume_desc to = *d;
  double step[3], first[3];
  for (int k = 0; k < 3; k++) {
    const double extent = d->dims[k] - 1;
    to.dims[k] = dims[k];
    step[k] = k < 2 ? extent / (dims[k] - 1) : fmin(2 / d->spacing[k], extent / (dims[k] - 1));
    first[k] = 0.5 * (extent - step[k] * (dims[k] - 1));
    to.spacing[k] = d->spacing[k] * step[k];
  }
  to.type = TC_I16, to.slope = 1, to.intercept = 0;
  tc_volume_index_to_lps(from, first, to.origin);
  tc_volume *volume = tc_volume_new(&to, error);
  int16_t *voxel = volume ? tc_volume_voxels(volume) : NULL;
  for (int z = 0; volume && z < dims[2]; z++)
    for (int y = 0; y < dims[1]; y++)
      for (int x = 0; x < dims[0]; x++) {
        const double at[3] = {first[0] + x * step[0], first[1] + y * step[1], first[2] + z * step[2]};
        double value = 0;
        *voxel++ = tc_volume_value_at(from, at, &value) ? (int16_t)CLAMP(lrint(value), -32768, 32767) : -32768;
      }
  if (volume) tc_volume_seal(volume);
  return volume;
}

typedef struct drawn {
  double extract_ms[2]; /* with one thread, with all threads */
  size_t triangles;
  double ms[WAYS];        /* NaN: not available on this machine */
  double build_ms;        /* building mesh and clusters */
  uint64_t covered, seen; /* pixels covered by all front-facing triangles, counted separately; visible pixels */
  uint64_t shaded_forward;
} drawn;

/* The shortest of several extractions, with one thread or all. */
static bool extract(const tcs_paper_run *run, const tc_volume *volume, double iso, bool all, drawn *d, GError **error) {
  tc_pool *pool = tc_pool_new(all ? run->threads : 1, error);
  const tc_mesh_options options = {.normals = true, .pool = pool};
  bool good = pool != NULL;
  d->extract_ms[all] = INFINITY;
  for (int i = 0; i < run->runs && good; i++) {
    const double start = tcs_now_ms();
    tc_mesh *mesh = tc_mesh_extract(volume, iso, &options, error);
    d->extract_ms[all] = fmin(d->extract_ms[all], tcs_now_ms() - start);
    if ((good = mesh != NULL)) d->triangles = mesh->n_triangles;
    tc_mesh_free(mesh);
  }
  tc_pool_free(pool);
  return good;
}

static void take_in(drawn *d, const struct way *way, const tc_frame_stats *stats) {
  if (way->forward) {
    d->covered = stats->samples, d->shaded_forward = stats->gradients;
  } else if (!strcmp(way->name, "mesh")) {
    d->seen = stats->gradients ? stats->gradients : 1;
    if (stats->tables_ms > 0) d->build_ms = stats->tables_ms;
  }
}

/* The shortest frame of each way, taken in turn. */
static bool draw(const tcs_paper_run *run, tc_volume *volume, tc_scene *scene, drawn *d, GError **error) {
  tc_renderer *renderers[WAYS] = {0};
  tc_frame frame = {0};
  bool good = true;
  for (int w = 0; w < WAYS; w++) {
    const tc_renderer_options options = {.backend = ways[w].backend,
                                         .isa = ways[w].isa,
                                         .cache_bytes = 2u << 30,
                                         .threads = ways[w].threads ? ways[w].threads : run->threads};
    d->ms[w] = NAN;
    if (ways[w].backend != TC_BACKEND_GL || run->gl) renderers[w] = tc_renderer_new(&options, NULL);
  }
  for (int i = 0; i <= run->runs && good; i++)
    for (int w = 0; w < WAYS && good; w++) {
      scene->mode = ways[w].mode;
      if (!renderers[w]) continue;
      const tc_render_request request = {.forward = ways[w].forward};
      good = tc_render(renderers[w], volume, scene, &request, &frame, error);
      if (i) d->ms[w] = fmin(d->ms[w], frame.stats.render_ms);
      take_in(d, &ways[w], &frame.stats);
    }
  tc_frame_finish(&frame);
  for (int w = 0; w < WAYS; w++) tc_renderer_free(renderers[w]);
  return good;
}

static cJSON *camera_json(const tc_camera *camera) {
  cJSON *json = cJSON_CreateObject();
  cJSON_AddItemToObject(json, "position", cJSON_CreateDoubleArray(camera->position, 3));
  cJSON_AddItemToObject(json, "target", cJSON_CreateDoubleArray(camera->target, 3));
  cJSON_AddItemToObject(json, "up", cJSON_CreateDoubleArray(camera->up, 3));
  cJSON_AddNumberToObject(json, "fovY", camera->fov_y_deg);
  return json;
}

static void add(const tcs_paper_run *run, const char *name, const tc_scene *scene, const drawn *d, cJSON *report) {
  const double iso = scene->isosurface.value;
  const double layers = (double)d->covered / (double)d->seen, shaded = (double)d->shaded_forward / (double)d->seen;
  cJSON *json = cJSON_CreateObject(), *frames = cJSON_CreateObject();
  cJSON_AddStringToObject(json, "paper", "003");
  cJSON_AddStringToObject(json, "volume", name);
  cJSON_AddNumberToObject(json, "value", iso);
  cJSON_AddNumberToObject(json, "triangles", (double)d->triangles);
  cJSON_AddItemToObject(json, "extractMs", cJSON_CreateDoubleArray(d->extract_ms, 2));
  cJSON_AddNumberToObject(json, "buildMs", d->build_ms);
  for (int w = 0; w < WAYS; w++) cJSON_AddNumberToObject(frames, ways[w].name, d->ms[w]);
  cJSON_AddItemToObject(json, "frameMs", frames);
  cJSON_AddItemToObject(json, "camera", camera_json(&scene->camera));
  cJSON_AddNumberToObject(json, "layers", layers);
  cJSON_AddNumberToObject(json, "shadedForward", shaded);
  cJSON_AddItemToArray(report, json);
  if (!run->print) return;
  printf("paper 003: %s as 512x512x106 voxels, surface at %g: %zu triangles; %dx%d pixels\n", name, iso, d->triangles,
         run->size, run->size);
  printf("  %-22s %9.2f ms, %.2f with 1 thread; with clusters %.2f\n", "extraction", d->extract_ms[1], d->extract_ms[0],
         d->build_ms);
  for (int w = 0; w < WAYS; w++)
    if (!isnan(d->ms[w])) printf("  %-22s %9.2f ms a frame\n", ways[w].name, d->ms[w]);
  printf("  a pixel has %.1f triangles behind each other; mesh shades one of them, forward shading %.2f\n", layers,
         shaded);
}

bool tcs_paper_mesh(const tcs_paper_run *run, tc_volume *from, const char *name, const tc_scene *given, cJSON *report,
                    GError **error) {
  tc_scene scene;
  drawn drawn = {.seen = 1};
  tc_volume *volume = resample(from, error);
  if (!volume) return false;
  tc_scene_copy(&scene, given);
  scene.image.width = scene.image.height = run->size;
  if (scene.shading.model == TC_SHADING_NONE) scene.shading.model = TC_SHADING_LAMBERT; /* as in the paper */
  const double iso = scene.isosurface.value;
  const bool good = extract(run, volume, iso, false, &drawn, error) &&
                    extract(run, volume, iso, true, &drawn, error) &&
                    draw(run, volume, &scene, &drawn, error);
  if (good) add(run, name, &scene, &drawn, report);
  tc_scene_clear(&scene);
  tc_volume_unref(volume);
  return good;
}
