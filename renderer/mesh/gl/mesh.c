#include "renderer/mesh/gl/mesh.h"

#include <epoxy/gl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/frame/frame.h"
#include "renderer/frame/mesh_job.h"
#include "renderer/mesh/sight.h"

#define ALIGN 256      /* of a buffer's parts, above any driver's */
#define SOFTWARE_NS 150 /* a triangle, before any was measured */
#define HARDWARE_NS 4
#define SOFTWARE_SAMPLES (1 << 19) /* take some 10 ms to shade */
#define LOOK 1024      /* clusters between two looks at the halt */
#define TRIANGLES 3    /* unit of the visibility buffer's texture (mesh_shade.glsl) */
#define LAYER 6        /* numbers a pixel of what layers gave (mesh_shade.glsl), and one for each of its samples */

/* The uniform block of mesh_head.glsl, std140. */
typedef struct mesh_block {
  _Alignas(16) float right[4];
  float down[4], depth[4], window[4], behind[4];
  float planes[12][4], offsets[TC_RASTER_SAMPLES][4];
  float centre[2], reference, scale, inverse_scale;
  int32_t perspective, n_planes, n_samples, n_clusters, normals, several, colors;
  float channels[256], to_index[3][4];
} mesh_block;

/* Surface of mesh_shade.glsl, std430. */
typedef struct gl_surface {
  float color[4], glow[2][4], factor[2], least, specular, shininess;
  int32_t shaded, n_lights, colored;
  float lights[TC_MAX_LIGHTS][2][4];
} gl_surface;

typedef struct drawing {
  const tc_gl_frame *gl;
  const tc_clusters *mesh;
  const tc_gl_lookup *buffer;
  tc_mesh_job of;
  mesh_block block;
  tc_sight *sights; /* [clusters] */
  tc_progress *progress;
  tc_gl_batch batch;
  bool translucent;
  /* GL names. ids, depths: [0] of opaque surfaces, [1] and [2] of translucent layers in turn (textures_of); each texture has an
   * array layer for each sample. buffers: the block, surfaces, what layers gave */
  unsigned vertices, target, ids[3], depths[3], buffers[3];
} drawing;

/* ---- the mesh in one buffer: indices, clusters and, of a mesh that has some, colours of corners, vertices ----
 *
 * Vertex t is the last of triangle t, so that its number tells the triangle: of a primitive's own number drivers in
 * software make each triangle apart. A mesh has about half as many vertices as triangles; others are copies, and the few
 * that no triangle has last come after all of those. */

typedef struct mesh_layout {
  size_t clusters, colors, vertices;
} mesh_layout;

static size_t aligned(size_t n) { return (n + ALIGN - 1) / ALIGN * ALIGN; }

static mesh_layout lay_out(const tc_clusters *m) {
  mesh_layout l = {.clusters = aligned(12 * m->n_triangles + 12)};
  l.colors = l.clusters + aligned(8 * m->n + 8);
  l.vertices = l.colors + (m->colors ? aligned(12 * m->n_triangles) : 0);
  return l;
}

typedef struct owners {
  int16_t of[TC_CLUSTER_VERTICES]; /* the triangle that has it last; -1: none */
  uint8_t last[TC_CLUSTER_TRIANGLES]; /* corner */
  int n_others;                    /* vertices of none */
} owners;

static void find_owners(const tc_clusters *m, const tc_cluster *k, owners *o) {
  const size_t room = tc_cluster_padded(k->n_triangles);
  const uint8_t *triangles = m->triangles + 3 * (size_t)k->triangle;
  for (int v = 0; v < k->n_vertices; v++) o->of[v] = -1;
  o->n_others = k->n_vertices;
  for (int t = 0; t < k->n_triangles; t++) {
    size_t c = 0;
    while (c < 2 && o->of[triangles[c * room + (size_t)t]] >= 0) c++;
    int16_t *of = &o->of[triangles[c * room + (size_t)t]];
    o->last[t] = (uint8_t)c;
    if (*of < 0) *of = (int16_t)t, o->n_others--;
  }
}

static size_t packed_bytes(const void *thing) {
  const tc_clusters *m = thing;
  size_t n = m->n_triangles + 1;
  owners o;
  for (size_t i = 0; i < m->n; i++) find_owners(m, &m->clusters[i], &o), n += (size_t)o.n_others;
  return lay_out(m).vertices + 16 * n;
}

static void pack_vertex(const tc_clusters *m, const tc_cluster *k, size_t v, uint32_t *to) {
  const float *at = m->positions + 3 * (size_t)k->vertex + v;
  for (size_t d = 0; d < 3; d++) memcpy(&to[d], &at[d * tc_cluster_padded(k->n_vertices)], 4);
  to[3] = m->normals ? m->normals[k->vertex + v] : 0;
}

/* first: number of its first triangle; other: of the next vertex that is none's. */
static void pack_cluster(const tc_clusters *m, const tc_cluster *k, uint32_t first, uint32_t *other, uint32_t *indices,
                         uint32_t *vertices) {
  const size_t room = tc_cluster_padded(k->n_triangles);
  const uint8_t *triangles = m->triangles + 3 * (size_t)k->triangle;
  uint32_t number[TC_CLUSTER_VERTICES];
  owners o;
  find_owners(m, k, &o);
  for (size_t v = 0; v < k->n_vertices; v++) {
    number[v] = o.of[v] >= 0 ? first + (uint32_t)o.of[v] : (*other)++;
    pack_vertex(m, k, v, vertices + 4 * (size_t)number[v]);
  }
  for (size_t t = 0; t < k->n_triangles; t++) {
    uint32_t *to = indices + 3 * (first + t);
    for (size_t c = 0; c < 2; c++) to[c] = number[triangles[(o.last[t] + 1 + c) % 3 * room + t]];
    to[2] = first + (uint32_t)t;
    pack_vertex(m, k, triangles[o.last[t] * room + t], vertices + 4 * (first + t));
  }
}

/* Of the corners of a cluster's triangles, in the order of its indices: one place for each, which a number less finds. */
static void pack_colors(const tc_clusters *m, const tc_cluster *k, uint32_t *to) {
  const size_t room = tc_cluster_padded(k->n_triangles);
  const uint8_t *triangles = m->triangles + 3 * (size_t)k->triangle;
  owners o;
  find_owners(m, k, &o);
  for (size_t t = 0; t < k->n_triangles; t++)
    for (size_t c = 0; c < 3; c++) *to++ = m->colors[k->vertex + triangles[(o.last[t] + 1 + c) % 3 * room + t]];
}

static bool pack(const void *thing, void *bytes, const tc_halt *halt) {
  const tc_clusters *m = thing;
  const mesh_layout l = lay_out(m);
  uint32_t first = 0, other = (uint32_t)m->n_triangles, *clusters = (void *)((char *)bytes + l.clusters);
  for (size_t i = 0; i < m->n; i++) {
    const tc_cluster *k = &m->clusters[i];
    if (i % LOOK == LOOK - 1 && tc_halt_within(halt)) return false;
    pack_cluster(m, k, first, &other, bytes, (void *)((char *)bytes + l.vertices));
    if (m->colors) pack_colors(m, k, (uint32_t *)(void *)((char *)bytes + l.colors) + 3 * (size_t)first);
    clusters[2 * i] = first, clusters[2 * i + 1] = k->part;
    first += k->n_triangles;
  }
  return true;
}

/* ---- a frame's constants ---- */

static void copy_row(float to[4], const double from[4]) {
  for (int k = 0; k < 4; k++) to[k] = (float)from[k];
}

/* The depth buffer's row: nearness (view.h), which is linear over the picture, from the farthest to the nearest that the
 * mesh can have, as 0 to 1. Nothing nearer than the near plane passes. */
static void set_window(const tc_mesh_view *v, const tc_clusters *mesh, mesh_block *block) {
  const double centre[3] = {mesh->centre[0], mesh->centre[1], mesh->centre[2]};
  const double r = 1.001 * (double)mesh->radius + tc_sight_slack(mesh) + v->behind;
  const double middle = tc_mesh_view_row(v->depth, centre), ref = v->reference;
  double near = middle - r, far = middle + r, out[4], a = -1, b = 0;
  if (v->perspective) {
    const double d0 = fmax(near + ref, ref * 0x1p-16), d1 = fmax(far + ref, 2 * d0);
    near = (ref - d0) / d0, far = (ref - d1) / d1;
    a = -(1 + far), b = -far * ref; /* near - far over the range, times the distance */
  } else {
    near = fmin(-near, ref), far = fmin(-far, near - 1e-6 * (1 + fabs(near)));
    b = -far;
  }
  for (int k = 0; k < 4; k++) out[k] = (a * v->depth[k] + (k == 3 ? b : 0)) / (near - far);
  copy_row(block->window, out);
  block->behind[0] = (float)far, block->behind[1] = (float)(near - far);
  block->behind[2 + v->perspective] = (float)(v->perspective ? v->behind / ref : v->behind);
}

/* From mm about the mesh's origin. */
static void set_index_rows(const drawing *d, float rows[3][4]) {
  const tc_volume *volume = d->gl->job->source;
  double index[3], moved[3], to[3];
  tc_volume_lps_to_index(volume, d->mesh->origin, index);
  for (int k = 0; k < 3; k++) rows[k][3] = (float)index[k];
  for (int axis = 0; axis < 3; axis++) {
    memcpy(moved, d->mesh->origin, sizeof moved);
    moved[axis] += 1024;
    tc_volume_lps_to_index(volume, moved, to);
    for (int k = 0; k < 3; k++) rows[k][axis] = (float)((to[k] - index[k]) / 1024);
  }
}

static void set_block(drawing *d, const mesh_layout *l) {
  const tc_mesh_view *v = &d->of.view;
  mesh_block *b = &d->block;
  copy_row(b->right, v->right), copy_row(b->down, v->down), copy_row(b->depth, v->depth);
  set_window(v, d->mesh, b);
  b->n_planes = v->n_planes - TC_VIEW_CLIP;
  for (int i = 0; i < b->n_planes; i++) copy_row(b->planes[i], v->planes[TC_VIEW_CLIP + i]);
  b->n_samples = d->of.raster.n_samples;
  for (int s = 0; s < b->n_samples; s++)
    for (int k = 0; k < 2; k++) { /* as the cpu rounds them */
      const float offset = rintf((float)(d->of.samples[s][k] + 0.5) * TC_VIEW_SUBPIXEL);
      b->offsets[s][k] = fminf(fmaxf(offset, 0), TC_VIEW_SUBPIXEL - 1) / TC_VIEW_SUBPIXEL;
    }
  b->several = d->mesh->n_parts > 1;
  b->colors = (int32_t)((l->colors - l->clusters) / 8);
  set_index_rows(d, b->to_index);
  if (d->of.raster.channels) memcpy(b->channels, d->of.raster.channels, sizeof b->channels);
  b->reference = (float)v->reference, b->scale = (float)v->scale, b->inverse_scale = (float)(1 / v->scale);
  b->centre[0] = (float)v->centre[0], b->centre[1] = (float)v->centre[1];
  b->perspective = v->perspective, b->n_clusters = (int32_t)d->mesh->n, b->normals = d->mesh->normals != NULL;
}

/* ---- GL objects of a frame ---- */

static void bind_part(int binding, unsigned buffer, size_t from, size_t to) {
  glBindBufferRange(GL_SHADER_STORAGE_BUFFER, (GLuint)binding, buffer, (GLintptr)from, (GLsizeiptr)(to - from));
}

static void make_vertices(drawing *d, const mesh_layout *l) {
  glCreateVertexArrays(1, &d->vertices);
  glEnableVertexArrayAttrib(d->vertices, 0);
  glVertexArrayAttribFormat(d->vertices, 0, 3, GL_FLOAT, GL_FALSE, 0);
  glVertexArrayAttribBinding(d->vertices, 0, 0);
  glVertexArrayVertexBuffer(d->vertices, 0, d->buffer->buffer, (GLintptr)l->vertices, 16);
  glVertexArrayElementBuffer(d->vertices, d->buffer->buffer);
}

static unsigned make_texture(unsigned format, int side, int layers) {
  unsigned texture;
  glCreateTextures(GL_TEXTURE_2D_ARRAY, 1, &texture);
  glTextureStorage3D(texture, 1, format, side, side, layers);
  glTextureParameteri(texture, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
  glTextureParameteri(texture, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
  return texture;
}

static void make_target(drawing *d, int side) {
  for (int i = 0; i < (d->translucent ? 3 : 1); i++) {
    d->ids[i] = make_texture(GL_R32UI, side, d->block.n_samples);
    d->depths[i] = make_texture(GL_DEPTH_COMPONENT32F, side, d->block.n_samples);
  }
  glCreateFramebuffers(1, &d->target);
}

static gl_surface gl_surface_of(const tc_raster_surface *s, const tc_raster_look *look) {
  gl_surface to = {.least = look->least, .specular = look->specular, .shininess = look->shininess, .shaded = look->shaded,
                   .n_lights = look->n_lights, .colored = s->textured ? 2 : s->colored};
  memcpy(to.color, s->color, sizeof s->color), to.color[3] = s->opacity;
  memcpy(to.factor, look->factor, sizeof to.factor);
  for (int i = 0; i < 2; i++) memcpy(to.glow[i], look->glow[i], sizeof look->glow[i]);
  for (int i = 0; i < look->n_lights; i++) {
    memcpy(to.lights[i][0], look->lights[i].to, sizeof look->lights[i].to);
    memcpy(to.lights[i][1], look->lights[i].color, sizeof look->lights[i].color);
    to.lights[i][0][3] = look->lights[i].at_camera;
  }
  return to;
}

static void make_buffers(drawing *d) {
  const size_t n = d->mesh->n_parts;
  gl_surface *surfaces = g_new0(gl_surface, n + 1);
  for (size_t i = 0; i < n; i++) surfaces[i] = gl_surface_of(&d->of.surfaces[i], &d->of.looks[d->of.surfaces[i].look]);
  const size_t pixels = d->translucent ? (size_t)d->progress->side * (size_t)d->progress->side : 1;
  const size_t layers = pixels * (LAYER + (size_t)d->block.n_samples);
  glCreateBuffers(3, d->buffers);
  glNamedBufferStorage(d->buffers[2], (GLsizeiptr)(layers * sizeof(float)), NULL, 0);
  glNamedBufferStorage(d->buffers[0], sizeof d->block, &d->block, 0);
  glNamedBufferStorage(d->buffers[1], (GLsizeiptr)((n + 1) * sizeof *surfaces), surfaces, 0);
  g_free(surfaces);
}

static void bind_all(drawing *d, const mesh_layout *l) {
  const unsigned buffer = d->buffer->buffer;
  bind_part(4, buffer, l->vertices, d->buffer->bytes);
  bind_part(5, buffer, 0, l->clusters);
  bind_part(6, buffer, l->clusters, l->vertices);
  for (GLuint i = 1; i < 3; i++) glBindBufferBase(GL_SHADER_STORAGE_BUFFER, 6 + i, d->buffers[i]);
  glBindBufferBase(GL_UNIFORM_BUFFER, 1, d->buffers[0]);
  glBindVertexArray(d->vertices);
  glBindFramebuffer(GL_DRAW_FRAMEBUFFER, d->target);
  glClipControl(GL_LOWER_LEFT, GL_ZERO_TO_ONE);
  glEnable(GL_DEPTH_TEST);
  glDepthFunc(GL_GREATER);
  glFrontFace(GL_CW); /* rows grow downwards */
}

static void drop_objects(drawing *d) {
  tc_gl_batch_end(&d->batch);
  glBindFramebuffer(GL_DRAW_FRAMEBUFFER, 0);
  glBindVertexArray(0);
  glDeleteFramebuffers(1, &d->target);
  glDeleteTextures(3, d->ids);
  glDeleteTextures(3, d->depths);
  glDeleteVertexArrays(1, &d->vertices);
  glDeleteBuffers(3, d->buffers);
}

/* ---- tiles ---- */

static bool in_tile(const tc_sight *s, const int tile[4]) {
  return s->x1 >= s->x0 && s->x0 < tile[0] + tile[2] && s->x1 >= tile[0] && s->y0 < tile[1] + tile[3] && s->y1 >= tile[1];
}

static bool is_in(const drawing *d, size_t i, const int tile[4], bool translucent) {
  const tc_raster_surface *surface = &d->of.surfaces[d->mesh->clusters[i].part];
  return in_tile(&d->sights[i], tile) && (surface->opacity < 1) == translucent;
}

/* Clusters of a surface that may be seen in the tile, in runs without a gap. False: halted. */
static bool draw_clusters(drawing *d, const int tile[4], bool translucent) {
  const size_t n = d->mesh->n;
  uint32_t first = 0; /* triangle of cluster i */
  for (size_t i = 0; i < n;) {
    uint32_t triangles = 0;
    size_t end = i;
    const tc_cluster *k = d->mesh->clusters;
    const double most = tc_gl_batch_most(&d->batch);
    for (; end < n && is_in(d, end, tile, translucent) && k[end].part == k[i].part && triangles < most; end++)
      triangles += k[end].n_triangles;
    if (!triangles) {
      first += k[i++].n_triangles;
      continue;
    }
    (d->of.surfaces[k[i].part].one_sided ? glEnable : glDisable)(GL_CULL_FACE);
    glDrawElements(GL_TRIANGLES, (GLsizei)(3 * triangles), GL_UNSIGNED_INT, (const void *)(12 * (size_t)first));
    if (!tc_gl_batch_add(&d->batch, triangles, d->gl->job->halt)) return false;
    d->gl->job->frame->stats.samples += triangles;
    i = end, first += triangles;
  }
  return true;
}

/* Index into ids and depths. layer: 0: opaque surfaces; then translucent layers, the nearest first. */
static int textures_of(int layer) { return layer ? 1 + layer % 2 : 0; }

static bool draw_sample(drawing *d, const int tile[4], int s, int layer) {
  const tc_mesh_view *v = &d->of.view;
  const unsigned program = d->gl->programs[layer ? 2 : 1];
  const float *offset = d->block.offsets[s];
  double place[4];
  for (int k = 0; k < 2; k++) {
    place[2 * k] = 2 * v->scale / tile[2 + k];
    place[2 * k + 1] = 2 * (v->centre[k] - tile[k] + 0.5 - (double)offset[k]) / tile[2 + k] - 1;
  }
  glNamedFramebufferTextureLayer(d->target, GL_COLOR_ATTACHMENT0, d->ids[textures_of(layer)], 0, s);
  glNamedFramebufferTextureLayer(d->target, GL_DEPTH_ATTACHMENT, d->depths[textures_of(layer)], 0, s);
  glClearNamedFramebufferuiv(d->target, GL_COLOR, 0, (const GLuint[4]){UINT32_MAX});
  glClearNamedFramebufferfv(d->target, GL_DEPTH, 0, &(GLfloat){0});
  glUseProgram(program);
  glProgramUniform4f(program, 0, (float)place[0], (float)place[1], (float)place[2], (float)place[3]);
  if (layer) glProgramUniform2i(program, 1, s, layer > 1);
  return draw_clusters(d, tile, layer > 0);
}

static bool draw_samples(drawing *d, const int tile[4], int layer) {
  glViewport(0, 0, tile[2], tile[3]);
  for (int s = 0; s < d->block.n_samples; s++)
    if (!draw_sample(d, tile, s, layer)) return false;
  return true;
}

/* Translucent layers, each behind the one before (Everitt, Interactive order-independent transparency, 2001) or as deep with a
 * higher number, until there is none. False: halted. */
static bool peel(drawing *d, const int tile[4]) {
  const unsigned program = d->gl->programs[0];
  GLuint query, any = 1;
  bool halted = false;
  glClearNamedBufferData(d->buffers[2], GL_R32UI, GL_RED_INTEGER, GL_UNSIGNED_INT, NULL);
  glCreateQueries(GL_ANY_SAMPLES_PASSED, 1, &query);
  for (int layer = 1; any && !halted; layer++) {
    glBindTextureUnit(1, d->depths[0]);
    glBindTextureUnit(2, d->depths[textures_of(layer + 1)]);
    glBindTextureUnit(TRIANGLES, d->ids[textures_of(layer + 1)]);
    glBeginQuery(GL_ANY_SAMPLES_PASSED, query);
    halted = !draw_samples(d, tile, layer);
    glEndQuery(GL_ANY_SAMPLES_PASSED);
    glGetQueryObjectuiv(query, GL_QUERY_RESULT, &any);
    halted = halted || tc_halt_within(d->gl->job->halt);
    glBindTextureUnit(TRIANGLES, d->ids[textures_of(layer)]);
    glUseProgram(program);
    glProgramUniform4i(program, 0, tile[0], tile[1], tile[2], tile[3]);
    glProgramUniform1i(program, 1, 1);
    if (!any || halted) break;
    glDispatchCompute((GLuint)(tile[2] + 7) / 8, (GLuint)(tile[3] + 7) / 8, 1);
    glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT);
    glFinish(); /* some milliseconds, which no batch counts */
    halted = tc_halt_within(d->gl->job->halt);
  }
  glDeleteQueries(1, &query);
  return !halted;
}

static bool draw_tile(void *user, const int tile[4], GError **error) {
  drawing *d = user;
  if (!draw_samples(d, tile, 0) || (d->translucent && !peel(d, tile))) return tc_halt_say(d->gl->job->halt, error);
  glBindTextureUnit(TRIANGLES, d->ids[0]);
  glProgramUniform1i(d->gl->programs[0], 1, d->translucent ? 2 : 0);
  return true;
}

/* ---- a frame ---- */

static void look_at_clusters(drawing *d) {
  tc_frame_stats *stats = &d->gl->job->frame->stats;
  const double slack = tc_sight_slack(d->mesh);
  bool away;
  for (size_t i = 0; i < d->mesh->n; i++) {
    const tc_cluster *k = &d->mesh->clusters[i];
    const bool chosen = k->level == (d->of.levels ? d->of.levels[k->group] : 0);
    d->sights[i] = (tc_sight){.x0 = 0, .x1 = -1};
    if (chosen) d->sights[i] = tc_sight_of(&d->of.view, k, slack, d->of.surfaces[k->part].one_sided, &away);
    stats->leaps += chosen && d->sights[i].x1 < d->sights[i].x0;
  }
}

static int passes(const tc_scene *scene) {
  for (size_t i = 0; i < scene->mesh.n_surfaces; i++)
    if (tc_mesh_surface_shows(&scene->mesh.surfaces[i]) && scene->mesh.surfaces[i].opacity < 1) return 3;
  return 2;
}

int64_t tc_gl_mesh_most_bytes;
bool tc_gl_mesh_peels_in_software;

/* Whether shaders can read each part of it. */
static bool fits(const tc_clusters *mesh, const mesh_layout *l, GError **error) {
  GLint64 most = 0;
  glGetInteger64v(GL_MAX_SHADER_STORAGE_BLOCK_SIZE, &most);
  if (tc_gl_mesh_most_bytes) most = MIN(most, tc_gl_mesh_most_bytes);
  const size_t vertices = 16 * (mesh->n_triangles + 1), largest = MAX(MAX(vertices, l->clusters), l->vertices - l->clusters);
  if (largest <= (size_t)most) return true;
  tc_set_error(error, TC_ERROR_LIMIT, "/mesh",
               "surface mesh: %.1f million triangles take %.0f MiB, a buffer of this OpenGL holds %.0f: show fewer surfaces, "
               "or start with --backend cpu",
               (double)mesh->n_triangles * 1e-6, (double)largest / 0x1p20, (double)most / 0x1p20);
  return false;
}

static bool draw_frame(drawing *d, GError **error) {
  const tc_frame_job *job = d->gl->job;
  const mesh_layout l = lay_out(d->mesh);
  if (!fits(d->mesh, &l, error)) return false;
  const uint64_t volume = tc_volume_serial(job->have.labels ? job->label_volume : job->source);
  const tc_gl_packing packing = {"surface mesh", packed_bytes, pack, d->mesh};
  d->buffer = tc_gl_textures_packed(d->gl->textures, &packing, d->mesh->serial, volume, job->halt, error);
  if (!d->buffer) return false;
  d->translucent = passes(job->scene) > 2;
  set_block(d, &l);
  look_at_clusters(d);
  make_vertices(d, &l);
  make_target(d, d->progress->side);
  make_buffers(d);
  bind_all(d, &l);
  const bool drawn = tc_gl_check("mesh", error) && tc_gl_draw_tiles(d->gl, draw_tile, d, error);
  if (!*d->gl->lost) drop_objects(d);
  return drawn && tc_gl_check("mesh", error);
}

/* Of a tile, whose samples one dispatch shades. */
static int tile_side(const tc_gl_frame *gl, int n_samples) {
  int side = (int)sqrt(gl->most);
  while (!gl->hardware && side * side > SOFTWARE_SAMPLES / n_samples) side /= 2;
  return side;
}

static bool draw(const tc_gl_frame *gl, GError **error) {
  drawing d = {.gl = gl, .mesh = gl->job->have.mesh, .batch.unit_ns = gl->hardware ? HARDWARE_NS : SOFTWARE_NS};
  d.progress = tc_frame_cut(gl->job->frame, tile_side(gl, gl->job->rays->count), error);
  if (!d.progress || !tc_mesh_job_begin(&d.of, gl->job, error)) return false;
  d.sights = malloc((d.mesh->n + 1) * sizeof *d.sights);
  if (!d.sights) tc_set_error(error, TC_ERROR_MEMORY, NULL, "clusters in view: out of memory");
  const bool drawn = d.sights && draw_frame(&d, error);
  free(d.sights);
  tc_mesh_job_end(&d.of);
  return drawn;
}

/* A triangle of no size. */
static void warm(const tc_gl_frame *gl, int n_passes) {
  static const int tile[4] = {0, 0, 8, 8};
  tc_cluster cluster = {.n_triangles = 1};
  const tc_clusters mesh = {.clusters = &cluster, .n = 1, .n_triangles = 1, .n_parts = 1};
  const mesh_layout l = lay_out(&mesh);
  tc_gl_lookup buffer = {.bytes = l.vertices + 32};
  tc_raster_surface surface = {.opacity = 1};
  tc_raster_look look = {0};
  tc_sight sight = {0};
  tc_frame frame = {0};
  const tc_frame_job job = {.frame = &frame};
  tc_gl_frame own = *gl;
  tc_progress progress = {.side = (int)sqrt(gl->most)};
  drawing d = {.gl = &own, .mesh = &mesh, .buffer = &buffer, .of.surfaces = &surface, .of.looks = &look, .block.n_samples = 1, .sights = &sight,
               .progress = &progress, .batch.unit_ns = SOFTWARE_NS, .translucent = n_passes > 2};
  own.job = &job;
  glCreateBuffers(1, &buffer.buffer);
  glNamedBufferStorage(buffer.buffer, (GLsizeiptr)buffer.bytes, NULL, 0);
  glClearNamedBufferData(buffer.buffer, GL_R32UI, GL_RED_INTEGER, GL_UNSIGNED_INT, NULL);
  make_vertices(&d, &l);
  make_target(&d, progress.side);
  make_buffers(&d);
  bind_all(&d, &l);
  draw_samples(&d, tile, 0);
  surface.opacity = 0.5f;
  if (d.translucent) peel(&d, tile);
  glBindTextureUnit(TRIANGLES, d.ids[0]);
  glUseProgram(gl->programs[0]);
  glProgramUniform4i(gl->programs[0], 0, 0, 0, 0, 0);
  glDispatchCompute(1, 1, 1);
  drop_objects(&d);
  glDeleteBuffers(1, &buffer.buffer);
}

/* Slices show the volume. */
static bool samples(const tc_scene *scene) {
  for (size_t i = 0; i < scene->mesh.n_surfaces; i++)
    if (scene->mesh.surfaces[i].source == TC_SURFACE_OF_PLANE && tc_mesh_surface_shows(&scene->mesh.surfaces[i])) return true;
  return false;
}

/* In software a peel of the head's skin and bone takes 500 times as long as the cpu's one pass. */
static const char *refuses(const tc_scene *scene, bool hardware) {
  const bool slow = passes(scene) > 2 && !hardware && !tc_gl_mesh_peels_in_software;
  return slow ? "OpenGL in software would draw the mesh anew for each translucent layer" : NULL;
}

const tc_gl_drawer tc_gl_mesh_drawer = {.passes = passes, .samples = samples, .refuses = refuses, .draw = draw, .warm = warm};
