/* tomocast render: one picture without a server. */
#include <limits.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "protocol/protocol.h"
#include "renderer/export/export.h"
#include "renderer/import/import.h"
#include "renderer/mesh/measure.h"
#include "renderer/quality/cost.h"
#include "renderer/quality/quality.h"
#include "renderer/tomocast.h"
#include "server/cli/cli.h"
#include "server/encode/encode.h"
#include "server/http/ray_json.h"

#define UNSET INT_MIN /* a size that is not on the command line */

typedef struct arguments {
  char *scene, *output, *labels, *backend, *tables, *isa, *ray, **set;
  int threads, width, height;
  gboolean timing;
  char **rest; /* VOLUME */
} arguments;

/* All resources of the command, released in one place. */
typedef struct job {
  arguments args;
  tc_renderer_options options;
  tc_image_format format;
  const char *output;
  tc_mesh **meshes;                  /* of the scene's surfaces, by index */
  tc_volume *volume, *labels, *body; /* body: the volume without the table, or NULL */
  tc_scene scene;
  tc_fit fit;
  tc_renderer *renderer;
  tcs_encoder *encoder;
  tc_frame frame;
  tc_explanation plan;
  GByteArray *image;
  double import_ms, encode_ms;
  int exit_code; /* exit code for the pending error */
} job;

static double now_ms(void) { return (double)g_get_monotonic_time() / 1e3; }

static bool usage_error(job *j, GError **error, const char *format, ...) G_GNUC_PRINTF(3, 4);

static bool usage_error(job *j, GError **error, const char *format, ...) {
  va_list args;
  va_start(args, format);
  char *message = g_strdup_vprintf(format, args);
  va_end(args);
  tc_set_error(error, TC_ERROR_INVALID, NULL, "%s", message);
  g_free(message);
  j->exit_code = TCS_EXIT_USAGE;
  return false;
}

/* --- command line ------------------------------------------------------------------------------- */

static bool parse_arguments(job *j, int argc, char **argv, GError **error) {
  arguments *a = &j->args;
  const GOptionEntry entries[] = {
      {"scene", 0, 0, G_OPTION_ARG_FILENAME, &a->scene, "scene document; - is stdin; without it the fitted defaults",
       "FILE"},
      {"output", 'o', 0, G_OPTION_ARG_FILENAME, &a->output, "picture to write, .png or .jpg (render.png)", "OUT"},
      {"labels", 0, 0, G_OPTION_ARG_FILENAME, &a->labels,
       "label volume; default: the scene's labels.volume, which is a path here", "VOLUME"},
      {"set", 0, 0, G_OPTION_ARG_FILENAME_ARRAY, &a->set, "change one member, as camera.fovY=40; may be repeated",
       "KEY=VALUE"},
      {"width", 0, 0, G_OPTION_ARG_INT, &a->width, "width of the picture", "PIXELS"},
      {"height", 0, 0, G_OPTION_ARG_INT, &a->height, "height of the picture", "PIXELS"},
      {"backend", 0, 0, G_OPTION_ARG_FILENAME, &a->backend, "auto, cpu or gl (auto)", "B"},
      {"tables", 0, 0, G_OPTION_ARG_FILENAME, &a->tables,
       "who builds pre-integration tables for gl: cpu or gl; auto leaves them to gl on a GPU (auto)", "B"},
      {"threads", 0, 0, G_OPTION_ARG_INT, &a->threads, "CPU workers (one per core)", "N"},
      {"isa", 0, 0, G_OPTION_ARG_FILENAME, &a->isa, "kernels to use: scalar, avx2, avx512 ... (the fastest here)", "NAME"},
      {"ray", 0, 0, G_OPTION_ARG_FILENAME, &a->ray,
       "no picture: print the ray of this pixel, sample by sample, as JSON", "X,Y"},
      {"timing", 0, 0, G_OPTION_ARG_NONE, &a->timing, "print the time of each stage", NULL},
      {0}};
  const tcs_cli_usage usage = {"render", "VOLUME", "Renders one picture of a volume: a file, a folder or demo:NAME.",
                               entries};
  j->exit_code = TCS_EXIT_USAGE;
  bool good = tcs_cli_parse(&usage, argc, argv, &a->rest, error);
  if (good && (!a->rest || g_strv_length(a->rest) != 1))
    good = usage_error(j, error, "give one VOLUME; see tomocast render --help");
  if (good) j->exit_code = TCS_EXIT_FAILED;
  return good;
}

/* Parses auto, cpu or gl; tc_backend and tc_table_builder share this order. */
static bool read_backend(job *j, const char *option, const char *name, int *which, GError **error) {
  static const char *const names[] = {[TC_BACKEND_AUTO] = "auto", [TC_BACKEND_CPU] = "cpu", [TC_BACKEND_GL] = "gl"};
  G_STATIC_ASSERT(G_N_ELEMENTS(names) == TC_BACKEND_COUNT && TC_TABLES_CPU == (int)TC_BACKEND_CPU &&
                  TC_TABLES_GL == (int)TC_BACKEND_GL);
  for (*which = 0; *which < TC_BACKEND_COUNT; ++*which)
    if (strcmp(names[*which], name ? name : "auto") == 0) return true;
  return usage_error(j, error, "--%s %s: must be auto, cpu or gl", option, name);
}

/* The file name's suffix decides the format, whatever the scene says. */
static bool read_output(job *j, GError **error) {
  const char *dot;
  j->output = j->args.output ? j->args.output : "render.png";
  dot = strrchr(j->output, '.');
  j->format = dot && g_ascii_strcasecmp(dot, ".png") == 0 ? TC_FORMAT_PNG : TC_FORMAT_JPEG;
  if (j->format == TC_FORMAT_PNG) return true;
  if (dot && (g_ascii_strcasecmp(dot, ".jpg") == 0 || g_ascii_strcasecmp(dot, ".jpeg") == 0)) return true;
  return usage_error(j, error, "-o %s: the name must end in .png or .jpg", j->output);
}

static bool check_arguments(job *j, GError **error) {
  const arguments *a = &j->args;
  int backend, tables;
  if (!read_backend(j, "backend", a->backend, &backend, error) ||
      !read_backend(j, "tables", a->tables, &tables, error) || !read_output(j, error))
    return false;
  j->options.backend = (tc_backend)backend;
  j->options.tables = (tc_table_builder)tables;
  if (a->threads < 0 || a->threads > 1024) return usage_error(j, error, "--threads: must be 0 to 1024");
  if (a->width != UNSET && a->width <= 0) return usage_error(j, error, "--width %d: must be more than 0", a->width);
  if (a->height != UNSET && a->height <= 0)
    return usage_error(j, error, "--height %d: must be more than 0", a->height);
  j->options.threads = a->threads;
  j->options.isa = a->isa;
  return true;
}

/* --- scene -------------------------------------------------------------------------------------- */

static bool make_scene(job *j, GError **error) {
  const tcs_cli_scene from = {.file = j->args.scene,
                              .set = j->args.set,
                              .width = MAX(0, j->args.width),
                              .height = MAX(0, j->args.height),
                              .format = tcs_encode_format_name(j->format)};
  tc_scene_init(&j->scene);
  tc_fit_find(&j->fit, j->volume);
  j->body = tc_fit_body(&j->fit, j->volume, NULL, NULL, NULL);
  tc_fit_windows(&j->fit, j->volume, j->body);
  tc_scene_dress(&j->scene, j->volume, &j->fit, j->body != NULL);
  j->scene.image.format = j->format;
  return tcs_cli_lay_scene(&from, &j->fit, &j->scene, &j->exit_code, error);
}

/* Replaces the volume by its body (the volume without the table) if the scene hides the table. */
static void leave_table(job *j) {
  if (!j->body || !j->scene.hide_table || j->scene.mode == TC_MODE_MPR) return;
  tc_volume_unref(j->volume);
  j->volume = j->body;
  j->body = NULL;
}

/* --- picture ------------------------------------------------------------------------------------ */

static bool load(job *j, GError **error) {
  double start = now_ms();
  j->volume = tc_import(j->args.rest[0], NULL, error);
  j->import_ms = now_ms() - start;
  return j->volume != NULL;
}

/* Without a server the id of a label volume is a path. --labels takes paths too long for an id and needs no scene
 * document. */
static bool load_labels(job *j, GError **error) {
  const char *path = j->args.labels ? j->args.labels : j->scene.labels.volume;
  if (!*path) return true;
  j->labels = tc_import(path, NULL, error);
  if (!j->labels) g_prefix_error(error, j->args.labels ? "--labels: " : "labels.volume: ");
  if (j->args.labels) g_strlcpy(j->scene.labels.volume, "labels", sizeof j->scene.labels.volume);
  return j->labels != NULL;
}

/* Without a server the id of a mesh is a path. */
static bool load_meshes(job *j, GError **error) {
  const tc_scene *s = &j->scene;
  j->meshes = g_new0(tc_mesh *, s->mesh.n_surfaces + 1);
  for (size_t i = 0; i < s->mesh.n_surfaces; i++) {
    if (s->mesh.surfaces[i].source != TC_SURFACE_OF_MESH) continue;
    j->meshes[i] = tc_import_mesh(s->mesh.surfaces[i].mesh, NULL, NULL, error);
    if (!j->meshes[i]) return false;
  }
  return true;
}

static bool make_renderer(job *j, GError **error) {
  GError *own = NULL;
  j->renderer = tc_renderer_new(&j->options, &own);
  if (j->renderer) return true;
  if (g_error_matches(own, TC_ERROR, TC_ERROR_INVALID)) j->exit_code = TCS_EXIT_USAGE;
  g_propagate_error(error, own);
  return false;
}

/* Prints the record of the ray of --ray to stdout. */
static bool print_ray(job *j, GError **error) {
  int x, y, end = 0;
  const tc_scene *s = &j->scene;
  if (sscanf(j->args.ray, "%d,%d%n", &x, &y, &end) != 2 || j->args.ray[end] || x < 0 || y < 0 || x >= s->image.width ||
      y >= s->image.height)
    return usage_error(j, error, "--ray %s: must be X,Y, a pixel of the picture of %dx%d, 0,0 at the top left",
                       j->args.ray, s->image.width, s->image.height);
  char *plain = tcs_ray_json(j->volume, j->labels, s, (int[]){x, y}, NULL, error);
  if (!plain) return false;
  cJSON *json = cJSON_Parse(plain);
  char *text = cJSON_Print(json);
  g_free(plain);
  puts(text);
  cJSON_free(text);
  cJSON_Delete(json);
  return true;
}

/* Estimates the cost of the picture from two small frames. */
static bool time_frames(job *j, tc_quality_cost *cost, GError **error) {
  tc_scene s = j->scene; /* borrows the lists of j->scene */
  const tc_render_request small = {
      .width = MAX(1, s.image.width / 2), .height = MAX(1, s.image.height / 2), .labels = j->labels};
  s.quality.max_ms = 0;
  for (int spacing = 4; spacing >= 1; spacing -= 3) {
    s.sampling.step = spacing / tc_quality_stretch(&s);
    if (!tc_render(j->renderer, j->volume, &s, &small, &j->frame, error)) return false;
    tc_quality_cost_add(cost, &s, tc_estimate_pixels(j->volume, &s, small.width, small.height),
                        j->frame.stats.render_ms);
  }
  return true;
}

/* Chooses the sampling: for quality.maxError by one measurement of this view, for maxMilliseconds also by the times of
 * two small frames. */
static bool choose_sampling(job *j, GError **error) {
  tc_scene *s = &j->scene;
  const bool timed = s->quality.max_ms > 0;
  tc_quality_cost cost = tc_quality_cost_of(tc_renderer_about(j->renderer)->backend);
  tc_quality_model model = {0};
  tc_quality_choice choice;
  tc_quality_view view;
  char reason[96];
  if (!timed && !(s->quality.max_error > 0)) return true;
  if (tc_quality_refuses(s, reason, sizeof reason)) {
    s->quality.max_error = s->quality.max_ms = 0;
    fprintf(stderr, "tomocast render: quality: %s; the scene's own sampling is taken\n", reason);
    return true;
  }
  if (timed && !time_frames(j, &cost, error)) return false;
  if (tc_quality_measures(&cost, s)) {
    const tc_quality_subject of = {j->volume, j->labels, s, &s->camera, &model, &cost, NULL};
    if (!tc_quality_measure(j->renderer, &of, &view, error)) return false;
    tc_quality_add(&model, &view);
  }
  tc_quality_choose(&model, &cost, s, tc_estimate_pixels(j->volume, s, s->image.width, s->image.height), &choice);
  tc_quality_apply(&choice, s);
  fprintf(stderr, "tomocast render: quality: %s\n", choice.reason);
  return true;
}

static bool encode(job *j, GError **error) {
  double start = now_ms();
  j->image = g_byte_array_new();
  j->encoder = tcs_encoder_new(error);
  if (!j->encoder || !tcs_encode(j->encoder, &j->frame, &j->scene, 0, j->image, error)) return false;
  j->encode_ms = now_ms() - start;
  return true;
}

/* An empty picture is no error, but its cause is said. */
static void print_emptiness(const job *j) {
  for (int i = 0; i < TC_STAGE_COUNT; i++)
    if (g_str_has_prefix(j->plan.stages[i].reason, "empty picture")) {
      fprintf(stderr, "tomocast render: %s\n", j->plan.stages[i].reason);
      return;
    }
}

static void print_timing(const job *j) {
  const tc_frame_stats *s = &j->frame.stats;
  printf("%s: %d x %d, %s %s, import %.1f ms, tables %.1f ms, skip %.1f ms, render %.1f ms, encode %.1f ms, "
         "%.2f Msamples, %.2f Mgradients\n",
         j->output, j->frame.width, j->frame.height, tc_renderer_about(j->renderer)->backend, j->plan.kernel,
         j->import_ms, s->tables_ms, s->skip_ms, s->render_ms, j->encode_ms, (double)s->samples / 1e6,
         (double)s->gradients / 1e6);
}

static bool run(job *j, int argc, char **argv, GError **error) {
  if (!parse_arguments(j, argc, argv, error) || !check_arguments(j, error)) return false;
  if (!load(j, error) || !make_scene(j, error) || !load_labels(j, error) || !load_meshes(j, error)) return false;
  leave_table(j);
  if (j->args.ray) return tc_labels_check(j->volume, j->labels, &j->scene, error) && print_ray(j, error);
  if (!make_renderer(j, error)) return false;
  if (!choose_sampling(j, error)) return false;
  const tc_render_request request = {.labels = j->labels, .meshes = j->meshes, .explanation = &j->plan};
  if (!tc_render(j->renderer, j->volume, &j->scene, &request, &j->frame, error)) return false;
  if (!encode(j, error) || !tc_export_bytes(j->image->data, j->image->len, j->output, error)) return false;
  print_emptiness(j);
  if (j->args.timing) print_timing(j);
  return true;
}

static void finish(job *j) {
  g_free(j->args.scene);
  g_free(j->args.output);
  g_free(j->args.labels);
  g_free(j->args.backend);
  g_free(j->args.tables);
  g_free(j->args.isa);
  g_free(j->args.ray);
  g_strfreev(j->args.set);
  g_strfreev(j->args.rest);
  for (size_t i = 0; j->meshes && i < j->scene.mesh.n_surfaces; i++) tc_mesh_free(j->meshes[i]);
  g_free(j->meshes);
  tc_scene_clear(&j->scene);
  tc_frame_finish(&j->frame);
  tcs_encoder_free(j->encoder);
  if (j->image) g_byte_array_free(j->image, TRUE);
  tc_renderer_free(j->renderer);
  tc_volume_unref(j->labels);
  tc_volume_unref(j->body);
  tc_volume_unref(j->volume);
}

int tcs_cli_render(int argc, char **argv) {
  job j = {.args = {.width = UNSET, .height = UNSET}, .exit_code = TCS_EXIT_FAILED};
  GError *error = NULL;
  int code = TCS_EXIT_DONE;
  if (!run(&j, argc, argv, &error)) code = tcs_cli_fail("render", j.exit_code, error);
  finish(&j);
  return code;
}
