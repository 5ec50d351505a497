/* tomocast convert: a volume to another format, or an isosurface of it to a mesh. */
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "renderer/export/export.h"
#include "renderer/import/import.h"
#include "server/cli/cli.h"

typedef struct arguments {
  char *iso, **rest; /* rest: IN, OUT */
  gboolean ascii, gzip;
  int threads;
} arguments;

static bool bad_usage(GError **error, const char *what) {
  tc_set_error(error, TC_ERROR_INVALID, NULL, "%s", what);
  return false;
}

static bool parse(arguments *a, int argc, char **argv, double *iso, GError **error) {
  const GOptionEntry entries[] = {
      {"iso", 0, 0, G_OPTION_ARG_FILENAME, &a->iso,
       "value of the surface, in the volume's unit: for .ply, .stl and .obj", "V"},
      {"ascii", 0, 0, G_OPTION_ARG_NONE, &a->ascii, "write .ply and .stl as text", NULL},
      {"gzip", 0, 0, G_OPTION_ARG_NONE, &a->gzip, "compress a .nrrd (a .nii.gz always is)", NULL},
      {"threads", 0, 0, G_OPTION_ARG_INT, &a->threads, "CPU workers (one per core)", "N"},
      {0}};
  const tcs_cli_usage usage = {"convert", "IN OUT",
                               "Writes a volume (a file, a folder or demo:NAME) as .nrrd, .mha, .nii or .nii.gz, or "
                               "its surface as .ply, .stl or .obj.",
                               entries};
  char *end;
  if (!tcs_cli_parse(&usage, argc, argv, &a->rest, error)) return false;
  if (!a->rest || g_strv_length(a->rest) != 2)
    return bad_usage(error, "IN and OUT are wanted; see tomocast convert --help");
  tc_export_kind kind = tc_export_kind_of(a->rest[1]);
  if (kind == TC_EXPORT_UNKNOWN)
    return bad_usage(error,
                     "OUT must end in .nrrd, .mha, .nii or .nii.gz (a volume), or in .ply, .stl or .obj (a surface)");
  if (kind == TC_EXPORT_MESH && !a->iso) return bad_usage(error, "a surface wants --iso V, its value");
  if (kind == TC_EXPORT_VOLUME && a->iso) return bad_usage(error, "--iso goes with .ply, .stl or .obj");
  if (a->threads < 0 || a->threads > 1024) return bad_usage(error, "--threads: 0 to 1024 is wanted");
  *iso = a->iso ? g_ascii_strtod(a->iso, &end) : 0;
  return !a->iso || (end != a->iso && !*end) || bad_usage(error, "--iso: a number is wanted");
}

static bool write_surface(const tc_volume *volume, double iso, const arguments *a, GError **error) {
  tc_mesh_options options = {.normals = true, .pool = tc_pool_new(a->threads, error)};
  if (!options.pool) return false;
  const tc_volume_stats *range = tc_volume_statistics(volume);
  tc_mesh *mesh = tc_mesh_extract(volume, iso, &options, error);
  bool good = mesh != NULL;
  tc_pool_free(options.pool);
  if (good && mesh->n_triangles == 0) {
    tc_set_error(error, TC_ERROR_INVALID, NULL,
                 "--iso %g: the volume has no surface of that value; its values are %g to %g", iso, range->min,
                 range->max);
    good = false;
  }
  good = good && tc_export_mesh(mesh, a->rest[1], a->ascii, error);
  if (good) printf("%s: %zu triangles, %zu vertices\n", a->rest[1], mesh->n_triangles, mesh->n_vertices);
  tc_mesh_free(mesh);
  return good;
}

/* Loading takes longest: shown where somebody looks. */
static bool show_progress(void *user, double fraction) {
  fprintf(stderr, "\r\033[K%s: %.0f %%", (const char *)user, 100 * fraction);
  return true;
}

static bool convert(const arguments *a, double iso, GError **error) {
  bool shows = isatty(2);
  const tc_import_options options = {.progress = shows ? show_progress : NULL, .user = a->rest[0]};
  tc_volume *volume = tc_import(a->rest[0], &options, error);
  if (shows) fputs("\r\033[K", stderr);
  if (!volume) return false;
  bool good = tc_export_kind_of(a->rest[1]) == TC_EXPORT_MESH ? write_surface(volume, iso, a, error)
                                                              : tc_export_volume(volume, a->rest[1], a->gzip, error);
  tc_volume_unref(volume);
  return good;
}

int tcs_cli_convert(int argc, char **argv) {
  arguments a = {0};
  GError *error = NULL;
  double iso;
  int code = TCS_EXIT_DONE;
  if (!parse(&a, argc, argv, &iso, &error))
    code = tcs_cli_fail("convert", TCS_EXIT_USAGE, error);
  else if (!convert(&a, iso, &error))
    code = tcs_cli_fail("convert", TCS_EXIT_FAILED, error);
  g_free(a.iso);
  g_strfreev(a.rest);
  return code;
}
