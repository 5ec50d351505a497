/* The cpu back end: chooses the instruction set, divides the picture into tiles for the worker pool, and resolves
 * them. */
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/frame/backend.h"
#include "renderer/frame/frame.h"
#include "renderer/raycast/cpu/isa.h"
#include "renderer/raycast/cpu/within.h"

/* Side of a unit of work in pixels: smaller if a thread would have fewer than LEAST_UNITS, because the frame waits for the
 * last one, or if the unit would take longer than UNIT_MS. */
#define TILE 32
#define SMALL 16 /* least side for the sake of LEAST_UNITS */
#define LEAST_UNITS 16
#define SMALLEST 4 /* side of a packet */
#define UNIT_MS 5

typedef struct cpu_backend {
  tc_pool *pool;
  tc_cpu_isas isas;
  tc_cover cover;
  char device[80], variants[64];
} cpu_backend;

/* State of one frame, shared by its tiles. */
typedef struct cpu_frame {
  const tc_frame_job *job;
  tc_cpu_within cast;
  tc_cpu_kernel kernel;
  tc_resolve resolve;
  tc_progress *progress;
  int units_x;
  bool resumed;     /* an earlier call began the frame */
  atomic_int drawn; /* units started by this call */
  pthread_mutex_t lock; /* guards progress->partials */
  struct { tc_cpu_counts counts; char pad[32]; } *workers; /* a cache line each */
} cpu_frame;

static void read_model(char *text, size_t size) {
  snprintf(text, size, "x86-64 processor");
  FILE *f = fopen("/proc/cpuinfo", "r");
  char line[256];
  while (f && fgets(line, sizeof line, f)) {
    char *colon = strchr(line, ':');
    if (strncmp(line, "model name", 10) || !colon) continue;
    colon[strcspn(colon, "\n")] = 0;
    snprintf(text, size, "%s", colon + 2);
    break;
  }
  if (f) fclose(f);
}

static void *cpu_create(const tc_renderer_options *options, tc_pool *pool, GError **error) {
  tc_cpu_isas isas;
  if (!tc_cpu_isa_choose(options->isa, &isas, error)) return NULL;
  cpu_backend *b = calloc(1, sizeof *b);
  if (!b) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "cpu back end: out of memory");
    return NULL;
  }
  b->pool = pool;
  b->isas = isas;
  g_strlcpy(b->variants, isas.close->name, sizeof b->variants);
  if (isas.distant != isas.close) g_snprintf(b->variants, sizeof b->variants, "%s; %s for distant rays", isas.close->name, isas.distant->name);
  read_model(b->device, sizeof b->device);
  return b;
}

static void cpu_destroy(void *instance) {
  tc_cover_finish(&((cpu_backend *)instance)->cover);
  free(instance);
}
static const char *cpu_device(void *instance) { return ((cpu_backend *)instance)->device; }
static const char *cpu_instructions(void *instance) { return ((cpu_backend *)instance)->isas.close->instructions; }
static const char *cpu_variants(void *instance) { return ((cpu_backend *)instance)->variants; }
static const char *cpu_variant(void *instance, const tc_plan_key *key, const tc_rays *rays) {
  return tc_cpu_isa_for(&((cpu_backend *)instance)->isas, key, rays)->name;
}
static void cpu_forget(void *instance, uint64_t volume_serial) {}

static tc_cpu_grid grid_of(const tc_volume *volume) {
  const int *dims = tc_volume_describe(volume)->dims;
  const int strides[3] = {1, dims[0], dims[0] * dims[1]};
  tc_cpu_grid grid = {.voxels = tc_volume_data(volume), .row = strides[1], .slice = strides[2]};
  for (int k = 0; k < 3; k++) {
    grid.last[k] = (float)(dims[k] - 1);
    grid.cell_last[k] = dims[k] > 2 ? dims[k] - 2 : 0;
    grid.stride[k] = dims[k] > 1 ? strides[k] : 0;
  }
  return grid;
}

static tc_cpu_blocks blocks_of(const uint8_t *values, int width, const int blocks[3]) {
  return (tc_cpu_blocks){.values = values, .width = (float)width, .inverse_width = 1 / (float)width,
                         .row = blocks[0], .slice = blocks[0] * blocks[1]};
}

static void fill_projection(tc_cpu_args *a, const tc_frame_job *job) {
  a->grey = job->plan->grey;
  if (job->scene->image.linear_light) a->to_light = tc_resolve_light();
  const tc_bounds *b = job->have.bounds;
  if (!b) return;
  a->blocks = blocks_of(b->levels, b->block, b->blocks);
  a->level_scale = b->scale;
  a->interval = tc_bounds_interval(b, job->rays);
}

static void fill_surface(tc_cpu_args *a, const tc_frame_job *job) {
  a->surface = job->plan->surface;
  a->depth = job->plan->depth ? job->frame->depth : NULL;
  a->width = job->frame->width;
}

static void fill_window(tc_cpu_args *a, const tc_frame_job *job) {
  tc_slice_window window;
  tc_slice_window_init(&window, job->volume, job->scene);
  a->nodes.lo = window.lo;
  a->nodes.scale = window.sign;
  a->nodes.last = window.last;
  a->window.center = window.center;
  a->window.gain = window.gain;
}

static void fill_subtables(tc_cpu_args *a, const tc_table *t) {
  double nodes = (t->n - 1) / (t->hi - t->lo);
  a->n_subtables = t->n_subtables;
  for (int z = 0; z < t->n_subtables; z++) {
    const tc_subtable *subtable = &t->subtables[z];
    double lo = (subtable->lo - t->lo) * nodes, width = (subtable->hi - subtable->lo) * nodes;
    double rim = subtable->rim * width / (TC_SUBTABLE_NODES - 1);
    a->subtables[z] = (tc_cpu_subtable){.lo = (float)lo,
                                .scale = (float)((TC_SUBTABLE_NODES - 1) / width),
                                .start = (float)((t->subtable_rows[z] - t->zero_row) / 4),
                                .rim = (float)subtable->rim,
                                .inner = {(float)(lo + rim), (float)(lo + width - rim)}};
  }
}

static void fill_labels(tc_cpu_labels *l, const tc_frame_job *job) {
  double matrix[3][4];
  tc_labels_matrix(job->volume, job->label_volume, matrix);
  for (int i = 0; i < 12; i++) l->matrix[i / 4][i % 4] = (float)matrix[i / 4][i % 4];
  l->grid = grid_of(job->label_volume);
  l->type = tc_volume_describe(job->label_volume)->type;
  l->nearest = job->key.filter == TC_FILTER_NEAREST;
  l->base = (float)job->have.labels->base;
  l->entries = job->have.labels->entries[0];
  l->outside = job->have.labels->entries[job->have.labels->n];
}

static void fill_nodes(tc_cpu_args *a, int n, double lo, double hi) {
  a->nodes.lo = (float)lo;
  a->nodes.scale = (float)((n - 1) / (hi - lo));
  a->nodes.last = (float)(n - 1);
}

static void fill_zones(tc_cpu_args *a, const tc_table_params *params) {
  double below, above;
  tc_support_zones(params, &below, &above);
  a->zero_below = (float)below;
  a->zero_above = (float)above;
}

static void fill_args(tc_cpu_args *a, const tc_frame_job *job) {
  *a = (tc_cpu_args){.key = job->key, .grid = grid_of(job->volume), .halt = job->halt,
                     .termination = (float)job->scene->sampling.termination};
  tc_rays_round(&a->rays, job->rays);
  if (job->have.labels) fill_labels(&a->labels, job);
  if (tc_is_projection((tc_mode)job->key.mode)) fill_projection(a, job);
  if (job->key.mode == TC_MODE_ISOSURFACE) fill_surface(a, job);
  if (job->have.distance_map) a->blocks = blocks_of(job->have.distance_map->distance, job->have.distance_map->block, job->have.distance_map->blocks);
  if (job->key.mode == TC_MODE_MPR) fill_window(a, job);
  if (job->key.shading) tc_shade_set_up(&a->shade, job->source, job->volume, job->scene);
  if (job->have.table || job->have.integrals) fill_zones(a, &job->plan->table);
  if (job->have.table) {
    a->table = job->have.table->zero_row;
    a->table_stride = (float)job->have.table->columns;
    fill_nodes(a, job->have.table->n, job->have.table->lo, job->have.table->hi);
    fill_subtables(a, job->have.table);
  } else if (job->have.integrals) {
    a->integrals = job->have.integrals->entries;
    a->levels_start = job->have.integrals->levels_start;
    a->level_row = job->have.integrals->n + 1;
    fill_nodes(a, job->have.integrals->n, job->have.integrals->lo, job->have.integrals->hi);
  }
}

/* Whether the differences of its voxels are 16-bit integers. */
static bool has_short_slopes(const tc_volume *volume) {
  const tc_volume_stats *s = tc_volume_statistics(volume);
  return tc_volume_describe(volume)->type != TC_F32 && s->voxel_max - s->voxel_min <= INT16_MAX;
}

static bool fill_cover(cpu_backend *b, const tc_frame_job *job, tc_cpu_args *a, GError **error) {
  tc_cover *c = &b->cover;
  if (!tc_cover_fill(c, job->have.boxes, job->volume, job->rays, b->pool, error))
    return false;
  a->cover = *c;
  return true;
}

/* Restores the pixels and the position of an interrupted unit. */
static void take_partial(cpu_frame *f, int unit, float *out, ptrdiff_t stride, tc_cpu_counts *counts) {
  int side = f->progress->side;
  pthread_mutex_lock(&f->lock);
  tc_partial **at = &f->progress->partials, *partial;
  while (*at && (*at)->unit != unit) at = &(*at)->next;
  partial = *at;
  if (partial) *at = partial->next;
  pthread_mutex_unlock(&f->lock);
  if (!partial) return;
  for (int y = 0; y < side; y++) memcpy(out + y * stride * 4, partial->pixels + y * side * 4, 16 * (size_t)side);
  counts->packet = partial->packet;
  counts->ray = partial->ray;
  free(partial);
}

/* Saves an interrupted unit. If out of memory, the unit will be drawn from the start. */
static void keep_partial(cpu_frame *f, int unit, const float *out, ptrdiff_t stride, const tc_cpu_counts *counts) {
  int side = f->progress->side;
  tc_partial *partial = malloc(sizeof *partial + 16 * (size_t)side * (size_t)side);
  if (!partial) return;
  partial->unit = unit;
  partial->packet = counts->packet;
  partial->ray = counts->ray;
  for (int y = 0; y < side; y++) memcpy(partial->pixels + y * side * 4, out + y * stride * 4, 16 * (size_t)side);
  pthread_mutex_lock(&f->lock);
  partial->next = f->progress->partials;
  f->progress->partials = partial;
  pthread_mutex_unlock(&f->lock);
}

/* Draws a unit, to its end or until the halt interrupts it. */
static void draw_unit(cpu_frame *f, int index, int worker) {
  tc_cpu_counts *counts = &f->workers[worker].counts;
  const tc_frame_job *job = f->job;
  int width = job->frame->width, height = job->frame->height, side = f->progress->side;
  int x0 = index % f->units_x * side, y0 = index / f->units_x * side;
  int x1 = x0 + side < width ? x0 + side : width, y1 = y0 + side < height ? y0 + side : height;
  float out[TILE * TILE * 4];
  counts->packet = counts->ray = 0;
  if (f->resumed) take_partial(f, index, out, TILE, counts);
  f->kernel(&f->cast.args, x0, y0, x1, y1, out, TILE, counts);
  if (counts->left) {
    keep_partial(f, index, out, TILE, counts);
    return;
  }
  for (int y = y0; y < y1; y++) {
    size_t first = (size_t)y * (size_t)width + (size_t)x0;
    const float *row = out + (y - y0) * TILE * 4;
    tc_resolve_row(&f->resolve, row, job->frame->rgba + 4 * first, x1 - x0);
    if (job->want_linear) memcpy(job->frame->linear + 4 * first, row, 16 * (size_t)(x1 - x0));
  }
  f->progress->finished[index] = true;
}

/* Every call draws at least one unit, so that a frame that is paused again and again still progresses. */
static void unit_task(void *context, int index, int worker) {
  cpu_frame *f = context;
  if (f->progress->finished[index] || f->workers[worker].counts.left || tc_halt_within(f->job->halt)) return;
  if (atomic_load_explicit(&f->drawn, memory_order_relaxed) && tc_halt_between(f->job->halt)) return;
  atomic_fetch_add_explicit(&f->drawn, 1, memory_order_relaxed);
  draw_unit(f, index, worker);
}

/* Adds the workers' counts to the frame. True: the frame is complete. */
static bool gather_counts(cpu_frame *f, int workers) {
  tc_frame_stats *stats = &f->job->frame->stats;
  for (int i = 0; i < workers; i++) {
    stats->samples += f->workers[i].counts.samples;
    stats->rays += f->workers[i].counts.rays;
    stats->gradients += f->workers[i].counts.gradients;
    stats->leaps += f->workers[i].counts.leaps;
  }
  f->progress->done = 0;
  f->progress->rays_ahead = 0;
  for (const tc_partial *p = f->progress->partials; p; p = p->next)
    f->progress->rays_ahead += p->packet * TC_MAX_RAYS_PER_PIXEL + p->ray;
  for (int i = 0; i < f->progress->units; i++) f->progress->done += f->progress->finished[i];
  return f->progress->done == f->progress->units;
}

/* Side of a unit in pixels: a unit takes at most UNIT_MS, unless a packet alone takes longer. */
static int unit_side(const cpu_backend *b, const tc_cpu_isa *isa, const tc_frame_job *job) {
  const int64_t pixels = (int64_t)job->frame->width * job->frame->height;
  int side = TILE;
  while (side > SMALL && pixels < (int64_t)LEAST_UNITS * tc_pool_threads(b->pool) * side * side) side /= 2;
  while (side > SMALLEST && side * side * job->pixel_samples * isa->sample_ns > UNIT_MS * 1e6) side /= 2;
  return side;
}

static bool cpu_render(void *instance, const tc_frame_job *job, GError **error) {
  cpu_backend *b = instance;
  const bool surface = job->key.mode == TC_MODE_ISOSURFACE;
  const tc_cpu_isa *isa = tc_cpu_isa_for(&b->isas, &job->key, job->rays);
  cpu_frame f = {.job = job, .kernel = (surface ? isa->find_surface : isa->find)(&job->key)};
  if (job->spans) f.kernel = tc_within_kernel(isa->instructions, &job->key);
  if (!f.kernel) {
    char name[64];
    tc_plan_key_name(&job->key, name, sizeof name);
    tc_set_error(error, TC_ERROR_UNSUPPORTED, "/mode", "the cpu back end has no kernel %s", name);
    return false;
  }
  f.resumed = job->frame->progress && job->frame->progress->units;
  f.progress = tc_frame_cut(job->frame, unit_side(b, isa, job), error);
  if (!f.progress) return false;
  f.workers = calloc((size_t)tc_pool_threads(b->pool), sizeof *f.workers);
  if (!f.workers) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "cpu back end: out of memory");
    return false;
  }
  for (int i = 0; i < tc_pool_threads(b->pool); i++) f.workers[i].counts.until_poll = TC_CPU_POLL_STEPS;
  fill_args(&f.cast.args, job);
  f.cast.args.near = isa->near;
  f.cast.args.gather = isa->gather;
  f.cast.args.near_slopes = isa->near && has_short_slopes(job->volume);
  f.cast.spans = job->spans, f.cast.width = job->frame->width, f.cast.height = job->frame->height;
  if (job->have.boxes && !fill_cover(b, job, &f.cast.args, error)) {
    free(f.workers);
    return false;
  }
  tc_resolve_init(&f.resolve, job->scene);
  f.units_x = (job->frame->width + f.progress->side - 1) / f.progress->side;
  pthread_mutex_init(&f.lock, NULL);
  tc_pool_run(b->pool, f.progress->units, unit_task, &f);
  pthread_mutex_destroy(&f.lock);
  bool whole = gather_counts(&f, tc_pool_threads(b->pool));
  free(f.workers);
  return whole || tc_halt_say(job->halt, error);
}

const tc_backend_ops tc_cpu_backend = {.name = "cpu",
                                       .create = cpu_create,
                                       .destroy = cpu_destroy,
                                       .device = cpu_device,
                                       .isa = cpu_instructions,
                                       .variants = cpu_variants,
                                       .render = cpu_render,
                                       .forget = cpu_forget,
                                       .kernel_suffix = cpu_variant};
