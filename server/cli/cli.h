/* Sub-commands of the one binary. Each takes its own argv (argv[0] is the sub-command's name), writes what it was asked
 * for to stdout or a file, errors to stderr as one line, and returns the exit code. */
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

/* What the sub-commands share (options.c) ---------------------------------------------------------- */

typedef struct tcs_cli_usage {
  const char *command;         /* "render" */
  const char *arguments;       /* "VOLUME" */
  const char *summary;         /* one sentence for --help */
  const GOptionEntry *entries; /* texts as G_OPTION_ARG_FILENAME: no conversion of character sets */
} tcs_cli_usage;

/* Parses argv; `rest` receives what are not options (free with g_strfreev). --help prints and exits 0. */
bool tcs_cli_parse(const tcs_cli_usage *usage, int argc, char **argv, char ***rest, GError **error);

/* Prints "tomocast COMMAND: message" as one line to stderr, frees the error, gives `code` back. */
int tcs_cli_fail(const char *command, int code, GError *error);

/* What a mesh file holds, in text or JSON to stdout (info_mesh.c). */
bool tcs_cli_info_mesh(const char *path, bool json, GError **error);

/* The whole of a file, or of stdin for "-", at most `limit` bytes; freed by the caller. */
bool tcs_cli_read_text(const char *path, size_t limit, char **text, size_t *size, GError **error);

/* What the sub-commands render (scene.c) ----------------------------------------------------------- */

typedef struct tcs_cli_scene {
  const char *file;   /* scene document, "-" for stdin; NULL: none */
  char **set;         /* "key=value", NULL-ended; NULL: none */
  const char *format; /* "png", "jpeg": of the picture, whatever the document says; NULL: as it says */
  int width, height;  /* of the picture; 0: as it is */
} tcs_cli_scene;

/* Lays these over *scene, which holds the defaults; null in a document goes back to them. *exit_code: for the error. */
bool tcs_cli_lay_scene(const tcs_cli_scene *from, const tc_fit *fit, tc_scene *scene, int *exit_code, GError **error);

/* Perspective from `azimuth` degrees about +z off the front and `elevation` upwards; at zoom 1 the volume's bounding
 * sphere just fills the picture's height. The target stays. */
void tcs_cli_place_camera(const tc_volume *volume, double azimuth_deg, double elevation_deg, double zoom, tc_camera *c);

#endif
