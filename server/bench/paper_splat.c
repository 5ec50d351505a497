#include "server/bench/paper_splat.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include "renderer/export/export.h"
#include "renderer/splat/vmd.h"
#include "server/cli/cli.h"

/* Bytes of a full grid ("standard way") and of a .vmd; milliseconds without and with culling. */
static const struct published {
  const char *object;
  double standard, vmd, unculled, culled;
} published[] = {
    {"chest", 8411000, 382318, 8.4, 1.9}, {"tibia", 72457, 36220, 3.4, 1.1}, {"skull", 122600, 56487, 4.1, 1.3}};

#define ZOOM 1.3
static const double azimuths[] = {0, 60, 120, 180, 240, 300}; /* Table 2 gives means */

/* Bytes of an object in several representations, with one byte per voxel (like a palette index). */
typedef struct sizes {
  double grid, box, grid_gzip, nrrd;   /* one byte per voxel of the volume; of the bounding box; compressed */
  double vmd, vmd_gzip, memory, shell; /* shell: in memory, without invisible voxels */
  double voxels;
} sizes;

/* Where the object is: its first voxel along each axis, and how many there are. */
typedef struct extent {
  int first[3], size[3];
} extent;

static extent extent_of(const tc_vmd *m) {
  int z0 = m->head.grid.dims[2], z1 = 0;
  for (int y = m->first[1]; y < m->first[1] + m->size[1]; y++)
    for (int x = m->first[0]; x < m->first[0] + m->size[0]; x++)
      for (tc_vmd_run run = {.at = tc_vmd_column(m, x, y)}; tc_vmd_next(m, &run);)
        z0 = MIN(z0, run.z), z1 = MAX(z1, run.z + run.count);
  return (extent){{m->first[0], m->first[1], z0}, {m->size[0], m->size[1], MAX(z1 - z0, 0)}};
}

/* The object as a grid of ones. */
static uint8_t *grid_of(const tc_vmd *m, size_t *bytes) {
  const int *n = m->head.grid.dims;
  *bytes = (size_t)n[0] * (size_t)n[1] * (size_t)n[2];
  uint8_t *grid = g_try_malloc0(*bytes);
  for (int y = 0; y < n[1] && grid; y++)
    for (int x = 0; x < n[0]; x++)
      for (tc_vmd_run run = {.at = tc_vmd_column(m, x, y)}; tc_vmd_next(m, &run);)
        for (int z = run.z; z < run.z + run.count; z++)
          grid[((size_t)z * (size_t)n[1] + (size_t)y) * (size_t)n[0] + (size_t)x] = 1;
  return grid;
}

/* Size of the grid as a compressed NRRD file; 0 with *error. */
static double nrrd_bytes(const tc_vmd *m, const uint8_t *grid, size_t bytes, GError **error) {
  char *folder = g_dir_make_tmp("tomocast-XXXXXX", error),
       *path = folder ? g_build_filename(folder, "grid.nrrd", NULL) : NULL;
  tc_volume_desc desc = m->head.grid;
  desc.type = TC_U8, desc.slope = 1, desc.intercept = 0;
  tc_volume *volume = path ? tc_volume_new(&desc, error) : NULL;
  struct stat file = {0};
  if (volume) {
    memcpy(tc_volume_voxels(volume), grid, bytes);
    tc_volume_seal(volume);
    if (tc_export_volume(volume, path, true, error)) stat(path, &file);
  }
  tc_volume_unref(volume);
  if (path) unlink(path);
  if (folder) rmdir(folder);
  g_free(path);
  g_free(folder);
  return (double)file.st_size;
}

static bool measure_shell(const tc_volume *volume, tc_vmd_options options, sizes *s, GError **error) {
  options.shell = true;
  tc_vmd *shell = tc_vmd_of_volume(volume, &options, NULL, error);
  if (shell) s->shell = (double)shell->total_bytes;
  tc_vmd_free(shell);
  return shell != NULL;
}

static bool measure_sizes(const tc_vmd *m, sizes *s, GError **error) {
  size_t bytes;
  const extent box = extent_of(m);
  uint8_t *grid = grid_of(m, &bytes);
  uLongf packed = compressBound(bytes);
  uint8_t *to = g_try_malloc(packed);
  GByteArray *plain = tc_vmd_encode(m, false, error), *zipped = plain ? tc_vmd_encode(m, true, error) : NULL;
  bool good = zipped && grid && to && compress2(to, &packed, grid, bytes, 6) == Z_OK;
  if (good) good = (s->nrrd = nrrd_bytes(m, grid, bytes, error)) > 0;
  if (good) {
    s->box = (double)box.size[0] * box.size[1] * box.size[2];
    s->grid = (double)bytes, s->grid_gzip = (double)packed;
    s->vmd = plain->len, s->vmd_gzip = zipped->len;
    s->memory = (double)m->total_bytes, s->voxels = (double)m->voxels;
  } else if (!*error) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "out of memory");
  }
  if (plain) g_byte_array_unref(plain);
  if (zipped) g_byte_array_unref(zipped);
  g_free(grid);
  g_free(to);
  return good;
}

/* A view that the object's bounding sphere fills at zoom 1: the model is the object, whatever the volume around it. */
static void look_at(const tc_volume *volume, const extent *box, double azimuth, tc_camera *camera) {
  double corner[3], middle[3], square = 0, distance = 0;
  for (int k = 0; k < 3; k++) corner[k] = box->first[k] - 0.5, middle[k] = corner[k] + 0.5 * box->size[k];
  tc_volume_index_to_lps(volume, middle, camera->target);
  tc_volume_index_to_lps(volume, corner, middle);
  tcs_cli_place_camera(volume, azimuth, 10, 1, camera);
  for (int k = 0; k < 3; k++) {
    square += pow(middle[k] - camera->target[k], 2);
    distance += pow(camera->position[k] - camera->target[k], 2);
  }
  camera->fov_y_deg = 2 * asin(sqrt(square / distance)) * 180 / M_PI / ZOOM;
}

/* Means over the views of the shortest frame without culling, with culling and ray-cast, taken in turn; and of the
 * splats (or samples) drawn. The ratio of the first two bounds the gain of culling if every splat costs the same.
 *
 * The paper's original splatting applies the kernel to every voxel of the model and adds it to the picture in its
 * palette's colour. So does splat.culling false here, for interior voxels too, with the same kernel, colours that are
 * looked up voxel by voxel, and light pixel by pixel; unlike the paper's it goes through all voxels twice, since a pixel
 * shows what lies within a kernel's depth of its nearest voxel. */
static bool measure_times(const tcs_paper_run *run, tc_volume *volume, const tc_scene *from, const extent *box,
                          double ms[3], double samples[3], GError **error) {
  const tc_renderer_options options = {.backend = TC_BACKEND_CPU, .threads = run->threads, .cache_bytes = 2u << 30};
  tc_renderer *renderer = tc_renderer_new(&options, error);
  tc_frame frame = {0};
  tc_scene scene;
  bool good = renderer != NULL;
  tc_scene_copy(&scene, from);
  if (!scene.splat.attribute[0]) g_strlcpy(scene.splat.attribute, "value", sizeof scene.splat.attribute);
  scene.image.width = scene.image.height = run->size;
  memset(ms, 0, 3 * sizeof *ms);
  memset(samples, 0, 3 * sizeof *samples);
  for (size_t v = 0; v < G_N_ELEMENTS(azimuths) && good; v++) {
    double least[3] = {INFINITY, INFINITY, INFINITY};
    look_at(volume, box, azimuths[v], &scene.camera);
    for (int i = 0; i < 3 * (run->runs + 1) && good; i++) {
      scene.mode = i % 3 < 2 ? TC_MODE_SPLAT : TC_MODE_ISOSURFACE;
      scene.splat.culling = i % 3 == 1;
      good = tc_render(renderer, volume, &scene, NULL, &frame, error);
      if (i >= 3) least[i % 3] = fmin(least[i % 3], frame.stats.render_ms);
      if (i < 3) samples[i] += (double)frame.stats.samples / G_N_ELEMENTS(azimuths);
    }
    for (int i = 0; i < 3; i++) ms[i] += least[i] / G_N_ELEMENTS(azimuths);
  }
  tc_frame_finish(&frame);
  tc_scene_clear(&scene);
  tc_renderer_free(renderer);
  return good;
}

void tcs_paper_splat_begin(const tcs_paper_run *run) {
  if (!run->print) return;
  printf("paper 004: a byte for each voxel; a grid of its bounding box (box) over a .vmd on disk and in memory, as a "
         "solid "
         "and as a shell; %dx%d pixels\n%-15s %8s %9s %7s %8s %8s %8s %8s %7s %7s %7s %8s %8s %6s %8s %6s\n",
         run->size, run->size, "object", "voxels", "box", "grid.gz", "nrrd.gz", "vmd", "vmd.gz", "memory", "box/vmd",
         "box/mem", "/shell", "unculled", "culled", "gain", "ray-cast", "put");
  for (size_t i = 0; i < G_N_ELEMENTS(published); i++) {
    const struct published *p = &published[i];
    printf("paper: %-8s %8s %9.0f %7s %8s %8.0f %8s %8s %7.1f %7.1f %7s %8.1f %8.1f %6.1f\n", p->object, "",
           p->standard, "", "", p->vmd, "", "", p->standard / p->vmd, p->standard / p->vmd, "", p->unculled, p->culled,
           p->unculled / p->culled);
  }
}

bool tcs_paper_splat(const tcs_paper_run *run, tc_volume *volume, const char *name, const tc_scene *from, cJSON *report,
                     GError **error) {
  const tc_vmd_options options = {from->splat.threshold[0], from->splat.threshold[1], .attributes = "user"};
  tc_scene scene;
  sizes s = {0};
  double ms[3], samples[3];
  tc_vmd *model = tc_vmd_of_volume(volume, &options, NULL, error);
  bool good = model && measure_sizes(model, &s, error) && measure_shell(volume, options, &s, error);
  const extent box = good ? extent_of(model) : (extent){0};
  tc_vmd_free(model);
  tc_scene_copy(&scene, from);
  scene.isosurface.value = scene.splat.threshold[0];
  good = good && measure_times(run, volume, &scene, &box, ms, samples, error);
  tc_scene_clear(&scene);
  if (!good) return false;
  if (run->print)
    printf("%-15.15s %8.0f %9.0f %7.0f %8.0f %8.0f %8.0f %8.0f %7.1f %7.1f %7.1f %8.2f %8.2f %6.1f %8.2f %6.1f\n", name,
           s.voxels, s.box, s.grid_gzip, s.nrrd, s.vmd, s.vmd_gzip, s.memory, s.box / s.vmd, s.box / s.memory,
           s.box / s.shell, ms[0], ms[1], ms[0] / ms[1], ms[2], samples[0] / samples[1]);
  const struct {
    const char *name;
    double value;
  } numbers[] = {{"voxels", s.voxels},           {"gridBytes", s.grid},       {"boxBytes", s.box},
                 {"gridGzipBytes", s.grid_gzip}, {"vmdBytes", s.vmd},         {"vmdGzipBytes", s.vmd_gzip},
                 {"memoryBytes", s.memory},      {"unculledMs", ms[0]},       {"culledMs", ms[1]},
                 {"isosurfaceMs", ms[2]},        {"nrrdGzipBytes", s.nrrd},   {"shellMemoryBytes", s.shell},
                 {"unculledSplats", samples[0]}, {"culledSplats", samples[1]}};
  cJSON *json = cJSON_CreateObject();
  cJSON_AddStringToObject(json, "paper", "004");
  cJSON_AddStringToObject(json, "volume", name);
  for (size_t i = 0; i < G_N_ELEMENTS(numbers); i++) cJSON_AddNumberToObject(json, numbers[i].name, numbers[i].value);
  cJSON_AddItemToArray(report, json);
  return true;
}
