/* The gl back end. A frame is cut into tiles; each is one dispatch, whose result is read back through the ring while
 * later tiles run. Small tiles keep a GPU's watchdog quiet and let frames be cancelled soon; their size follows
 * measured times (pace.h). */
#include "renderer/raycast/gl/backend.h"

#include <epoxy/gl.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "renderer/frame/backend.h"
#include "renderer/frame/frame.h"
#include "renderer/gl/program.h"
#include "renderer/gl/ring.h"
#include "renderer/mesh/surfaces.h"
#include "renderer/raycast/gl/job.h"
#include "renderer/raycast/gl/pace.h"
#include "renderer/raycast/gl/passes.h"
#include "renderer/raycast/gl/slot.h"
#include "renderer/raycast/gl/textures.h"
#include "renderer/raycast/gl/warm.h"
#include "renderer/base/clock.h"

#define SOFTWARE_PIXELS (1 << 16) /* most pixels per tile */
#define HARDWARE_PIXELS (1 << 20)
#define ROW 64 /* largest height of a tile; slow tiles are made narrower */
#define IN_FLIGHT_MS 20 /* longest expected time of all tiles in flight, during which the halt has no effect */
#define BACKGROUND_UPLOAD ((size_t)8 << 20) /* volumes of at least this size are uploaded in the background */
#define DEFAULT_CACHE_BYTES ((uint64_t)256 << 20)

/* Background work: programs to compile, or volumes to upload. */
typedef struct background_work {
  tc_gl_variant variants[TC_GL_PASSES];
  unsigned programs[TC_GL_PASSES]; /* results; 0: compiling failed */
  bool found[TC_GL_PASSES];        /* the program was in the cache */
  int n;                           /* number of programs */
  const tc_gl_drawer *drawer;      /* NULL: rays */
  tc_volume *volumes[2];  /* references while uploading, or NULL */
  uint64_t serials[2];    /* of these volumes, or 0; afterwards the serials of failed uploads */
} background_work;

typedef struct gl_backend {
  tc_gl_context *context;
  tc_gl_program_cache programs;
  tc_gl_warm warm;
  background_work work; /* the current or latest work of `warm` */
  tc_gl_textures textures;
  tc_gl_builder builder;
  tc_gl_ring ring;
  unsigned job_buffer; /* the uniform block Job */
  unsigned spans;      /* buffer of job.spans, of size spans_bytes */
  size_t spans_bytes;
  uint16_t textures_bound; /* texture_traits() of the bound textures */
  tc_gl_pace pace;
  double gpu_ms; /* of the last frame */
  uint64_t compiled;
  bool lost; /* the GPU stopped answering: no further GL calls, not even to clean up */
  char device[256];
} gl_backend;

/* ---- construction ---- */

bool tc_gl_probe(bool *hardware, char *why, size_t size) {
  tc_gl_report report;
  GError *error = NULL;
  *hardware = false;
  if (tc_gl_count_hardware() == 0) { /* avoids loading a driver */
    snprintf(why, size, "no hardware GPU: EGL lists none");
    return false;
  }
  if (!tc_gl_report_read(&report, &error)) {
    snprintf(why, size, "%s", error->message);
    g_error_free(error);
    return false;
  }
  *hardware = report.hardware;
  snprintf(why, size,
           report.hardware ? "hardware GPU with OpenGL 4.5: %s" : "no hardware GPU: OpenGL is %s, in software",
           report.renderer);
  return true;
}

/* Takes the results of finished background work. */
static void take_work(gl_backend *b) {
  background_work *e = &b->work;
  if (!tc_gl_warm_take(&b->warm)) return;
  bool current = tc_gl_context_use(b->context, NULL);
  for (int i = 0; i < 2; i++) {
    if (e->volumes[i] && current && !tc_gl_textures_want(&b->textures, e->volumes[i])) e->serials[i] = 0;
    tc_volume_unref(e->volumes[i]);
    e->volumes[i] = NULL;
  }
  for (int i = 0; i < e->n; i++) {
    if (e->found[i] || !e->programs[i]) continue;
    if (current) tc_gl_program_put(&b->programs, &e->variants[i], sizeof e->variants[i], e->programs[i]);
    b->compiled++;
  }
}

static void destroy(void *instance) {
  gl_backend *b = instance;
  if (!b) return;
  take_work(b);
  if (!b->lost && tc_gl_context_use(b->context, NULL)) {
    tc_gl_ring_clear(&b->ring);
    tc_gl_textures_clear(&b->textures);
    tc_gl_builder_clear(&b->builder);
    tc_gl_program_clear(&b->programs);
    glDeleteBuffers(1, &b->job_buffer);
    glDeleteBuffers(1, &b->spans);
  }
  tc_gl_context_free(b->context);
  g_free(b);
}

static void *create(const tc_renderer_options *options, tc_pool *pool, GError **error) {
  tc_gl_context *context = tc_gl_context_new(error);
  if (!context) return NULL;
  const tc_gl_report *report = tc_gl_context_about(context);
  gl_backend *b = g_new0(gl_backend, 1);
  b->context = context;
  tc_gl_pace_init(&b->pace, report->hardware, report->hardware ? HARDWARE_PIXELS : SOFTWARE_PIXELS);
  uint64_t cache_bytes = options->cache_bytes ? options->cache_bytes : DEFAULT_CACHE_BYTES;
  b->textures.lookup_budget = cache_bytes;
  b->textures.volume_budget = 4 * cache_bytes; /* graphics memory is mostly for volumes */
  /* Software OpenGL zeroes a new buffer at once, at some 2 GB/s, without checking the halt; pages of our own memory are
   * zeroed as they are filled. */
  b->textures.pins = !report->hardware && epoxy_has_gl_extension("GL_AMD_pinned_memory");
  snprintf(b->device, sizeof b->device, "%s, OpenGL %s", report->renderer, report->version);
  glCreateBuffers(1, &b->job_buffer);
  glNamedBufferStorage(b->job_buffer, sizeof(tc_gl_job_block), NULL, GL_DYNAMIC_STORAGE_BIT);
  tc_gl_builder_make(&b->builder, options->tables, report);
  if (!tc_gl_check("set-up", error)) {
    destroy(b);
    return NULL;
  }
  return b;
}

static const char *device(void *instance) { return ((gl_backend *)instance)->device; }

static const char *isa(void *instance) { return "opengl-4.5"; }

static void forget(void *instance, uint64_t volume_serial) {
  gl_backend *b = instance;
  take_work(b);
  if (!b->lost && tc_gl_context_use(b->context, NULL)) tc_gl_textures_forget(&b->textures, volume_serial);
}

static bool builds_table(void *instance, const tc_table_params *params, const char **why) {
  return tc_gl_builder_serves(&((gl_backend *)instance)->builder, params->n, params->n_subtables, params->bits, why);
}

static const char *kernel_suffix(void *instance, const tc_plan_key *key, const tc_rays *rays) { return "gl"; }

/* ---- one frame ---- */

static bool is_power_of_two(size_t n) { return !(n & (n - 1)); }

/* Properties of textures for which Mesa's llvmpipe recompiles a program at its first dispatch: whether sides and byte
 * size are powers of two, and whether the second byte of the size (in base 256) is 0. */
static uint16_t texture_traits(const tc_gl_volume *const volumes[2], const tc_gl_lookup *const lookups[3]) {
  unsigned traits = 0;
  for (int i = 0; i < 2; i++)
    for (int k = 0; k < 2; k++) traits = 2 * traits + (volumes[i] && is_power_of_two((size_t)lrintf(1 / volumes[i]->texel[k])));
  for (int i = 0; i < 3; i++) {
    const size_t bytes = lookups[i] ? lookups[i]->bytes : 0;
    traits = 4 * traits + 2 * is_power_of_two(bytes) + !(bytes >> 8 & 255);
  }
  return (uint16_t)traits;
}

/* volume: NULL if no volume is sampled. */
static tc_gl_variant variant_for(const gl_backend *b, const tc_frame_job *job, const tc_gl_volume *volume, int pass) {
  tc_gl_variant v;
  memset(&v, 0, sizeof v);
  v.plan = job->key;
  v.plan.shading = v.plan.shading != TC_SHADING_NONE; /* models differ only in parameters: one program for all */
  v.atlas = volume && volume->slices_per_layer > 1;
  const tc_gl_drawer *drawer = tc_gl_drawers[job->key.mode];
  v.pass = (uint8_t)(drawer && drawer->variant ? drawer->variant(job->scene, pass) : pass);
  if (volume && drawer) v.sampled = tc_volume_gaps(job->source) ? 2 : 1;
  if (volume && !b->pace.hardware) v.textures = b->textures_bound;
  v.linear_light = tc_resolve_is_linear(job->scene);
  v.transparent = job->scene->image.transparent;
  v.within = tc_mesh_is_within(job->scene); /* rays are cast in parts, which are composited as floats */
  v.want_linear = job->want_linear || v.within;
  if (v.within) v.plan.coherence = 0;
  v.want_depth = job->plan->depth;
  if (job->have.labels) {
    tc_voxel_type type = tc_volume_describe(job->label_volume)->type;
    v.label_signed = type == TC_I8 || type == TC_I16;
  }
  return v;
}

static unsigned program_for(gl_backend *b, const tc_frame_job *job, const tc_gl_volume *volume, int pass, GError **error) {
  tc_gl_variant v = variant_for(b, job, volume, pass);
  unsigned program = tc_gl_program_find(&b->programs, &v, sizeof v);
  if (program) return program;
  program = tc_gl_compose(&v, error);
  if (program) {
    tc_gl_program_put(&b->programs, &v, sizeof v, program);
    b->compiled++;
  }
  return program;
}

/* Reads back the oldest tile. False: the GPU is lost. */
static bool collect(gl_backend *b, const tc_frame_job *job, double *last_ms, GError **error) {
  const tc_gl_slot *slot = tc_gl_ring_take(&b->ring, error);
  if (!slot) return false;
  double ms = tc_gl_ring_ms(&b->ring, slot), now = tc_now_ms();
  if (ms >= 0)
    b->gpu_ms += ms;
  else
    ms = now - *last_ms;
  *last_ms = now;
  tc_gl_pace_learn(&b->pace, slot->tile[2] * slot->tile[3], job->pixel_samples, ms);
  tc_gl_slot_copy(slot, job);
  tc_gl_ring_give(&b->ring);
  return true;
}

static double deaf_ms(void *instance, double pixel_samples) {
  return tc_gl_pace_least_ms(&((gl_backend *)instance)->pace, pixel_samples);
}

static int whole_groups(int side) { return MAX(side / TC_GL_GROUP, 1) * TC_GL_GROUP; }

/* The next tile, row by row; widths may change from tile to tile. False: there is none. */
static bool next_tile(const gl_backend *b, const tc_frame_job *job, int tile[4]) {
  const tc_frame *frame = job->frame;
  const int pixels = tc_gl_pace_pixels(&b->pace, job->pixel_samples);
  tile[0] += tile[2];
  if (tile[0] >= frame->width || tile[2] == 0) {
    tile[0] = 0;
    tile[1] += tile[3];
    if (tile[1] >= frame->height) return false;
    tile[3] = MIN(MIN(whole_groups((int)sqrt(pixels)), ROW), frame->height - tile[1]);
  }
  tile[2] = MIN(whole_groups(pixels / tile[3]), frame->width - tile[0]);
  return true;
}

static bool has_room(const gl_backend *b, const tc_frame_job *job, int pixels) {
  unsigned in_flight = b->ring.head - b->ring.tail;
  return !tc_gl_ring_is_full(&b->ring) &&
         (in_flight == 0 || (in_flight + 1) * tc_gl_pace_ms(&b->pace, pixels, job->pixel_samples) <= IN_FLIGHT_MS);
}

/* Draws tiles from *tile on; afterwards *tile is the next one, at which a paused frame resumes. */
static bool run_tiles(gl_backend *b, unsigned program, const tc_frame_job *job, int tile[4], GError **error) {
  bool more = tile[2] ? tile[1] < job->frame->height : next_tile(b, job, tile), halted = false, drawn = false;
  double last_ms = tc_now_ms();
  while (more || !tc_gl_ring_is_idle(&b->ring)) {
    halted = halted || (more && (drawn ? tc_halt_between : tc_halt_within)(job->halt));
    if (more && !halted && has_room(b, job, tile[2] * tile[3])) {
      tc_gl_slot_dispatch(&b->ring, program, job, tile);
      more = next_tile(b, job, tile);
      drawn = true;
    } else if (!tc_gl_ring_is_idle(&b->ring) && !collect(b, job, &last_ms, error)) { /* tiles in flight are always finished */
      b->lost = true;
      return false;
    }
    if (halted && tc_gl_ring_is_idle(&b->ring)) break;
  }
  return !more || tc_halt_say(job->halt, error);
}

/* Binds the label volume and its entries to texture units 3 and 4. False with *error set. */
static bool bind_labels(gl_backend *b, const tc_frame_job *job, const tc_gl_volume **labels, const tc_gl_lookup **entries,
                        GError **error) {
  *labels = NULL, *entries = NULL;
  if (!job->have.labels) return true;
  *labels = tc_gl_textures_volume(&b->textures, job->label_volume, error);
  *entries =
      *labels ? tc_gl_textures_labels(&b->textures, job->label_volume, job->have.labels, job->halt, error) : NULL;
  if (!*entries) return false;
  glBindTextureUnit(3, (*labels)->texture);
  glBindTextureUnit(4, (*entries)->texture);
  return true;
}

/* The lookups of the job; others stay NULL. */
static bool lookups_for(gl_backend *b, const tc_frame_job *job, const tc_gl_lookup **table, const tc_gl_lookup **skip,
                        GError **error) {
  double *tables_ms = &job->frame->stats.tables_ms;
  const tc_halt *halt = job->halt;
  if (job->have.table &&
      !(*table = tc_gl_textures_table(&b->textures, &b->builder, job->have.table, tables_ms, halt, error)))
    return false;
  if (job->have.integrals && !(*table = tc_gl_textures_integrals(&b->textures, job->have.integrals, halt, error))) return false;
  if (job->have.distance_map && !(*skip = tc_gl_textures_distance_map(&b->textures, job->volume, job->have.distance_map, halt, error))) return false;
  return !job->have.bounds || (*skip = tc_gl_textures_bounds(&b->textures, job->volume, job->have.bounds, halt, error));
}

static void fill_job(gl_backend *b, const tc_frame_job *job, const tc_gl_volume *volume, const tc_gl_volume *labels) {
  tc_gl_job_block block;
  tc_gl_job_fill(&block, job, volume, labels);
  glNamedBufferSubData(b->job_buffer, 0, sizeof block, &block);
  glBindBufferBase(GL_UNIFORM_BUFFER, 0, b->job_buffer);
}

/* Uploads and binds all inputs of the job. Returns the volume's texture, or NULL with *error set. */
static const tc_gl_volume *bind(gl_backend *b, const tc_frame_job *job, GError **error) {
  if (!tc_gl_context_use(b->context, error)) return NULL;
  tc_gl_textures_begin(&b->textures);
  const tc_gl_volume *labels, *volume = tc_gl_textures_volume(&b->textures, job->volume, error);
  const tc_gl_lookup *table = NULL, *skip = NULL, *entries;
  if (!volume || !lookups_for(b, job, &table, &skip, error) || !bind_labels(b, job, &labels, &entries, error)) return NULL;
  b->textures_bound = texture_traits((const tc_gl_volume *[]){volume, labels}, (const tc_gl_lookup *[]){table, skip, entries});
  fill_job(b, job, volume, labels);
  glBindTextureUnit(0, volume->texture);
  glBindTextureUnit(1, table ? table->texture : 0);
  glBindTextureUnit(2, skip ? skip->texture : 0);
  return volume;
}

/* Whether the frame reads the volume: rays do. */
static bool samples(const tc_frame_job *job) {
  const tc_gl_drawer *drawer = tc_gl_drawers[job->key.mode];
  return !drawer || (drawer->samples && drawer->samples(job->scene));
}

/* Uploads and binds what the last pass of a mode of several passes reads; *volume is NULL if that is nothing. False with
 * *error set. */
static bool bind_sampled(gl_backend *b, const tc_frame_job *job, const tc_gl_volume **volume, GError **error) {
  const tc_volume *gaps = tc_volume_gaps(job->source);
  const tc_gl_volume *of_gaps = NULL;
  *volume = NULL;
  if (!tc_gl_context_use(b->context, error)) return false;
  tc_gl_textures_begin(&b->textures);
  if (!samples(job)) return true;
  if (!(*volume = tc_gl_textures_volume(&b->textures, job->source, error))) return false;
  if (gaps && !(of_gaps = tc_gl_textures_volume(&b->textures, gaps, error))) return false;
  b->textures_bound = texture_traits((const tc_gl_volume *[]){*volume, of_gaps}, (const tc_gl_lookup *[]){NULL, NULL, NULL});
  glBindTextureUnit(0, (*volume)->texture);
  if (gaps) glBindTextureUnit(4, of_gaps->texture);
  return true;
}

/* Draws a mode of several passes, without rays. */
static bool render_passes(gl_backend *b, const tc_frame_job *job, GError **error) {
  const tc_gl_drawer *drawer = tc_gl_drawers[job->key.mode];
  unsigned programs[TC_GL_PASSES];
  const bool has_clock = tc_gl_context_about(b->context)->timestamp_bits > 0;
  const tc_gl_frame frame = {.job = job, .programs = programs, .textures = &b->textures, .ring = &b->ring, .most = b->pace.most,
                             .hardware = b->pace.hardware, .job_buffer = b->job_buffer,
                             .lost = &b->lost};
  const tc_gl_volume *volume;
  if (!bind_sampled(b, job, &volume, error)) return false;
  for (int i = 0, n = drawer->passes(job->scene); i < n; i++)
    if (!(programs[i] = program_for(b, job, i ? NULL : volume, i, error))) return false;
  fill_job(b, job, volume, NULL);
  return tc_gl_ring_reserve(&b->ring, tc_gl_slot_bytes(job, b->pace.most), has_clock, error) && drawer->draw(&frame, error);
}

/* Uploads and binds the spans of the rays, for WITHIN of main.glsl. */
static void bind_spans(gl_backend *b, const tc_frame_job *job, unsigned program) {
  const size_t bytes = (size_t)job->frame->width * (size_t)job->frame->height * sizeof *job->spans;
  if (bytes > b->spans_bytes) {
    glDeleteBuffers(1, &b->spans);
    glCreateBuffers(1, &b->spans);
    glNamedBufferStorage(b->spans, (GLsizeiptr)bytes, NULL, GL_DYNAMIC_STORAGE_BIT);
    b->spans_bytes = bytes;
  }
  glNamedBufferSubData(b->spans, 0, (GLsizeiptr)bytes, job->spans);
  glBindBufferBase(GL_SHADER_STORAGE_BUFFER, 4, b->spans);
  glProgramUniform1i(program, 1, job->frame->width);
}

static bool render(void *instance, const tc_frame_job *job, GError **error) {
  gl_backend *b = instance;
  if (b->lost) {
    tc_set_error(error, TC_ERROR_INTERNAL, NULL, "gl: the GPU stopped answering; restart the daemon");
    return false;
  }
  take_work(b);
  b->gpu_ms = 0;
  if (tc_gl_drawers[job->key.mode]) return render_passes(b, job, error);
  const tc_gl_volume *volume = bind(b, job, error);
  unsigned program = volume ? program_for(b, job, volume, 0, error) : 0;
  bool has_clock = tc_gl_context_about(b->context)->timestamp_bits > 0;
  if (!program || !tc_gl_ring_reserve(&b->ring, tc_gl_slot_bytes(job, b->pace.most), has_clock, error))
    return false;
  glUseProgram(program);
  if (job->spans) bind_spans(b, job, program);
  tc_progress *progress = job->frame->progress;
  int tile[4] = {0};
  return run_tiles(b, program, job, progress ? progress->tile : tile, error) && tc_gl_check("frame", error);
}

/* ---- background work ---- */

/* Compiles the programs and runs them once on no pixel: drivers defer part of the compilation to the first dispatch,
 * and it depends on the bound textures. */
static void compile_in_background(void *argument) {
  gl_backend *b = argument;
  background_work *e = &b->work;
  for (int i = 0; i < e->n; i++)
    if (!e->found[i] && !(e->programs[i] = tc_gl_compose(&e->variants[i], NULL))) return;
  if (e->drawer) {
    e->drawer->warm(&(tc_gl_frame){.programs = e->programs, .most = b->pace.most, .hardware = b->pace.hardware}, e->n);
  } else {
    glUseProgram(e->programs[0]);
    glDispatchCompute(1, 1, 1); /* the tile uniform is initially empty: no pixel is drawn */
  }
  glFinish();
}

static void upload_in_background(void *argument) {
  gl_backend *b = argument;
  tc_gl_textures_begin(&b->textures);
  for (int i = 0; i < 2; i++)
    if (b->work.volumes[i]) tc_gl_textures_volume(&b->textures, b->work.volumes[i], NULL);
  glFinish();
}

/* True: large volumes of the job are being uploaded. Failed uploads are not retried: render() will report the error. */
static bool uploads(gl_backend *b, const tc_frame_job *job) {
  background_work next = {0};
  const bool rays = !tc_gl_drawers[job->key.mode];
  const tc_volume *volumes[2] = {job->volume, job->have.labels && rays ? job->label_volume : NULL};
  size_t bytes = 0;
  if (!tc_gl_context_use(b->context, NULL)) return false;
  for (int i = 0; i < 2; i++) {
    if (!volumes[i] || !tc_gl_textures_want(&b->textures, volumes[i])) continue;
    next.serials[i] = tc_volume_serial(volumes[i]);
    bytes += tc_volume_bytes(volumes[i]);
  }
  if (bytes < BACKGROUND_UPLOAD || memcmp(next.serials, b->work.serials, sizeof next.serials) == 0) return false;
  for (int i = 0; i < 2; i++)
    if (next.serials[i]) next.volumes[i] = tc_volume_ref((tc_volume *)volumes[i]);
  b->work = next;
  if (tc_gl_warm_start(&b->warm, b->context, upload_in_background, b)) return true;
  for (int i = 0; i < 2; i++) tc_volume_unref(next.volumes[i]);
  b->work = (background_work){0};
  return false;
}

static bool has_failed(const background_work *last, const background_work *next) {
  bool failed = false;
  for (int i = 0; i < last->n; i++) failed = failed || !last->programs[i];
  return failed && last->n == next->n && memcmp(last->variants, next->variants, sizeof next->variants) == 0;
}

/* Ready also after a failure: render() will fail again and report the error. */
static bool ready(void *instance, const tc_frame_job *job) {
  gl_backend *b = instance;
  if (b->lost) return true;
  if (tc_gl_warm_is_busy(&b->warm)) return false;
  take_work(b);
  const tc_gl_drawer *drawer = tc_gl_drawers[job->key.mode];
  if (samples(job) && uploads(b, job)) return false;
  const tc_gl_volume *volume;
  if (drawer ? !bind_sampled(b, job, &volume, NULL) : !(volume = bind(b, job, NULL))) return true;
  background_work next = {.n = drawer ? drawer->passes(job->scene) : 1, .drawer = drawer};
  bool all = true;
  for (int i = 0; i < next.n; i++) {
    next.variants[i] = variant_for(b, job, drawer && i ? NULL : volume, i);
    next.programs[i] = tc_gl_program_find(&b->programs, &next.variants[i], sizeof *next.variants);
    next.found[i] = next.programs[i];
    all = all && next.found[i];
  }
  if (all || has_failed(&b->work, &next)) return true;
  b->work = next;
  return !tc_gl_warm_start(&b->warm, b->context, compile_in_background, b);
}

static const char *refuses(void *instance, const tc_scene *scene) {
  const tc_gl_drawer *drawer = tc_gl_drawers[scene->mode];
  return drawer ? drawer->refuses(scene, tc_gl_context_about(((const gl_backend *)instance)->context)->hardware) : "opengl has no program for this mode";
}

const tc_backend_ops tc_gl_backend = {
    .name = "gl",
    .maps_distance = true,
    .create = create,
    .destroy = destroy,
    .device = device,
    .isa = isa,
    .variants = isa,
    .render = render,
    .deaf_ms = deaf_ms,
    .ready = ready,
    .refuses = refuses,
    .builds_table = builds_table,
    .forget = forget,
    .kernel_suffix = kernel_suffix,
};

/* ---- for measurements ---- */

const tc_gl_report *tc_gl_backend_report(const void *instance) {
  return tc_gl_context_about(((const gl_backend *)instance)->context);
}

double tc_gl_backend_gpu_ms(const void *instance) { return ((const gl_backend *)instance)->gpu_ms; }

uint64_t tc_gl_backend_compiled(const void *instance) { return ((const gl_backend *)instance)->compiled; }
