/* Generated demo volumes, deterministic, so that everything runs without any file. */
#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/base/pool.h"
#include "renderer/volume/demo.h"
#include "renderer/volume/demo_shapes.h"

/* Progress callback, called on the caller's thread. */
typedef struct asker {
  bool (*goes_on)(void *user, double fraction); /* or NULL */
  void *user;
} asker;

/* Slices are computed in float, then stored in the volume's type. */
typedef struct demo_job {
  tc_volume *volume;
  const tc_volume_desc *desc;
  void (*fill)(const struct demo_job *job, int z, float *slice);
  const tc_shape *shapes;
  int n_shapes;
  float background, noise; /* in the volume's unit: value before shapes are painted; amplitude of noise added
                              afterwards */
  float *slices;           /* one per worker */
  const asker *asker;
  atomic_bool given_up;
} demo_job;

/* Noise from a hash of the voxel's position, triangular in [-1, 1]: the same on every machine and thread. */
static float noise_at(int x, int y, int z) {
  uint32_t h = (uint32_t)x * 0x9E3779B1u ^ (uint32_t)y * 0x85EBCA77u ^ (uint32_t)z * 0xC2B2AE3Du;
  h ^= h >> 15, h *= 0x2C1B3C6Du, h ^= h >> 12, h *= 0x297A2D39u, h ^= h >> 15;
  return (float)((int)(h & 0xffff) + (int)(h >> 16)) / 65536.0f - 1.0f;
}

static void store_slice(const demo_job *job, int z, const float *slice) {
  const tc_volume_desc *d = job->desc;
  int nx = d->dims[0], ny = d->dims[1];
  size_t base = (size_t)z * (size_t)nx * (size_t)ny;
  for (int y = 0; y < ny; y++)
    for (int x = 0; x < nx; x++) {
      float v = slice[y * nx + x];
      if (job->noise > 0) v += job->noise * noise_at(x, y, z);
      size_t i = base + (size_t)y * (size_t)nx + (size_t)x;
      if (d->type == TC_I16) {
        ((int16_t *)tc_volume_voxels(job->volume))[i] = (int16_t)lrintf(fminf(fmaxf(v, -1024), 3071));
      } else if (d->type == TC_U16) {
        ((uint16_t *)tc_volume_voxels(job->volume))[i] = (uint16_t)lrintf(fminf(fmaxf(v, 0), 65535));
      } else {
        ((uint8_t *)tc_volume_voxels(job->volume))[i] = (uint8_t)lrintf(fminf(fmaxf(v, 0), 255));
      }
    }
}

static void make_slice(void *context, int z, int worker) {
  demo_job *job = context;
  const asker *asker = job->asker;
  if (worker == 0 && asker->goes_on && !atomic_load(&job->given_up) &&
      !asker->goes_on(asker->user, (double)z / job->desc->dims[2]))
    atomic_store(&job->given_up, true);
  if (atomic_load(&job->given_up)) return;
  float *slice = job->slices + (size_t)worker * (size_t)job->desc->dims[0] * (size_t)job->desc->dims[1];
  job->fill(job, z, slice);
  store_slice(job, z, slice);
}

static tc_volume *make(demo_job *job, const tc_volume_desc *desc, const asker *asker, GError **error) {
  job->desc = desc;
  job->asker = asker;
  job->volume = tc_volume_new(desc, error);
  if (!job->volume) return NULL;
  tc_pool *pool = tc_pool_new(0, NULL);
  job->slices = malloc((size_t)tc_pool_threads(pool) * (size_t)desc->dims[0] * (size_t)desc->dims[1] * sizeof(float));
  if (job->slices) tc_pool_run(pool, desc->dims[2], make_slice, job);
  if (!job->slices) tc_set_error(error, TC_ERROR_MEMORY, NULL, "demo volume: out of memory");
  else if (atomic_load(&job->given_up)) tc_set_error(error, TC_ERROR_CANCELLED, NULL, "cancelled");
  else tc_volume_seal(job->volume);
  if (!job->slices || atomic_load(&job->given_up)) {
    tc_volume_unref(job->volume);
    job->volume = NULL;
  }
  free(job->slices);
  tc_pool_free(pool);
  return job->volume;
}

/* Centred on the patient origin, axes along LPS. */
static tc_volume_desc centred(int nx, int ny, int nz, double spacing, tc_voxel_type type, const char *modality) {
  tc_volume_desc d = {.dims = {nx, ny, nz}, .type = type, .spacing = {spacing, spacing, spacing},
                      .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .slope = 1, .frames = 1, .format = "demo"};
  for (int k = 0; k < 3; k++) d.origin[k] = -0.5 * (d.dims[k] - 1) * spacing;
  strncpy(d.modality, modality, sizeof d.modality - 1);
  return d;
}

static void fill_shapes(const demo_job *job, int z, float *slice) {
  const tc_volume_desc *d = job->desc;
  size_t n = (size_t)d->dims[0] * (size_t)d->dims[1];
  for (size_t i = 0; i < n; i++) slice[i] = job->background;
  for (int i = 0; i < job->n_shapes; i++)
    tc_shape_paint(&job->shapes[i], d->dims, d->origin, d->spacing[0], z, slice);
}

static tc_volume *demo_head(const asker *asker, GError **error) {
  tc_volume_desc d = centred(200, 248, 256, 0.95, TC_I16, "CT");
  strcpy(d.unit, "HU");
  int n;
  tc_shape *shapes = tc_shapes_head(&n);
  demo_job job = {.fill = fill_shapes, .shapes = shapes, .n_shapes = n, .background = -1000, .noise = 22};
  tc_volume *v = make(&job, &d, asker, error);
  free(shapes);
  return v;
}

/* The tissue of a shape of the head, by its painted value: 0 air, 1 soft tissue, 2 bone, 3 brain, 4 fluid, 5 eyes,
 * 6 teeth. */
static float head_label(float value) {
  static const struct {
    float below, label;
  } tissues[] = {{-500, 0}, {0, 1}, {10, 4}, {20, 5}, {44, 3}, {400, 1}, {1500, 2}};
  for (size_t i = 0; i < sizeof tissues / sizeof *tissues; i++)
    if (value < tissues[i].below) return tissues[i].label;
  return 6;
}

/* The head's segmentation on the head's grid. */
static tc_volume *demo_head_labels(const asker *asker, GError **error) {
  tc_volume_desc d = centred(200, 248, 256, 0.95, TC_U8, "SEG");
  int n;
  tc_shape *shapes = tc_shapes_head(&n);
  for (int i = 0; i < n; i++) {
    shapes[i].value = head_label(shapes[i].value);
    shapes[i].edge = 1e-6f; /* sharp edges: labels do not mix */
  }
  demo_job job = {.fill = fill_shapes, .shapes = shapes, .n_shapes = n};
  tc_volume *v = make(&job, &d, asker, error);
  free(shapes);
  return v;
}

static tc_volume *demo_vessels(const asker *asker, GError **error) {
  tc_volume_desc d = centred(256, 256, 256, 0.5, TC_U8, "XA");
  int n;
  tc_shape *shapes = tc_shapes_vessels(&n);
  demo_job job = {.fill = fill_shapes, .shapes = shapes, .n_shapes = n, .background = 12, .noise = 6};
  tc_volume *v = make(&job, &d, asker, error);
  free(shapes);
  return v;
}

/* Marschner and Lobb 1994, f_M = 6, alpha = 0.25, over [-1,1]^3, scaled to 0..65535. */
static void fill_marschner_lobb(const demo_job *job, int z, float *slice) {
  int n = job->desc->dims[0];
  double pz = 2.0 * z / (n - 1) - 1;
  for (int y = 0; y < n; y++)
    for (int x = 0; x < n; x++) {
      double px = 2.0 * x / (n - 1) - 1, py = 2.0 * y / (n - 1) - 1, r = sqrt(px * px + py * py);
      double rho = cos(2 * M_PI * 6 * cos(M_PI * r / 2));
      slice[y * n + x] = (float)(65535 * (1 - sin(M_PI * pz / 2) + 0.25 * (1 + rho)) / (2 * (1 + 0.25)));
    }
}

static tc_volume *demo_marschner_lobb(const asker *asker, GError **error) {
  tc_volume_desc d = centred(96, 96, 96, 1, TC_U16, "");
  demo_job job = {.fill = fill_marschner_lobb};
  return make(&job, &d, asker, error);
}

/* Sixty atoms of C60: Gaussian electron clouds on a truncated icosahedron's corners. */
static int bucky_atoms(double atoms[60][3]) {
  const double g = (1 + sqrt(5)) / 2;
  const double seeds[3][3] = {{0, 1, 3 * g}, {1, 2 + g, 2 * g}, {g, 2, 2 * g + 1}};
  int n = 0;
  for (int s = 0; s < 3; s++)
    for (int rotation = 0; rotation < 3; rotation++)
      for (int signs = 0; signs < 8; signs++) {
        double p[3];
        bool doubled = false;
        for (int k = 0; k < 3; k++) {
          double c = seeds[s][(k + rotation) % 3];
          if (c == 0 && (signs >> k & 1)) doubled = true; /* -0 is the same corner */
          p[k] = signs >> k & 1 ? -c : c;
        }
        if (!doubled && n < 60) memcpy(atoms[n++], p, sizeof p);
      }
  return n;
}

static void fill_bucky(const demo_job *job, int z, float *slice) {
  double atoms[60][3];
  int count = bucky_atoms(atoms), n = job->desc->dims[0];
  memset(slice, 0, (size_t)n * (size_t)n * sizeof *slice);
  double scale = 2 * 6.4 / (n - 1); /* the cage's radius is 4.96 */
  for (int a = 0; a < count; a++) {
    double dz = z * scale - 6.4 - atoms[a][2];
    if (fabs(dz) > 2.4) continue;
    for (int y = 0; y < n; y++) {
      double dy = y * scale - 6.4 - atoms[a][1];
      if (fabs(dy) > 2.4) continue;
      for (int x = 0; x < n; x++) {
        double dx = x * scale - 6.4 - atoms[a][0];
        if (fabs(dx) < 2.4) slice[y * n + x] += (float)(170 * exp(-(dx * dx + dy * dy + dz * dz) / (2 * 0.36)));
      }
    }
  }
}

static tc_volume *demo_bucky(const asker *asker, GError **error) {
  tc_volume_desc d = centred(128, 128, 128, 1, TC_U8, "");
  demo_job job = {.fill = fill_bucky};
  return make(&job, &d, asker, error);
}

static const struct {
  const char *name;
  tc_volume *(*make)(const asker *asker, GError **error);
  uint64_t bytes;
} demos[] = {{"head", demo_head, 200 * 248 * 256 * 2},
             {"head-labels", demo_head_labels, 200 * 248 * 256},
             {"vessels", demo_vessels, 256 * 256 * 256},
             {"marschner-lobb", demo_marschner_lobb, 96 * 96 * 96 * 2},
             {"bucky", demo_bucky, 128 * 128 * 128}};

uint64_t tc_volume_demo_bytes(const char *name) {
  for (size_t i = 0; i < sizeof demos / sizeof *demos; i++)
    if (!strcmp(name, demos[i].name)) return demos[i].bytes;
  return 0;
}

tc_volume *tc_volume_demo(const char *name, GError **error) { return tc_volume_demo_while(name, NULL, NULL, error); }

tc_volume *tc_volume_demo_while(const char *name, bool (*goes_on)(void *user, double fraction), void *user,
                                GError **error) {
  const asker asker = {goes_on, user};
  for (size_t i = 0; i < sizeof demos / sizeof *demos; i++)
    if (!strcmp(name, demos[i].name)) return demos[i].make(&asker, error);
  tc_set_error(
      error, TC_ERROR_NOT_FOUND, NULL,
      "demo \"%.40s\" is unknown: demo:head, demo:head-labels, demo:vessels, demo:marschner-lobb or demo:bucky", name);
  return NULL;
}
