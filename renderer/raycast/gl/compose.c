/* Putting shader pieces together. See compose.h. */
#include "renderer/raycast/gl/compose.h"

#include <stdio.h>
#include <string.h>

#include "renderer/classify/integrals.h"
#include "renderer/base/embedded.h"
#include "renderer/gl/program.h"
#include "renderer/raycast/projection.h"

#define MAX_PIECES 24 /* a program with every stage has about 20 */

typedef struct composition {
  const char *texts[MAX_PIECES];
  size_t count;
  const char *missing; /* first piece that is not in the program */
} composition;

static void add_text(composition *c, const char *text) {
  if (c->count < MAX_PIECES)
    c->texts[c->count++] = text;
  else
    c->missing = "for which there is room";
}

const char *tc_gl_piece(const char *name) { return tc_embedded_text(tc_shader_files, name); }

static void add(composition *c, const char *name) {
  const char *text = tc_gl_piece(name);
  if (text)
    add_text(c, text);
  else if (!c->missing)
    c->missing = name;
}

/* True for known keys. An unknown key must fail instead of drawing another picture. */
static bool is_built(const tc_gl_variant *v) {
  const tc_plan_key *key = &v->plan;
  bool dvr = key->mode == TC_MODE_DVR, surface = key->mode == TC_MODE_ISOSURFACE, slice = key->mode == TC_MODE_MPR;
  bool mesh = key->mode == TC_MODE_MESH, splat = key->mode == TC_MODE_SPLAT;
  bool mode = dvr || surface || slice || mesh || splat || tc_is_projection((tc_mode)key->mode);
  bool names = key->classification < TC_CLASSIFICATION_COUNT && key->order < TC_ORDER_COUNT &&
               key->filter < TC_FILTER_COUNT && key->projection < TC_PROJECTION_COUNT &&
               key->voxel_type < TC_VOXEL_TYPE_COUNT && key->shading < TC_SHADING_COUNT &&
               key->gradient < TC_GRADIENT_COUNT && key->slab <= TC_SLAB_PROJECTION_COUNT;
  bool filter = !surface || key->filter == TC_FILTER_LINEAR;
  bool labels = !key->labels || dvr || slice || mesh || splat || key->labels == TC_PLAN_GAPS;
  bool rays = key->rays <= !slice;
  return mode && names && filter && labels && rays && key->jitter <= dvr &&
         key->coherence <= (key->rays && key->skipping) && v->want_depth <= (surface || mesh || splat) &&
         v->sampled <= (mesh ? 2 : 0) && v->pass <= (splat ? 5 : mesh ? 2 : 0);
}

static const char *sampler_type(const tc_gl_variant *v) {
  static const char *const types[TC_VOXEL_TYPE_COUNT] = {[TC_U8] = "usampler2DArray",
                                                         [TC_U16] = "usampler2DArray",
                                                         [TC_I8] = "isampler2DArray",
                                                         [TC_I16] = "isampler2DArray",
                                                         [TC_F32] = "sampler2DArray"};
  return types[v->plan.voxel_type];
}

static bool has_slopes(const tc_gl_variant *v) {
  return v->plan.shading && v->plan.gradient == TC_GRADIENT_CELL && v->plan.mode == TC_MODE_DVR;
}

static void add_shading(composition *c, const tc_gl_variant *v) {
  static const char *const gradients[TC_GRADIENT_COUNT] = {"gradient_around.glsl", "gradient_central.glsl",
                                                           "gradient_cubic.glsl"};
  if (!v->plan.shading) return;
  if (!has_slopes(v)) add(c, gradients[v->plan.gradient]);
  add(c, "shading.glsl");
}

static void add_dvr(composition *c, const tc_gl_variant *v) {
  bool integrals = tc_integrals_serve((tc_classification)v->plan.classification);
  add(c, "node.glsl");
  add(c, integrals ? "integrals.glsl" : "preintegration.glsl");
  if (v->plan.skipping) add(c, "distance_map.glsl");
  add_shading(c, v);
  if (v->plan.jitter) add(c, "jitter.glsl");
  if (v->plan.rays || v->plan.jitter) add(c, "subpixel.glsl");
  if (v->plan.coherence) add(c, "coherence.glsl");
  add(c, "segment.glsl");
  if (v->plan.order == TC_FRONT_TO_BACK) add(c, "termination.glsl");
  add(c, v->plan.order == TC_FRONT_TO_BACK ? "dvr.glsl" : "back.glsl");
}

static void add_projection(composition *c, const tc_gl_variant *v) {
  add(c, v->linear_light ? "decode_srgb.glsl" : "decode_display.glsl");
  add(c, "projection.glsl");
  if (v->plan.skipping) add(c, "bounds.glsl");
  add(c, v->plan.mode == TC_MODE_AVERAGE ? "projection_average.glsl" : "projection_mip.glsl");
}

static void add_isosurface(composition *c, const tc_gl_variant *v) {
  add_shading(c, v);
  add(c, "isosurface.glsl");
}

/* The program that draws triangles into the visibility buffer. */
static unsigned compose_mesh_draw(const tc_gl_variant *v, GError **error) {
  g_autofree char *kind = g_strdup_printf("#version 450 core\n#define CLIP %d\n#define PEEL %d\n#define LABELS %d\n", v->plan.clipping,
                                          v->pass == 2, v->plan.labels);
  const char *head = tc_gl_piece("mesh_head.glsl");
  return tc_gl_program_draws((const char *[]){kind, head, tc_gl_piece("mesh_vertex.glsl")},
                             (const char *[]){kind, head, tc_gl_piece("mesh_fragment.glsl")}, 3, "mesh.draw", error);
}

/* Adds the pieces that cast rays, from the camera to the march. */
static void add_rays(composition *c, const tc_gl_variant *v) {
  static const char *const fields[TC_FILTER_COUNT] = {"field_linear.glsl", "field_cubic.glsl", "field_nearest.glsl"};
  add(c, v->plan.projection == TC_PERSPECTIVE ? "ray_perspective.glsl" : "ray_orthographic.glsl");
  add(c, "field_gather.glsl");
  add(c, fields[v->plan.filter]);
  if (v->plan.clipping) add(c, "clip.glsl");
  if (v->plan.labels || v->plan.mode == TC_MODE_DVR) add(c, "opacity_correction.glsl");
  if (v->plan.labels) add(c, "labels.glsl");
  if (v->plan.mode == TC_MODE_MPR)
    add(c, "mpr.glsl");
  else if (tc_is_projection((tc_mode)v->plan.mode))
    add_projection(c, v);
  else if (v->plan.mode == TC_MODE_ISOSURFACE)
    add_isosurface(c, v);
  else
    add_dvr(c, v);
}

static void add_splat(composition *c, const tc_gl_variant *v) {
  static const struct {
    const char *number, *text;
  } passes[] = {{"#define PASS 0\n", NULL}, {"#define PASS 1\n", "splat_pass.glsl"}, {"#define PASS 2\n", "splat_blocks.glsl"},
                {"#define PASS 3\n", "splat_pass.glsl"}, {"#define PASS 4\n", "splat_pass.glsl"}, {"#define PASS 5\n", "splat_sheet.glsl"}};
  add_text(c, passes[v->pass].number);
  add(c, "splat_head.glsl");
  if (v->plan.shading && (!v->pass || v->pass == 4)) add(c, "shading.glsl");
  if (v->pass) add(c, passes[v->pass].text);
}

/* Adds the pieces that compute and write each pixel's colour. */
static void add_picture(composition *c, const tc_gl_variant *v) {
  add(c, "bytes.glsl");
  add(c, v->linear_light ? "encode_srgb.glsl" : "encode_display.glsl");
  add(c, v->transparent ? "resolve_transparent.glsl" : "resolve_opaque.glsl");
  add(c, v->want_linear ? "write_linear.glsl" : "write_picture.glsl");
  if (v->sampled) {
    add(c, "field_gather.glsl");
    add(c, "field_linear.glsl");
    add(c, v->linear_light ? "decode_srgb.glsl" : "decode_display.glsl");
  }
  if (v->plan.mode == TC_MODE_MESH) add(c, "mesh_head.glsl");
  add(c, v->plan.mode == TC_MODE_MESH ? "mesh_shade.glsl" : v->plan.mode == TC_MODE_SPLAT ? "splat_shade.glsl" : "main.glsl");
}

unsigned tc_gl_compose(const tc_gl_variant *v, GError **error) {
  char name[96], literals[640];
  if (!is_built(v)) {
    tc_set_error(error, TC_ERROR_UNSUPPORTED, NULL, "gl: no shader is built for mode %d; use --backend cpu",
                 v->plan.mode);
    return 0;
  }
  const bool mesh = v->plan.mode == TC_MODE_MESH, splat = v->plan.mode == TC_MODE_SPLAT; /* cast no rays */
  if (mesh && v->pass) return compose_mesh_draw(v, error);
  tc_plan_key_name(&v->plan, name, sizeof name);
  composition c = {0};
  add(&c, "head.glsl");
  snprintf(literals, sizeof literals,
           "#define VOXELS %s\n#define ATLAS %d\n#define TERMINATION %d\n#define LEAP %d\n#define SLAB %d\n"
           "#define CLIP %d\n#define SHADED %d\n#define SLOPE %d\n#define SUBTABLES %d\n#define STIFF %d\n"
           "#define LABELLED %d\n#define LABELS %s\n"
           "#define NEAREST %d\n#define SEVERAL %d\n#define JITTER %d\n#define PHASE %d\n#define COHERENT %d\n"
           "#define POST %d\n#define LINEARIZED %d\n#define SECOND_ORDER %d\n#define DEPTH %d\n"
           "#define PEAK_ROUNDS %d\n#define WITHIN %d\n#define SAMPLED %d\n",
           sampler_type(v), v->atlas, v->plan.termination, v->plan.skipping, v->plan.slab, v->plan.clipping,
           v->plan.shading != TC_SHADING_NONE, has_slopes(v), v->plan.subtables, v->plan.stiff,
           v->plan.labels, v->label_signed ? "isampler2DArray" : "usampler2DArray",
           v->plan.filter == TC_FILTER_NEAREST, v->plan.rays, v->plan.jitter,
           v->plan.mode == TC_MODE_DVR && (v->plan.rays || v->plan.jitter),
           v->plan.coherence, v->plan.classification == TC_POST, v->plan.classification == TC_LINEARIZED,
           v->plan.classification == TC_PREINTEGRATED2, v->want_depth, TC_PEAK_ROUNDS, v->within, v->sampled);
  add_text(&c, literals);
  if (!mesh && !splat) add_rays(&c, v);
  if (splat) add_splat(&c, v);
  if (!v->pass) add_picture(&c, v);
  if (c.missing) {
    tc_set_error(error, TC_ERROR_INTERNAL, NULL, "gl: shader piece %s is not in this build", c.missing);
    return 0;
  }
  return tc_gl_program_compile(c.texts, c.count, name, error);
}
