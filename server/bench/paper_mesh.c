#include "server/bench/paper_mesh.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "renderer/frame/mesh_job.h"
#include "renderer/mesh/measure.h"
#include "server/bench/timing.h"
#include "server/cli/cli.h"

static const struct way {
  const char *name, *isa;
  tc_backend backend;
  int threads; /* 0: the run's */
  tc_mode mode;
} ways[] = {{"scalar, 1 thread", "scalar", TC_BACKEND_CPU, 1, TC_MODE_MESH},
            {"avx2, 1 thread", "avx2", TC_BACKEND_CPU, 1, TC_MODE_MESH},
            {"avx512, 1 thread", "avx512", TC_BACKEND_CPU, 1, TC_MODE_MESH},
            {"mesh", NULL, TC_BACKEND_CPU, 0, TC_MODE_MESH},
            {"ray-cast", NULL, TC_BACKEND_CPU, 0, TC_MODE_ISOSURFACE},
            {"gl", NULL, TC_BACKEND_GL, 0, TC_MODE_MESH}};
enum { WAYS = G_N_ELEMENTS(ways) };

/* The paper's grid about the middle of a volume: as wide as it is, and at most as high. */
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

/* The least time of several extractions; *triangles of one. */
static bool extract(const tcs_paper_run *run, const tc_volume *volume, double iso, int threads, double *ms,
                    size_t *triangles, GError **error) {
  tc_pool *pool = tc_pool_new(threads, error);
  const tc_mesh_options options = {.normals = true, .pool = pool};
  bool good = pool != NULL;
  *ms = INFINITY;
  for (int i = 0; i < run->runs && good; i++) {
    const double start = tcs_now_ms();
    tc_mesh *mesh = tc_mesh_extract(volume, iso, &options, error);
    *ms = fmin(*ms, tcs_now_ms() - start);
    if ((good = mesh != NULL)) *triangles = mesh->n_triangles;
    tc_mesh_free(mesh);
  }
  tc_pool_free(pool);
  return good;
}

/* The least times of frames, all ways in turn; NaN where there is no such machine. *build_ms: of mesh and clusters. */
static bool draw(const tcs_paper_run *run, tc_volume *volume, tc_scene *scene, double ms[WAYS], double *build_ms,
                 GError **error) {
  tc_renderer *renderers[WAYS] = {0};
  tc_frame frame = {0};
  bool good = true;
  for (int w = 0; w < WAYS; w++) {
    const tc_renderer_options options = {.backend = ways[w].backend,
                                         .isa = ways[w].isa,
                                         .cache_bytes = 2u << 30,
                                         .threads = ways[w].threads ? ways[w].threads : run->threads};
    ms[w] = NAN;
    if (ways[w].backend != TC_BACKEND_GL || run->gl) renderers[w] = tc_renderer_new(&options, NULL);
  }
  for (int i = 0; i <= run->runs && good; i++)
    for (int w = 0; w < WAYS && good; w++) {
      scene->mode = ways[w].mode;
      if (!renderers[w]) continue;
      good = tc_render(renderers[w], volume, scene, NULL, &frame, NULL, error);
      if (i) ms[w] = fmin(ms[w], frame.stats.render_ms);
      if (!i && !strcmp(ways[w].name, "mesh")) *build_ms = frame.stats.tables_ms;
    }
  tc_frame_finish(&frame);
  for (int w = 0; w < WAYS; w++) tc_renderer_free(renderers[w]);
  return good;
}

/* Deferred and forward shading by the same code: [2] of each. */
typedef struct shading {
  double ms[2], shaded[2]; /* pixels that were shaded, for one that is seen */
  double layers;           /* surfaces behind a pixel that is seen: what forward shading's order of triangles meets */
} shading;

static void drop_tile(void *user, const tc_raster_picture *picture) {}

static bool shade(const tcs_paper_run *run, const tc_frame_job *job, tc_pool *pool, shading *s, GError **error) {
  tc_mesh_job mesh;
  tc_raster_counts counts[2];
  bool good = tc_mesh_job_begin(&mesh, job, error);
  if (!good) return false;
  mesh.raster.kernels = tc_raster_kernels_named(job->isa), mesh.raster.emit = drop_tile, mesh.raster.pool = pool;
  s->ms[0] = s->ms[1] = INFINITY;
  for (int i = 0; i < 2 * run->runs && good; i++) {
    mesh.raster.forward = i & 1;
    counts[i & 1] = (tc_raster_counts){0};
    const double start = tcs_now_ms();
    good = tc_raster_draw(&mesh.raster, &counts[i & 1], error);
    s->ms[i & 1] = fmin(s->ms[i & 1], tcs_now_ms() - start);
  }
  const double seen = fmax(1, (double)counts[0].shaded);
  for (int k = 0; k < 2; k++) s->shaded[k] = (double)counts[k].shaded / seen;
  s->layers = (double)counts[1].covered / seen;
  tc_mesh_job_end(&mesh);
  return good;
}

static bool compare_shading(const tcs_paper_run *run, tc_volume *volume, tc_scene *scene, shading *s, GError **error) {
  tc_frame frame = {.width = scene->image.width, .height = scene->image.height};
  tc_pool *pool = tc_pool_new(run->threads, error);
  tc_mesh *mesh =
      pool ? tc_mesh_extract(volume, scene->isosurface.value, &(tc_mesh_options){.normals = true, .pool = pool}, error)
           : NULL;
  tc_clusters *clusters = mesh ? tc_clusters_make(mesh, pool, NULL, error) : NULL;
  const char *isa = __builtin_cpu_supports("avx512bw") ? "avx512" : __builtin_cpu_supports("avx2") ? "avx2" : "scalar";
  tc_plan plan;
  tc_rays rays;
  scene->mode = TC_MODE_MESH;
  tc_plan_make(volume, scene, NULL, &plan);
  tc_rays_set_up(&rays, volume, scene, frame.width, frame.height);
  const tc_frame_job job = {.plan = &plan,
                            .key = plan.key,
                            .scene = scene,
                            .volume = volume,
                            .source = volume,
                            .rays = &rays,
                            .have.mesh = clusters,
                            .isa = isa,
                            .frame = &frame};
  const bool good = clusters && shade(run, &job, pool, s, error);
  tc_clusters_free(clusters);
  tc_mesh_free(mesh);
  tc_pool_free(pool);
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

static void add(const tcs_paper_run *run, const char *name, double iso, size_t triangles, const double extract_ms[2],
                double build_ms, const double ms[WAYS], const shading *s, const tc_camera *camera, cJSON *report) {
  cJSON *json = cJSON_CreateObject(), *frames = cJSON_CreateObject();
  cJSON_AddStringToObject(json, "paper", "003");
  cJSON_AddStringToObject(json, "volume", name);
  cJSON_AddNumberToObject(json, "value", iso);
  cJSON_AddNumberToObject(json, "triangles", (double)triangles);
  cJSON_AddItemToObject(json, "extractMs", cJSON_CreateDoubleArray(extract_ms, 2));
  cJSON_AddNumberToObject(json, "buildMs", build_ms);
  for (int w = 0; w < WAYS; w++) cJSON_AddNumberToObject(frames, ways[w].name, ms[w]);
  cJSON_AddItemToObject(json, "frameMs", frames);
  cJSON_AddItemToObject(json, "camera", camera_json(camera));
  cJSON_AddNumberToObject(json, "deferredMs", s->ms[0]);
  cJSON_AddNumberToObject(json, "forwardMs", s->ms[1]);
  cJSON_AddNumberToObject(json, "forwardShaded", s->shaded[1]);
  cJSON_AddNumberToObject(json, "layers", s->layers);
  cJSON_AddItemToArray(report, json);
  if (!run->print) return;
  printf("paper 003: %s as 512x512x106 voxels, surface at %g: %zu triangles; %dx%d pixels\n", name, iso, triangles,
         run->size, run->size);
  printf("  %-22s %9.2f ms, %.2f with 1 thread; with clusters %.2f\n", "extraction", extract_ms[1], extract_ms[0],
         build_ms);
  for (int w = 0; w < WAYS; w++)
    if (!isnan(ms[w])) printf("  %-22s %9.2f ms a frame\n", ways[w].name, ms[w]);
  printf("  %-22s %9.2f ms, forward %.2f (%.2f times): %.1f layers behind a pixel, which is shaded %.2f times\n",
         "deferred shading", s->ms[0], s->ms[1], s->ms[1] / s->ms[0], s->layers, s->shaded[1]);
}

bool tcs_paper_mesh(const tcs_paper_run *run, tc_volume *from, const char *name, const tc_scene *given, cJSON *report,
                    GError **error) {
  double extract_ms[2], build_ms = 0, ms[WAYS];
  size_t triangles = 0;
  tc_scene scene;
  shading shaded;
  tc_volume *volume = resample(from, error);
  if (!volume) return false;
  tc_scene_copy(&scene, given);
  scene.image.width = scene.image.height = run->size;
  const double iso = scene.isosurface.value;
  const bool good = extract(run, volume, iso, 1, &extract_ms[0], &triangles, error) &&
                    extract(run, volume, iso, run->threads, &extract_ms[1], &triangles, error) &&
                    draw(run, volume, &scene, ms, &build_ms, error) &&
                    compare_shading(run, volume, &scene, &shaded, error);
  if (good) add(run, name, iso, triangles, extract_ms, build_ms, ms, &shaded, &scene.camera, report);
  tc_scene_clear(&scene);
  tc_volume_unref(volume);
  return good;
}
