/* Sub-commands of the one binary. Each takes its own argv (argv[0] is the sub-command's name), writes its output to
 * stdout or a file and errors to stderr as one line, and returns the exit code. */
#ifndef TC_SERVER_CLI_H
#define TC_SERVER_CLI_H

#include <glib.h>
#include <stdbool.h>
#include <stddef.h>

#include "renderer/tomocast.h"

enum { TCS_EXIT_DONE = 0, TCS_EXIT_FAILED = 1, TCS_EXIT_USAGE = 2 };

int tcs_cli_serve(int argc, char **argv);   /* the daemon, until SIGTERM */
int tcs_cli_render(int argc, char **argv);  /* one picture */
int tcs_cli_info(int argc, char **argv);    /* what a file holds */
int tcs_cli_convert(int argc, char **argv); /* a volume to another format, or a surface of it to a mesh */

/* Shared by the sub-commands (options.c) ----------------------------------------------------------- */

typedef struct tcs_cli_usage {
  const char *command;         /* "render" */
  const char *arguments;       /* "VOLUME" */
  const char *summary;         /* one sentence for --help */
  const GOptionEntry *entries; /* strings as G_OPTION_ARG_FILENAME, so that GLib does not convert their encoding */
} tcs_cli_usage;

/* Parses argv; `rest` receives the arguments that are not options (free with g_strfreev). --help prints the usage and
 * exits 0. */
bool tcs_cli_parse(const tcs_cli_usage *usage, int argc, char **argv, char ***rest, GError **error);

/* Prints "tomocast COMMAND: message" as one line to stderr, frees the error and returns `code`. */
int tcs_cli_fail(const char *command, int code, GError *error);

/* Prints the contents of a mesh file as text or JSON to stdout (info_mesh.c). */
bool tcs_cli_info_mesh(const char *path, bool json, GError **error);

/* Reads a whole file, or stdin for "-", of at most `limit` bytes. The caller frees *text with g_free(). */
bool tcs_cli_read_text(const char *path, size_t limit, char **text, size_t *size, GError **error);

/* The scene of a sub-command (scene_arguments.c) --------------------------------------------------- */

typedef struct tcs_cli_scene {
  const char *file;   /* scene document, "-" for stdin; NULL: none */
  char **set;         /* "key=value", NULL-ended; NULL: none */
  const char *format; /* "png", "jpeg": overrides the document's format; NULL: the document's */
  int width, height;  /* overrides the image size; 0: no override */
} tcs_cli_scene;

/* Applies document, expressions and size in this order to *scene, which holds the defaults; null in a document restores
 * a default. *exit_code: the code to exit with on an error. */
bool tcs_cli_lay_scene(const tcs_cli_scene *from, const tc_fit *fit, tc_scene *scene, int *exit_code, GError **error);

/* Places a perspective camera `azimuth` degrees about +z from the front and `elevation` degrees upwards; at zoom 1 the
 * volume's bounding sphere just fills the picture's height. Keeps the target. */
void tcs_cli_place_camera(const tc_volume *volume, double azimuth_deg, double elevation_deg, double zoom, tc_camera *c);

#endif
