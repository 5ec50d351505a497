/* Internals of tomocast report: scenes, settings, rows of results, evaluation. One thread. */
#ifndef TC_SERVER_REPORT_H
#define TC_SERVER_REPORT_H

#include <cjson/cJSON.h>

#include "renderer/tomocast.h"
#include "server/cli/cli.h"

/* ---- scenes (report_scenes.c) ---- */

typedef struct tcs_report_scene {
  char name[48], title[96];
  char why[400]; /* what the scene tests, and the orders of convergence to expect */
  bool smooth;   /* field and transfer function are smooth along every ray, so that the expected orders hold */
  tc_volume *volume;
  bool grids; /* an object: measured in grids of several sizes, too */
  tc_scene scene; /* dvr, filter linear, front to back, one ray per pixel, no termination */
} tcs_report_scene;

/* Number of built-in scenes. */
int tcs_report_scene_count(void);
/* Makes the built-in scene `index`; *made is uninitialised before. */
bool tcs_report_scene_make(int index, tcs_report_scene *made, GError **error);
/* A user's scene: VOLUME and a scene document (NULL: the fitted defaults). */
bool tcs_report_scene_load(const char *volume, const char *document, tcs_report_scene *made, GError **error);
void tcs_report_scene_clear(tcs_report_scene *scene);

/* ---- objects (report_objects.c): several ways to draw the object above a threshold ---- */

/* Number of objects: built-in, or of a user's volume. */
int tcs_report_object_count(bool own);
/* own: the user's volume; NULL: built-in. size: of timed pictures. */
bool tcs_report_object_make(int index, tc_volume *own, int size, tcs_report_scene *made, GError **error);
/* Measures times and errors of each way: an entry of report.json's "objects", {"title", "filled": share of the grid's
 * voxels, "side", and the members of tcs_object_json()}; where object->grids, "grids" is a list of such members, each with
 * "grid": voxels to a side. NULL with *error. */
cJSON *tcs_report_object_measure(tc_renderer *renderer, const tcs_report_scene *object, int runs, int side,
                                 GError **error);

/* ---- settings (report_sweep.c) ---- */

typedef struct tcs_setting {
  tc_backend backend;
  tc_classification classification;
  tc_compositing_order order;
  tc_filter filter;
  double step, termination;
  int rays;
  bool coherence, jitter;
  int table_size, table_bits; /* 0 = chosen by the plan, single precision */
} tcs_setting;

/* Lists the settings of a scene that the plan accepts: all classifications at all steps with all numbers of rays
 * (quick: one ray); for the pre-integrated ones at three steps (quick: one) also one other member at a time varied from
 * its usual value: order, filter, jitter, coherence, termination, size and precision of the table; and the finest step
 * with a large table, which shows the table's part of the error. Settings the plan refuses are added to `left_out`
 * once: {"what", "why"}. The order is deterministic. Array of tcs_setting. */
GArray *tcs_report_settings(const tcs_report_scene *scene, bool quick, bool gl, cJSON *left_out);
void tcs_setting_apply(const tcs_setting *setting, tc_scene *scene);
/* Adds {"what", "why"} unless present. */
void tcs_report_leave_out(cJSON *left_out, const char *what, const char *why);

/* ---- rows (report_rows.c) ---- */

/* One line of results.jsonl and of the CSV. Errors are in units of full scale (1). */
typedef struct tcs_report_row {
  char key[160], scene[48], backend[8], classification[24], order[20], filter[12], kernel[64];
  double step, rays, coherence, jitter, termination;
  double table_size, table_bits; /* requested; 0 = chosen by the plan, single precision */
  double table_nodes;            /* used: entries per side, or of a table with one argument */
  double pixels, rms, rms_lo, rms_hi, p999, max, ciede, ciede_max, ssim; /* against rays through the pixel centres */
  double area_pixels, area_rms, area_rms_lo, area_rms_hi, area_p999,
      area_max;                /* against the mean over the pixel's area */
  double ended_rms, ended_max; /* from the same setting with termination 0: the error of early ray termination alone */
  double render_ms, render_ms_least; /* median and shortest of the runs, as measured */
  double anchor_ms;                  /* shortest frame of the anchor in the same batch */
  double time_ms;                    /* corrected for drift: render_ms times the scene's median anchor_ms / anchor_ms */
  double tables_ms, skip_ms;         /* building them, in the first frame */
  double runs, samples;
} tcs_report_row;

cJSON *tcs_report_row_write(const tcs_report_row *row);
bool tcs_report_row_read(const cJSON *json, tcs_report_row *row); /* false: not a row */
/* All rows with a header line: CSV by RFC 4180. */
char *tcs_report_csv(const GArray *rows);
/* Title of a setting: "post, step 0.5, 4 rays, cpu". */
char *tcs_report_row_title(const tcs_report_row *row);

/* ---- measuring (report_measure.c) ---- */

typedef struct tcs_report_options {
  bool quick, gl;
  int size;    /* side of the timed pictures, pixels */
  int side;    /* side of the compared pictures; 0 = what the reference can integrate in its time */
  int threads; /* 0 = one per core */
} tcs_report_options;

typedef struct tcs_report_bench tcs_report_bench; /* renderers and references */

tcs_report_bench *tcs_report_bench_new(const tcs_report_options *options, const tc_interrupt *stop, cJSON *left_out,
                                       GError **error);
void tcs_report_bench_free(tcs_report_bench *bench);
bool tcs_report_bench_has_gl(const tcs_report_bench *bench);
tc_renderer *tcs_report_bench_cpu(const tcs_report_bench *bench); /* owned by the bench */
/* {"cpu": device, "gl": device, "threads"}. */
cJSON *tcs_report_bench_about(const tcs_report_bench *bench);

/* Starts a scene and frees the previous one. *side: of the compared pictures; chosen if 0. */
bool tcs_report_bench_scene(tcs_report_bench *bench, tcs_report_scene *scene, int *side, GError **error);

/* Measures settings[count], whose frames take turns. A setting that a back end refuses keeps runs = 0 and is added to
 * left_out. rows[i] must have key, scene and the setting's members. False: an error, or TC_ERROR_CANCELLED. */
bool tcs_report_measure(tcs_report_bench *bench, const tcs_setting *settings, int count, tcs_report_row *rows,
                        GError **error);

/* ---- evaluation of the rows (report_summary.c) ---- */

/* Fills in time_ms of rows[first..], which belong to one scene. */
void tcs_report_steady(GArray *rows, guint first);

enum { TCS_REPORT_BOUNDS = 3 };
extern const double tcs_report_bounds[TCS_REPORT_BOUNDS]; /* 1/255, 1/1000, 1e-4 */
extern const char *const tcs_report_bound_names[TCS_REPORT_BOUNDS];

/* The rms by which rows compete: with one ray per pixel against pixel centres, with more against pixel areas. */
double tcs_report_error(const tcs_report_row *row);
double tcs_report_error_max(const tcs_report_row *row);
/* Whether only step, classification and back end differ from the usual setting. */
bool tcs_report_plain(const tcs_report_row *row);

/* Pareto front of error and time: indices of the scene's rows that no other row beats in both, fastest first. */
GArray *tcs_report_front(const GArray *rows, const char *scene);
/* Index of the fastest row within the bound (on the maximum, or on the rms); -1 = none. */
int tcs_report_cheapest(const GArray *rows, const char *scene, double bound, bool maximum);

enum { TCS_REPORT_STEPS = 16 };
/* Below this rms the error is due to single precision, not to the method. */
#define TCS_REPORT_FLOOR 1e-6

/* The rows of a classification on a scene, back end and filter with otherwise usual settings, by ascending step.
 * Returns their number. */
int tcs_report_line(const GArray *rows, const char *scene, const char *backend, const char *classification,
                    const char *filter, const tcs_report_row *line[TCS_REPORT_STEPS]);
/* Observed order of convergence with the linear filter: slope of log(rms) over log(step), over the finest three octaves
 * whose rms is above single precision. False: fewer than three steps. */
bool tcs_report_slope(const GArray *rows, const char *scene, const char *backend, const char *classification,
                      double *slope);
/* Expected order on smooth scenes, as text (NUMERICS section 4; 2 for approximate, since a segment's emission is scaled
 * to its absorption); "" for an unknown name. */
const char *tcs_report_expected(const char *classification);

/* ---- explanations (report_loss.c) ---- */

/* What is not smooth in a scene: {"knots", "jumps", "depth": optical depth of the densest value over the smallest
 * spacing}. */
cJSON *tcs_report_roughness(const tcs_report_scene *scene);
/* Explains why a scene's errors (an entry of report.json's list) fall more slowly than expected, by classification:
 * orders still rising, an error floor and its cause, roughness of the scene. Text from measured rows; "" if all orders
 * are as expected. Caller frees with g_free(). */
char *tcs_report_loss(const GArray *rows, const cJSON *scene);

cJSON *tcs_report_summary(const GArray *rows, const char *scene);
/* One sentence: the fastest setting with rms below 1/255, compared with the fastest of the first-order methods (or, if
 * it is one of these, of the others). Caller frees with g_free(). */
char *tcs_report_conclusion(const GArray *rows, const char *scene);

/* ---- the page (report_page.c over report.html and its scripts) ---- */

/* json: the text of report.json. Caller frees with g_free(). */
char *tcs_report_page(const char *json);

#endif
