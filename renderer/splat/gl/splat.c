#include "renderer/splat/gl/splat.h"

#include <epoxy/gl.h>
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/frame/frame.h"
#include "renderer/raycast/gl/job.h"
#include "renderer/splat/mode.h"
#include "renderer/splat/splatter.h"

#define SOFTWARE_NS 100 /* for a splat in a pass, until measured */
#define HARDWARE_NS 2
#define BLOCK 8
#define MOST_STEPS 57600
#define SPLATS_EACH 64 /* most splats of a brick for each thread of a work-group */

enum { BLOCK_BUFFER, ENTRIES, DEPTHS, SUMS, TABLE, N_BUFFERS };

/* The uniform block of splat_head.glsl, std140. */
typedef struct splat_block {
  _Alignas(16) float axis[3][4];
  float direction0[4], direction_du[4], direction_dv[4], right[4], down[4], planes[TC_SPLAT_MOST_PLANES][4], color[4], to_index[3][4];
  uint8_t weights[65 * 16];
  float size[2], scale, radius2, pixel_radius2, near_mm, window_mm, core2, core_share, full_weight, coreless_scale;
  int32_t perspective, culling, n_planes, stride, opaque;
  float mass, most, shape_blend, core_radius;
  _Alignas(16) float covariant[3][4];
} splat_block;

typedef struct splat_entry { /* Entry of splat_pass.glsl */
  float at[4], eye[4];
  uint32_t words[4]; /* first, count, seen | mixed << 8 | clipped << 9 | aslant << 16, planes that may clip it */
  float starts[(TC_SPLAT_MOST_PLANES + 3) / 4 * 4]; /* values of the planes at its voxel 0 */
} splat_entry;

typedef struct drawing {
  const tc_gl_frame *gl;
  tc_splat_frame of;
  tc_splat_appearance *appearance; /* NULL: one colour */
  tc_progress *progress;
  const tc_gl_lookup *words[2]; /* packed splats: the model's, the cut faces' */
  splat_entry *entries;         /* of a tile: the model's, then the cut faces' */
  int n[2], rows;               /* numbers of entries; rows of pixels for each work-group */
  tc_gl_batch batch;
  unsigned buffers[N_BUFFERS]; /* block, entries, depths, sums, table */
} drawing;

/* ---- a frame's constants ---- */

/* Translucent: largest optical depth that a splat may add to a pixel, so that integers in units of 2^-20 hold the sum of a sheet. The
 * number of splats at a pixel is bounded by the voxels under the widest footprint, taken as half as far apart as along the axes. */
static float most_depth(const drawing *d) {
  const tc_splat_args *g = &d->of.args;
  float far = 1e-3f, least = INFINITY;
  for (int i = 0; i < d->of.n_entries; i++) far = fmaxf(far, d->of.entries[i].at[2]);
  for (int k = 0; k < 3; k++) least = fminf(least, hypotf(hypotf(g->axis[0][k], g->axis[1][k]), g->axis[2][k]));
  const float pixels = 0.5f * least * g->scale / (g->perspective ? far : 1);
  return 2048 / ((float)M_PI * (4 * g->radius2 + g->pixel_radius2 / (pixels * pixels)) + 1);
}

static void fill_block(const drawing *d, splat_block *b) {
  const tc_splat_args *g = &d->of.args;
  *b = (splat_block){.size = {g->width, g->height}, .scale = g->scale, .radius2 = g->radius2, .pixel_radius2 = g->pixel_radius2,
                     .near_mm = g->near_mm, .window_mm = g->window_mm, .core2 = g->core2, .core_share = g->core_share,
                     .full_weight = g->full_weight, .coreless_scale = g->coreless_scale, .perspective = g->perspective, .culling = g->culling, .n_planes = g->n_planes, .stride = d->appearance ? 8 : 4, .opaque = g->opaque, .mass = g->mass, .most = most_depth(d), .shape_blend = g->shape_blend, .core_radius = g->core_radius};
  for (int k = 0; k < 3; k++) {
    memcpy(b->axis[k], g->axis[k], sizeof g->axis[k]);
    memcpy(b->covariant[k], g->covariant[k], sizeof g->covariant[k]);
    memcpy(b->to_index[k], g->to_index[k], sizeof g->to_index[k]);
    b->direction0[k] = g->direction0[k], b->direction_du[k] = g->direction_du[k], b->direction_dv[k] = g->direction_dv[k];
    b->right[k] = g->right[k], b->down[k] = g->down[k], b->color[k] = g->color[k];
  }
  for (int i = 0; i < g->n_planes; i++)
    for (int k = 0; k < 4; k++) b->planes[i][k] = (float)g->planes[i][k];
  memcpy(b->weights, g->weights, sizeof g->weights);
}

/* Packed splats in one buffer: words; insets, four to a word; rims of cut faces; and table indices of colour (low half) and
 * extinction. */
typedef struct packing {
  const tc_splats *of;
  const tc_splat_appearance *appearance;
} packing;

static size_t words_size(const tc_splats *s) { return (s->n * sizeof(uint32_t) + 31) / 16 * 16; }

static size_t rims_at(const tc_splats *s) { return words_size(s) + (s->n + 15) / 16 * 16; }

static size_t appearance_at(const tc_splats *s) { return rims_at(s) + (s->rims ? words_size(s) : 0); }

static size_t packed_bytes(const void *thing) {
  const packing *p = thing;
  return appearance_at(p->of) + (p->appearance ? words_size(p->of) : 0);
}

static bool pack_words(const void *thing, void *bytes, const tc_halt *halt) {
  const packing *p = thing;
  memset(bytes, 0, packed_bytes(p));
  memcpy(bytes, p->of->words, p->of->n * sizeof *p->of->words);
  memcpy((uint8_t *)bytes + words_size(p->of), p->of->insets, p->of->n);
  if (p->of->rims) memcpy((uint8_t *)bytes + rims_at(p->of), p->of->rims, p->of->n * sizeof *p->of->rims);
  return true;
}

static bool pack_appearance(const void *thing, void *bytes, const tc_halt *halt) {
  const packing *p = thing;
  uint32_t *appearance = (uint32_t *)bytes + appearance_at(p->of) / sizeof *appearance;
  pack_words(thing, bytes, halt);
  tc_splat_brick brick = {0};
  size_t from = 0;
  for (uint32_t b = 0; b < p->of->n_bricks; b++) {
    tc_splats_next(p->of, &from, &brick);
    if (tc_halt_within(halt)) return false;
    for (uint32_t i = brick.first; i < brick.first + brick.count; i++) {
      const uint32_t word = p->of->words[i];
      int at[3];
      uint16_t entries[2];
      for (int k = 0; k < 3; k++) at[k] = brick.at[k] * TC_SPLAT_BRICK + (int)(word >> 4 * k & 15);
      tc_splat_appearance_at(p->appearance, at, entries);
      appearance[i] = entries[0] | (uint32_t)entries[1] << 16;
    }
  }
  return true;
}

static bool upload(drawing *d, GError **error) {
  const tc_frame_job *job = d->gl->job;
  const tc_splats *of[2] = {job->have.splats, job->have.cut};
  for (int i = 0; i < 2 && of[i]; i++) {
    const packing thing = {of[i], d->appearance};
    const tc_gl_packing packing = {"splats", packed_bytes, d->appearance ? pack_appearance : pack_words, &thing};
    const uint64_t volume = tc_volume_serial(job->source), serial = of[i]->serial << 8 | (d->appearance ? tc_splat_appearance_key(d->appearance) : 0);
    d->words[i] = tc_gl_textures_packed(d->gl->textures, &packing, serial, volume, job->halt, error);
    if (!d->words[i]) return false;
  }
  return true;
}

static void upload_table(drawing *d) {
  int n = 1;
  const float(*table)[4] = d->appearance ? tc_splat_appearance_table(d->appearance, &n) : NULL;
  glNamedBufferStorage(d->buffers[TABLE], (GLsizeiptr)n * (GLsizeiptr)sizeof *table, table, 0);
}

static void make_buffers(drawing *d) {
  const size_t side = (size_t)d->progress->side, blocks = (side + BLOCK - 1) / BLOCK;
  splat_block block;
  fill_block(d, &block);
  glCreateBuffers(N_BUFFERS, d->buffers);
  glNamedBufferStorage(d->buffers[BLOCK_BUFFER], sizeof block, &block, 0);
  glNamedBufferStorage(d->buffers[ENTRIES], (GLsizeiptr)(((size_t)d->of.n_entries + 1) * sizeof *d->entries), NULL, GL_DYNAMIC_STORAGE_BIT);
  glNamedBufferStorage(d->buffers[DEPTHS], (GLsizeiptr)((side * side + blocks * blocks) * 4), NULL, 0);
  glNamedBufferStorage(d->buffers[SUMS], (GLsizeiptr)(side * side * 4 * (size_t)block.stride), NULL, 0);
  upload_table(d);
  glBindBufferBase(GL_UNIFORM_BUFFER, 1, d->buffers[BLOCK_BUFFER]);
  for (GLuint i = ENTRIES; i <= SUMS; i++) glBindBufferBase(GL_SHADER_STORAGE_BUFFER, 4 + i, d->buffers[i]);
  if (d->of.args.shaded)
    glNamedBufferSubData(d->gl->job_buffer, offsetof(tc_gl_job_block, shade), sizeof d->of.args.shade, &d->of.args.shade);
}

/* ---- tiles ---- */

static void add_entry(drawing *d, const tc_splat_entry *e) {
  const int *at = e->brick.at;
  splat_entry *to = &d->entries[d->n[0] + d->n[1]];
  *to = (splat_entry){.words = {e->brick.first, e->brick.count}};
  for (int k = 0; k < 3; k++) to->at[k] = e->at[k], to->eye[k] = e->eye[k];
  for (int i = 0; i < d->of.args.n_planes; i++) {
    const double *p = d->of.planes[i];
    to->starts[i] = (float)(p[3] + TC_SPLAT_BRICK * (p[0] * at[0] + p[1] * at[1] + p[2] * at[2]));
  }
  to->words[2] = e->seen | (uint32_t)e->mixed << 8 | (uint32_t)e->clipped << 9 | (uint32_t)e->aslant << 16;
  to->words[3] = e->planes;
  d->n[e->of != d->of.of]++;
}

static bool in_tile(const tc_splat_entry *e, const int tile[4]) {
  return e->box[0] < (float)(tile[0] + tile[2]) && e->box[2] >= (float)tile[0] && e->box[1] < (float)(tile[1] + tile[3]) &&
         e->box[3] >= (float)tile[1];
}

static void collect_entries(drawing *d, const int tile[4]) {
  d->n[0] = d->n[1] = 0;
  for (int cut = 0; cut < 2; cut++)
    for (int i = 0; i < d->of.n_entries; i++)
      if ((d->of.entries[i].of != d->of.of) == cut && in_tile(&d->of.entries[i], tile)) add_entry(d, &d->of.entries[i]);
  glNamedBufferSubData(d->buffers[ENTRIES], 0, (GLsizeiptr)((size_t)(d->n[0] + d->n[1]) * sizeof *d->entries), d->entries);
}

/* Rows of pixels for each work-group, so that none of its 64 threads visits more than MOST_STEPS pixels: software drivers end loops
 * after 65535 iterations, and hardware drivers after some time. */
static int rows_of(const drawing *d) {
  const tc_splat_args *g = &d->of.args;
  double size = 0;
  for (int k = 0; k < 3; k++) size += pow(hypot(g->axis[0][k], hypot(g->axis[1][k], g->axis[2][k])), 2);
  const double near = g->perspective && d->of.n_entries ? fmax(d->of.entries[0].near_mm, g->near_mm) : 1;
  const double aside = g->perspective ? hypot(g->width, g->height) / (2 * g->scale) : 0; /* tangent, in a corner */
  const double voxels = sqrt(g->radius2) * tc_splat_longest_kernel(g);
  const double reach = sqrt(size) * voxels * g->scale / near * sqrt(1 + aside * aside) + sqrt(g->pixel_radius2);
  const double wide = fmin(2 * reach + 1, d->progress->side);
  return SPLATS_EACH * wide * wide <= MOST_STEPS ? d->progress->side : (int)fmax(1, MOST_STEPS / (SPLATS_EACH * wide));
}

static void use(const drawing *d, int pass, const int tile[4]) {
  glUseProgram(d->gl->programs[pass]);
  glProgramUniform4i(d->gl->programs[pass], 0, tile[0], tile[1], tile[2], tile[3]);
}

/* Runs a pass over the tile's bricks in batches. False: halted. */
static bool run_pass(drawing *d, int pass, const int tile[4]) {
  const tc_splats *of[2] = {d->gl->job->have.splats, d->gl->job->have.cut};
  const int end = d->n[0] + d->n[1], bands = (tile[3] + d->rows - 1) / d->rows;
  use(d, pass, tile);
  glProgramUniform1i(d->gl->programs[pass], 4, d->rows);
  for (int i = 0; i < end;) {
    const int from = i, cut = i >= d->n[0], last = cut ? end : d->n[0];
    uint32_t n = 0;
    for (const double most = tc_gl_batch_most(&d->batch); i < last && n < most; i++) n += d->entries[i].words[1];
    glBindBufferBase(GL_SHADER_STORAGE_BUFFER, 4, d->words[cut]->buffer);
    glProgramUniform1ui(d->gl->programs[pass], 1, (GLuint)from);
    glProgramUniform1ui(d->gl->programs[pass], 2, d->appearance ? (GLuint)(appearance_at(of[cut]) / sizeof(uint32_t)) : 0);
    glProgramUniform1ui(d->gl->programs[pass], 6, cut ? (GLuint)(rims_at(of[cut]) / sizeof(uint32_t)) : 0);
    glProgramUniform1ui(d->gl->programs[pass], 5, (GLuint)(words_size(of[cut]) / sizeof(uint32_t)));
    glDispatchCompute((GLuint)(i - from), (GLuint)bands, 1);
    d->gl->job->frame->stats.samples += n;
    if (!tc_gl_batch_add(&d->batch, (double)n * bands, d->gl->job->halt)) return false;
  }
  glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT);
  return true;
}

/* ---- translucent ---- */

/* Collects the tile's bricks in one layer along the axis. */
static void collect_layer(drawing *d, const int tile[4], int axis, int layer) {
  d->n[0] = d->n[1] = 0;
  for (int i = 0; i < d->of.n_entries; i++)
    if (d->of.entries[i].brick.at[axis] == layer && in_tile(&d->of.entries[i], tile)) add_entry(d, &d->of.entries[i]);
  if (d->n[0]) glNamedBufferSubData(d->buffers[ENTRIES], 0, (GLsizeiptr)((size_t)d->n[0] * sizeof *d->entries), d->entries);
}

/* False: halted. */
static bool run_sheet(drawing *d, const int tile[4], int axis, int place) {
  const unsigned *programs = d->gl->programs;
  glProgramUniform2ui(programs[1], 3, 4 * (GLuint)axis, (GLuint)place);
  if (!run_pass(d, 1, tile)) return false;
  use(d, 2, tile);
  glDispatchCompute((GLuint)(tile[2] + 7) / 8, (GLuint)(tile[3] + 7) / 8, 1);
  glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT);
  return true;
}

/* Draws the sheets of voxels on one side of the eye (1 or -1 along the axis), nearest first. False: halted. */
static bool run_sheets(drawing *d, const int tile[4], int axis, double eye, int side) {
  const tc_frame_job *job = d->gl->job;
  const int n = tc_volume_describe(job->have.labels ? job->label_volume : job->source)->dims[axis];
  const int first = (int)fmin(fmax(ceil(eye), 0), n);
  int layer = -1;
  for (int sheet = side > 0 ? first : first - 1; sheet >= 0 && sheet < n; sheet += side) {
    if (sheet / TC_SPLAT_BRICK != layer) collect_layer(d, tile, axis, layer = sheet / TC_SPLAT_BRICK);
    if (d->n[0] && !run_sheet(d, tile, axis, sheet % TC_SPLAT_BRICK)) return false;
  }
  return true;
}

static bool draw_sheets(drawing *d, const int tile[4]) {
  const int axis = tc_splat_sheet_axis(&d->of.args);
  if (!d->of.n_entries) return true;
  const tc_splat_entry *any = &d->of.entries[0];
  const double eye = (double)any->eye[axis] + TC_SPLAT_BRICK * any->brick.at[axis];
  return run_sheets(d, tile, axis, eye, 1) && run_sheets(d, tile, axis, eye, -1);
}

static bool draw_tile(void *user, const int tile[4], GError **error) {
  drawing *d = user;
  const GLuint far = 0xff800000u; /* ordered(infinite) */
  const GLuint across = (GLuint)((tile[2] + 8 * BLOCK - 1) / (8 * BLOCK)), down = (GLuint)((tile[3] + 8 * BLOCK - 1) / (8 * BLOCK));
  glClearNamedBufferData(d->buffers[DEPTHS], GL_R32UI, GL_RED_INTEGER, GL_UNSIGNED_INT, &far);
  glClearNamedBufferData(d->buffers[SUMS], GL_R32UI, GL_RED_INTEGER, GL_UNSIGNED_INT, NULL);
  glBindBufferBase(GL_SHADER_STORAGE_BUFFER, 3, d->buffers[TABLE]); /* the picture's depths are bound there afterwards */
  if (!d->of.args.opaque) return draw_sheets(d, tile) || tc_halt_say(d->gl->job->halt, error);
  collect_entries(d, tile);
  if (!run_pass(d, 1, tile)) return tc_halt_say(d->gl->job->halt, error);
  use(d, 2, tile);
  glDispatchCompute(across, down, 1);
  glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT);
  if (!run_pass(d, 3, tile)) return tc_halt_say(d->gl->job->halt, error);
  return true;
}

static bool draw_frame(drawing *d, GError **error) {
  if (!upload(d, error)) return false;
  d->rows = rows_of(d);
  make_buffers(d);
  const bool drawn = tc_gl_check("splats", error) && tc_gl_draw_tiles(d->gl, draw_tile, d, error);
  tc_gl_batch_end(&d->batch);
  if (!*d->gl->lost) glDeleteBuffers(N_BUFFERS, d->buffers);
  return drawn && tc_gl_check("splats", error);
}

static bool draw(const tc_gl_frame *gl, GError **error) {
  const tc_frame_job *job = gl->job;
  const tc_splat_job splats = {.volume = job->have.labels ? job->label_volume : job->source, .splats = job->have.splats, .cut = job->have.cut, .scene = job->scene,
                               .frame = job->frame};
  drawing d = {.gl = gl, .batch.unit_ns = gl->hardware ? HARDWARE_NS : SOFTWARE_NS};
  d.progress = tc_frame_cut(job->frame, (int)sqrt(gl->most), error);
  if (!d.progress || !tc_splat_appearance_make(job, &d.appearance, error)) return false;
  if (!tc_splat_frame_begin(&d.of, &splats, error)) {
    tc_splat_appearance_free(d.appearance);
    return false;
  }
  d.entries = malloc(((size_t)d.of.n_entries + 1) * sizeof *d.entries);
  if (!d.entries) tc_set_error(error, TC_ERROR_MEMORY, NULL, "splats: out of memory");
  const bool drawn = d.entries && draw_frame(&d, error);
  free(d.entries);
  tc_splat_frame_end(&d.of);
  tc_splat_appearance_free(d.appearance);
  return drawn;
}

/* Draws a brick without splats on a tile without pixels. */
static void warm(const tc_gl_frame *gl, int n_passes) {
  static const int tile[4] = {0};
  const splat_entry nothing = {0};
  tc_progress progress = {.side = BLOCK};
  drawing d = {.gl = gl, .progress = &progress};
  make_buffers(&d);
  glNamedBufferSubData(d.buffers[ENTRIES], 0, sizeof nothing, &nothing);
  glBindBufferBase(GL_SHADER_STORAGE_BUFFER, 4, d.buffers[ENTRIES]); /* no word of it is read */
  glBindBufferBase(GL_SHADER_STORAGE_BUFFER, 3, d.buffers[TABLE]);
  for (int pass = 0; pass < n_passes; pass++) {
    use(&d, pass, tile);
    if (pass % 2) glProgramUniform1ui(gl->programs[pass], 1, 0);
    glDispatchCompute(1, 1, 1);
  }
  glDeleteBuffers(N_BUFFERS, d.buffers);
}

static const char *refuses(const tc_scene *scene, bool hardware) { return NULL; }

static int passes(const tc_scene *scene) { return scene->splat.opaque ? 4 : 3; }

static int variant(const tc_scene *scene, int pass) { return pass && !scene->splat.opaque ? 3 + pass : pass; }

const tc_gl_drawer tc_gl_splat_drawer = {.passes = passes, .variant = variant, .refuses = refuses, .draw = draw, .warm = warm};
