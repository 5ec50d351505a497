/* tomocast convert: a volume to another format, a surface of a volume to a mesh, or a volume to a voxel model. */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "renderer/classify/labels.h"
#include "renderer/export/export.h"
#include "renderer/import/import.h"
#include "renderer/mesh/surfaces.h"
#include "renderer/splat/vmd.h"
#include "server/cli/cli.h"

#define MOST_LOSS_MM 1e-3 /* of which nothing is said */

/* The parsed arguments. */
typedef struct wanted {
  double iso, label, simplify; /* simplify: error in mm; negative: do not simplify */
  bool all_labels;
  tc_vmd_options model;
} wanted;

typedef struct arguments {
  char *iso, *label, *simplify;         /* of a mesh */
  char *threshold, *shell, *attributes; /* of a voxel model */
  char *labels_of, *user_of;            /* volumes of attributes "label" and "user" */
  char **rest;                          /* IN, OUT */
  gboolean ascii, gzip;
  bool labels; /* --labels, with a volume or without */
  int threads;
} arguments;

static bool bad_usage(GError **error, const char *what) {
  tc_set_error(error, TC_ERROR_INVALID, NULL, "%s", what);
  return false;
}

/* Parses `count` comma-separated numbers, each at least `least`. text NULL (option absent): keeps *numbers. */
static bool read_numbers(const char *option, const char *text, int count, double least, double *numbers,
                         GError **error) {
  if (!text) return true;
  char **parts = g_strsplit(text, ",", -1), *end = NULL;
  bool good = (int)g_strv_length(parts) == count;
  for (int i = 0; i < count && good; i++) {
    numbers[i] = g_ascii_strtod(parts[i], &end);
    good = end != parts[i] && !*end && !isnan(numbers[i]) && numbers[i] >= least;
  }
  g_strfreev(parts);
  if (!good && isfinite(least))
    tc_set_error(error, TC_ERROR_INVALID, NULL, "%s: must be a number of at least %g", option, least);
  else if (!good)
    tc_set_error(error, TC_ERROR_INVALID, NULL, "%s: %s expected", option, count == 2 ? "LOW,HIGH" : "a number");
  return good;
}

static bool names_model(const char *path) { return tc_export_kind_of(path) == TC_EXPORT_MODEL; }

static bool lists(const char *attributes, const char *name) {
  char **names = g_strsplit(attributes ? attributes : "", ",", -1);
  bool found = false;
  for (char **n = names; *n; n++) found = found || strcmp(g_strstrip(*n), name) == 0;
  g_strfreev(names);
  return found;
}

/* Sets the options of the model. A label volume's model holds the voxels above 0. */
static bool set_options(const arguments *a, wanted *w, GError **error) {
  double range[2] = {DBL_MIN, INFINITY};
  if (a->user_of && !lists(a->attributes, "user")) return bad_usage(error, "--user: --attributes must list user");
  if (a->labels_of && (a->threshold || a->shell) && !lists(a->attributes, "label"))
    return bad_usage(error, "--labels: --attributes must list label");
  if (!read_numbers("--threshold", a->threshold, 2, -INFINITY, range, error)) return false;
  if (!read_numbers("--iso-shell", a->shell, 1, -INFINITY, range, error)) return false;
  w->model = (tc_vmd_options){.low = range[0],
                              .high = range[1],
                              .labels = !a->threshold && !a->shell,
                              .shell = a->shell != NULL,
                              .attributes = a->attributes};
  return true;
}

/* A voxel model needs exactly one option that selects its voxels, unless it is made of another, whose voxels it has. A
 * volume of labels does where no other option selects. */
static bool check_model(const arguments *a, bool model, wanted *w, GError **error) {
  const bool own = a->labels && !a->labels_of, any = a->threshold || a->shell || a->labels || a->attributes || a->user_of;
  const int ways = (a->threshold != NULL) + (a->shell != NULL) + (own || (a->labels && !a->threshold && !a->shell));
  if (!model && any)
    return bad_usage(error, "--threshold, --labels, --iso-shell, --attributes and --user go with .vmd");
  if (!model) return true;
  if (names_model(a->rest[0]))
    return !any || bad_usage(error, "IN is a .vmd: OUT has its voxels and attributes");
  return ways == 1 ? set_options(a, w, error)
                   : bad_usage(error, "a .vmd needs its voxels: --threshold LOW,HIGH, or --labels, or --iso-shell V");
}

/* A mesh needs exactly one option that selects its surface. */
static bool check_mesh(const arguments *a, bool mesh, wanted *w, GError **error) {
  const bool from_mesh = tc_import_names_mesh(a->rest[0]);
  if (from_mesh && !mesh) return bad_usage(error, "IN is a mesh: OUT must end in .ply, .stl or .obj");
  if (from_mesh && (a->iso || a->label)) return bad_usage(error, "IN is a mesh: --iso and --label are of volumes");
  if (!mesh && (a->iso || a->label || a->simplify))
    return bad_usage(error, "--iso, --label and --simplify go with .ply, .stl or .obj");
  if (mesh && !from_mesh && !a->iso == !a->label)
    return bad_usage(error, "a surface needs --iso V, its value, or --label N, a segment");
  w->simplify = -1;
  w->all_labels = a->label && strcmp(a->label, "all") == 0;
  if (!read_numbers("--iso", a->iso, 1, -INFINITY, &w->iso, error) ||
      (!w->all_labels && !read_numbers("--label", a->label, 1, 1, &w->label, error)) ||
      !read_numbers("--simplify", a->simplify, 1, 0, &w->simplify, error))
    return false;
  if (w->label == floor(w->label) && w->label <= UINT32_MAX) return true;
  return bad_usage(error, "--label: must be a whole number below 2^32");
}

/* The volume of --labels may be left out: it becomes "". */
static void complete_labels(int argc, char **argv) {
  static char alone[] = "--labels=";
  for (int i = 1; i < argc; i++)
    if (strcmp(argv[i], "--labels") == 0 && (i + 1 == argc || argv[i + 1][0] == '-')) argv[i] = alone;
}

/* Left out: IN is the label map, also where IN follows --labels. */
static void find_labels(arguments *a) {
  a->labels = a->labels_of != NULL;
  if (a->labels && *a->labels_of && a->rest && g_strv_length(a->rest) == 1) {
    char **both = g_new0(char *, 3);
    both[0] = g_steal_pointer(&a->labels_of), both[1] = a->rest[0];
    g_free(a->rest);
    a->rest = both;
  }
  if (a->labels_of && !*a->labels_of) g_clear_pointer(&a->labels_of, g_free);
}

static bool parse(arguments *a, int argc, char **argv, wanted *w, GError **error) {
  const GOptionEntry entries[] = {
      {"iso", 0, 0, G_OPTION_ARG_FILENAME, &a->iso,
       "value of the surface, in the volume's unit: for .ply, .stl and .obj", "V"},
      {"label", 0, 0, G_OPTION_ARG_FILENAME, &a->label,
       "the smooth surface of one label of a segmentation instead, or of all, in their colours", "N|all"},
      {"simplify", 0, 0, G_OPTION_ARG_FILENAME, &a->simplify, "simplify the mesh to about this error",
       "MM"},
      {"ascii", 0, 0, G_OPTION_ARG_NONE, &a->ascii, "write .ply and .stl as text", NULL},
      {"gzip", 0, 0, G_OPTION_ARG_NONE, &a->gzip, "compress a .nrrd or .vmd (a .nii.gz always is)", NULL},
      {"threshold", 0, 0, G_OPTION_ARG_STRING, &a->threshold, "voxels of a .vmd: values from LOW to HIGH", "LOW,HIGH"},
      {"labels", 0, 0, G_OPTION_ARG_FILENAME, &a->labels_of,
       "label map of a .vmd, IN where left out: attribute label, and without another choice its voxels", "[VOLUME]"},
      {"iso-shell", 0, 0, G_OPTION_ARG_STRING, &a->shell, "voxels of a .vmd: voxels from V on, the outermost layer only", "V"},
      {"attributes", 0, 0, G_OPTION_ARG_STRING, &a->attributes,
       "what a .vmd keeps of each voxel: some of value,label,normal,user", "LIST"},
      {"user", 0, 0, G_OPTION_ARG_FILENAME, &a->user_of, "attribute user of a .vmd: whole numbers from 0 to 255", "VOLUME"},
      {"threads", 0, 0, G_OPTION_ARG_INT, &a->threads, "CPU workers (one per core)", "N"},
      {0}};
  const tcs_cli_usage usage = {"convert", "IN OUT",
                               "Writes a volume (a file, a folder or demo:NAME) as .nrrd, .mha, .nii or .nii.gz, its "
                               "surface as .ply, .stl or .obj, or an object in it as a run-length voxel model, .vmd; "
                               "the values of such a model as any of these; a mesh in .ply, .stl or .obj as another of these.",
                               entries};
  complete_labels(argc, argv);
  if (!tcs_cli_parse(&usage, argc, argv, &a->rest, error)) return false;
  find_labels(a);
  if (!a->rest || g_strv_length(a->rest) != 2)
    return bad_usage(error, "give IN and OUT; see tomocast convert --help");
  tc_export_kind kind = tc_export_kind_of(a->rest[1]);
  if (kind == TC_EXPORT_UNKNOWN)
    return bad_usage(
        error, "OUT must end in .nrrd, .mha, .nii or .nii.gz (a volume), in .ply, .stl or .obj (a surface), or in "
               ".vmd (a voxel model)");
  *w = (wanted){0};
  if (!check_model(a, kind == TC_EXPORT_MODEL, w, error) || !check_mesh(a, kind == TC_EXPORT_MESH, w, error))
    return false;
  if (a->threads < 0 || a->threads > 1024) return bad_usage(error, "--threads: must be 0 to 1024");
  return true;
}

/* ---- labels ---- */

typedef struct labels {
  const tc_volume *volume;
  tc_labels *colors;
  tc_label_boxes *boxes;
  GPtrArray *meshes;
} labels;

/* Gives all vertices one colour: the segment's, or the default of its number. */
static bool color_label(const labels *l, uint32_t label, tc_mesh *mesh, GError **error) {
  const tc_volume_desc *d = tc_volume_describe(l->volume);
  const float *rgb = l->colors->entries[(int)((label - d->intercept) / d->slope) - l->colors->base];
  uint32_t color = 0;
  for (int c = 0; c < 3; c++) color |= (uint32_t)(rgb[c] * 255 + 0.5f) << 8 * c;
  if (!tc_mesh_add_colors(mesh, error)) return false;
  for (size_t v = 0; v < mesh->n_vertices; v++) mesh->colors[v] = color;
  return true;
}

static bool add_label(labels *l, uint32_t label, const wanted *w, const tc_mesh_options *options, GError **error) {
  tc_mesh *mesh = tc_mesh_extract_label(l->volume, label, l->boxes, options, error), *full = mesh;
  if (mesh && w->simplify >= 0) {
    mesh = tc_mesh_simplify(full, w->simplify, 0, error);
    tc_mesh_free(full);
  }
  if (!mesh) return false;
  g_ptr_array_add(l->meshes, mesh);
  return !mesh->n_triangles || color_label(l, label, mesh, error);
}

static tc_mesh *extract_labels(const tc_volume *volume, const wanted *w, const tc_mesh_options *options, GError **error) {
  const tc_scene *own = tc_labels_of_colors();
  labels l = {.volume = volume, .boxes = tc_label_boxes_find(volume, options->pool, error)};
  if (!l.boxes) return NULL;
  l.meshes = g_ptr_array_new_with_free_func((GDestroyNotify)tc_mesh_free);
  l.colors = tc_labels_build(volume, own, tc_labels_key(volume, own), NULL, error);
  bool good = l.colors != NULL;
  for (int bits = 0; good && bits < l.boxes->n_values; bits++) {
    const uint32_t label = tc_mesh_label_of(tc_volume_describe(volume), bits);
    if (label && l.boxes->reach[bits][3] && (w->all_labels || label == w->label)) good = add_label(&l, label, w, options, error);
  }
  tc_mesh *all = good ? tc_mesh_join((tc_mesh *const *)l.meshes->pdata, l.meshes->len, error) : NULL;
  g_ptr_array_unref(l.meshes);
  tc_labels_free(l.colors);
  g_free(l.boxes);
  return all;
}

/* ---- one surface ---- */

static tc_mesh *extract(const tc_volume *volume, const wanted *w, const arguments *a, GError **error) {
  const tc_mesh_options options = {.normals = true, .pool = tc_pool_new(a->threads, error)};
  if (!options.pool) return NULL;
  tc_mesh *mesh = a->label ? extract_labels(volume, w, &options, error)
                           : tc_mesh_extract(volume, w->iso, &options, error);
  tc_pool_free(options.pool);
  if (!mesh || mesh->n_triangles > 0) return mesh;
  const tc_volume_stats *range = tc_volume_statistics(volume);
  tc_set_error(error, TC_ERROR_INVALID, NULL, "%s: the volume has no %s; its values are %g to %g",
               a->label ? a->label : a->iso, a->label ? "voxel of that label" : "surface of that value", range->min,
               range->max);
  g_prefix_error(error, a->label ? "--label " : "--iso ");
  tc_mesh_free(mesh);
  return NULL;
}

/* Takes ownership of the mesh. */
static bool write_mesh(tc_mesh *mesh, const wanted *w, const arguments *a, GError **error) {
  if (mesh && w->simplify >= 0 && !a->label) { /* labels were simplified one by one */
    tc_mesh *all = mesh;
    mesh = tc_mesh_simplify(all, w->simplify, 0, error);
    tc_mesh_free(all);
  }
  const bool good = mesh && tc_export_mesh(mesh, a->rest[1], a->ascii, error);
  const double loss = good ? tc_export_mesh_loss(mesh, a->rest[1]) : 0;
  if (good) printf("%s: %zu triangle%s, %zu vertices\n", a->rest[1], mesh->n_triangles, mesh->n_triangles == 1 ? "" : "s", mesh->n_vertices);
  if (loss > MOST_LOSS_MM)
    fprintf(stderr,
            "tomocast convert: so far from the origin STL's single precision moves vertices by up to %.2g mm; .ply and "
            ".obj keep them\n",
            loss);
  tc_mesh_free(mesh);
  return good;
}

static bool write_file(const tc_vmd *model, const arguments *a, GError **error) {
  GByteArray *file = tc_vmd_encode(model, a->gzip, error);
  const bool written = file && tc_export_bytes(file->data, file->len, a->rest[1], error);
  if (file) g_byte_array_unref(file);
  if (!written) return false;
  printf("%s: %" G_GUINT64_FORMAT " voxels in %" G_GUINT64_FORMAT " runs, %zu bytes in memory\n", a->rest[1],
         model->voxels, model->runs, model->total_bytes);
  return true;
}

/* path NULL: no volume, and no error. */
static bool import_beside(const char *path, tc_volume **volume, GError **error) {
  *volume = path ? tc_import(path, NULL, error) : NULL;
  return *volume || !path;
}

/* A label map that selects the voxels is the model's grid. */
static tc_vmd *make_model(const tc_volume *volume, const wanted *w, const arguments *a, GError **error) {
  tc_volume *labels = NULL, *user = NULL;
  tc_vmd_options options = w->model;
  tc_vmd *model = NULL;
  tc_pool *pool = tc_pool_new(a->threads, error);
  if (pool && import_beside(a->labels_of, &labels, error) && import_beside(a->user_of, &user, error)) {
    const bool select = labels && options.labels;
    options.value_of = select ? volume : NULL, options.label_of = labels, options.user_of = user;
    model = tc_vmd_of_volume(select ? labels : volume, &options, pool, error);
  }
  tc_volume_unref(labels);
  tc_volume_unref(user);
  tc_pool_free(pool);
  return model;
}

static bool write_model(const tc_volume *volume, const wanted *w, const arguments *a, GError **error) {
  if (tc_volume_sparse(volume)) return write_file(tc_volume_model(volume), a, error);
  tc_vmd *model = make_model(volume, w, a, error);
  const tc_volume_stats *range = tc_volume_statistics(volume);
  bool good = model != NULL;
  if (good && !model->voxels) {
    if (a->labels_of && w->model.labels)
      tc_set_error(error, TC_ERROR_INVALID, NULL, "--labels: the volume has no voxel above 0");
    else
      tc_set_error(error, TC_ERROR_INVALID, NULL, "no voxel is in that range; the volume's values are %g to %g",
                   range->min, range->max);
    good = false;
  }
  good = good && write_file(model, a, error);
  tc_vmd_free(model);
  return good;
}

/* Progress of the import, the slowest step; only on a terminal. */
static bool show_progress(void *user, double fraction) {
  fprintf(stderr, "\r\033[K%s: %.0f %%", (const char *)user, 100 * fraction);
  return true;
}

static bool convert(const arguments *a, const wanted *w, GError **error) {
  bool shows = isatty(2);
  const tc_import_options options = {.progress = shows ? show_progress : NULL, .user = a->rest[0]};
  const bool from_mesh = tc_import_names_mesh(a->rest[0]);
  tc_mesh *mesh = from_mesh ? tc_import_mesh(a->rest[0], &options, NULL, error) : NULL;
  tc_volume *volume = from_mesh ? NULL : tc_import(a->rest[0], &options, error);
  if (shows) fputs("\r\033[K", stderr);
  if (mesh) return write_mesh(mesh, w, a, error);
  if (!volume) return false;
  bool good = false;
  const tc_export_kind kind = tc_export_kind_of(a->rest[1]);
  if (tc_volume_sparse(volume) && kind != TC_EXPORT_MODEL) {
    tc_volume *model = volume;
    volume = tc_vmd_grid(model, error);
    tc_volume_unref(model);
    if (!volume) return false;
  }
  switch (kind) {
  case TC_EXPORT_MESH: good = write_mesh(extract(volume, w, a, error), w, a, error); break;
  case TC_EXPORT_MODEL: good = write_model(volume, w, a, error); break;
  case TC_EXPORT_VOLUME:
  case TC_EXPORT_UNKNOWN: good = tc_export_volume(volume, a->rest[1], a->gzip, error); break;
  }
  tc_volume_unref(volume);
  return good;
}

int tcs_cli_convert(int argc, char **argv) {
  arguments a = {0};
  GError *error = NULL;
  wanted w;
  int code = TCS_EXIT_DONE;
  if (!parse(&a, argc, argv, &w, &error))
    code = tcs_cli_fail("convert", TCS_EXIT_USAGE, error);
  else if (!convert(&a, &w, &error))
    code = tcs_cli_fail("convert", TCS_EXIT_FAILED, error);
  g_free(a.iso);
  g_free(a.label);
  g_free(a.simplify);
  g_free(a.threshold);
  g_free(a.shell);
  g_free(a.attributes);
  g_free(a.labels_of);
  g_free(a.user_of);
  g_strfreev(a.rest);
  return code;
}
