/* tomocast report, inside: scenes, settings, rows of results, what is made of them. All of it belongs to one thread. */
#ifndef TC_SERVER_REPORT_H
#define TC_SERVER_REPORT_H

#include <cjson/cJSON.h>

#include "renderer/tomocast.h"
#include "server/cli/cli.h"

/* ---- scenes (report_scenes.c) ---- */

typedef struct tcs_report_scene {
  char name[48], title[96];
  char why[400]; /* what it tries, and what orders of convergence to expect of it */
  bool smooth;   /* field and transfer function smooth along every ray: expected orders hold */
  tc_volume *volume;
  tc_scene scene; /* dvr, filter linear, front to back, one ray, no termination */
} tcs_report_scene;

/* How many there are built in. */
int tcs_report_scene_count(void);
/* Makes the built-in scene `index`; *made holds nothing before. */
bool tcs_report_scene_make(int index, tcs_report_scene *made, GError **error);
/* The user's own: VOLUME and a scene document (NULL: the fitted defaults). */
bool tcs_report_scene_load(const char *volume, const char *document, tcs_report_scene *made, GError **error);
void tcs_report_scene_clear(tcs_report_scene *scene);

/* ---- objects (report_objects.c): one way after another of drawing the object of a threshold ---- */

/* How many there are: built in, or of a user's own volume. */
int tcs_report_object_count(bool own);
/* own: the user's volume; NULL: built in. size: of timed pictures. */
bool tcs_report_object_make(int index, tc_volume *own, int size, tcs_report_scene *made, GError **error);
/* Times and errors of each way: an entry of report.json's "objects", {"title", "filled": share of the grid's voxels,
 * "side", and what tcs_object_json() says}. NULL with *error. */
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
  int table_size, table_bits; /* 0 = chosen, single precision */
} tcs_setting;

/* Every setting to measure of a scene that the plan accepts: all classifications at all steps with all numbers of rays
 * (quick: one ray), and of the pre-integrated ones, at three steps (quick: one), one other member at a time away from
 * its usual value: order, filter, jitter, coherence, termination, size and precision of the table; and the finest step
 * with a large table, which shows how much of the error there is the table's. What the plan refuses is said in
 * `left_out`: {"what", "why"}, each once. Order is the same every time. Array of tcs_setting. */
GArray *tcs_report_settings(const tcs_report_scene *scene, bool quick, bool gl, cJSON *left_out);
void tcs_setting_apply(const tcs_setting *setting, tc_scene *scene);
/* Adds {"what", "why"} unless it is there. */
void tcs_report_leave_out(cJSON *left_out, const char *what, const char *why);

/* ---- rows (report_rows.c) ---- */

/* One line of results.jsonl and of the CSV. Errors: units of 1 (full scale). */
typedef struct tcs_report_row {
  char key[160], scene[48], backend[8], classification[24], order[20], filter[12], kernel[64];
  double step, rays, coherence, jitter, termination;
  double table_size, table_bits; /* asked for; 0 = chosen, single precision */
  double table_nodes;            /* used, a side or of a table of one argument */
  double pixels, rms, rms_lo, rms_hi, p999, max, ciede, ciede_max, ssim; /* against rays through pixel centres */
  double area_pixels, area_rms, area_rms_lo, area_rms_hi, area_p999,
      area_max;                /* against the mean over the pixel's area */
  double ended_rms, ended_max; /* from the same setting with termination 0: what ending rays early costs by itself */
  double render_ms, render_ms_least; /* median and least of the runs, as measured */
  double anchor_ms;                  /* the anchor's least in the same batch */
  double time_ms;                    /* render_ms times the scene's usual anchor / anchor_ms: drift taken out */
  double tables_ms, skip_ms;         /* building, in the first frame */
  double runs, samples;
} tcs_report_row;

cJSON *tcs_report_row_write(const tcs_report_row *row);
bool tcs_report_row_read(const cJSON *json, tcs_report_row *row); /* false: not a row */
/* All rows with a line of names above: RFC 4180. */
char *tcs_report_csv(const GArray *rows);
/* What a setting is called in a line for people: "post, step 0.5, 4 rays, cpu". */
char *tcs_report_row_title(const tcs_report_row *row);

/* ---- measuring (report_measure.c) ---- */

typedef struct tcs_report_options {
  bool quick, gl;
  int size;    /* side of timed pictures, pixels */
  int side;    /* side of the pictures that are compared; 0 = as many pixels as the reference can do in its time */
  int threads; /* 0 = one per core */
} tcs_report_options;

typedef struct tcs_report_bench tcs_report_bench; /* renderers and references */

tcs_report_bench *tcs_report_bench_new(const tcs_report_options *options, const tc_interrupt *stop, cJSON *left_out,
                                       GError **error);
void tcs_report_bench_free(tcs_report_bench *bench);
bool tcs_report_bench_has_gl(const tcs_report_bench *bench);
tc_renderer *tcs_report_bench_cpu(const tcs_report_bench *bench); /* the bench's */
/* {"cpu": device, "gl": device, "threads"}. */
cJSON *tcs_report_bench_about(const tcs_report_bench *bench);

/* Starts a scene: forgets the last one. *side: of compared pictures; chosen when 0. */
bool tcs_report_bench_scene(tcs_report_bench *bench, tcs_report_scene *scene, int *side, GError **error);

/* Measures settings[count] side by side: their frames take turns. A setting that a back end refuses leaves its row with
 * no runs and is said in left_out. rows[i] come with key, scene and members of the setting already in. False: a true
 * failure, or TC_ERROR_CANCELLED. */
bool tcs_report_measure(tcs_report_bench *bench, const tcs_setting *settings, int count, tcs_report_row *rows,
                        GError **error);

/* ---- what follows from the rows (report_summary.c) ---- */

/* Fills time_ms of rows[first..], all of one scene. */
void tcs_report_steady(GArray *rows, guint first);

enum { TCS_REPORT_BOUNDS = 3 };
extern const double tcs_report_bounds[TCS_REPORT_BOUNDS]; /* 1/255, 1/1000, 1e-4 */
extern const char *const tcs_report_bound_names[TCS_REPORT_BOUNDS];

/* The rms by which a row competes: of one ray a pixel against pixel centres, of more against the pixel's area. */
double tcs_report_error(const tcs_report_row *row);
double tcs_report_error_max(const tcs_report_row *row);
/* Only step, classification and back end differ from the usual. */
bool tcs_report_plain(const tcs_report_row *row);

/* Indices of the scene's rows that nothing beats in both error and time, fastest first. */
GArray *tcs_report_front(const GArray *rows, const char *scene);
/* Index of the fastest row under the bound (of the maximum, or of the rms); -1 = none. */
int tcs_report_cheapest(const GArray *rows, const char *scene, double bound, bool maximum);

enum { TCS_REPORT_STEPS = 16 };
/* Under this a picture's rms is single precision's, not the method's. */
#define TCS_REPORT_FLOOR 1e-6

/* The rows of a classification on a scene and back end that are plain but for the filter, by ascending step; how many.
 */
int tcs_report_line(const GArray *rows, const char *scene, const char *backend, const char *classification,
                    const char *filter, const tcs_report_row *line[TCS_REPORT_STEPS]);
/* Observed order of the linear filter's: slope of log(rms) over log(step) over the finest three octaves whose rms is
 * above single precision. False: fewer than three steps left. */
bool tcs_report_slope(const GArray *rows, const char *scene, const char *backend, const char *classification,
                      double *slope);
/* Expected on smooth scenes (NUMERICS section 4; of approximate 2, for what a segment emits is scaled to what it
 * absorbs), as text; "" for a name that is not known. */
const char *tcs_report_expected(const char *classification);

/* ---- words (report_loss.c) ---- */

/* What in a scene is not smooth: {"knots", "jumps", "depth": of the densest value, over the smallest spacing}. */
cJSON *tcs_report_roughness(const tcs_report_scene *scene);
/* Why the errors of a scene (of report.json's list) fall more slowly than expected, or not at all, classification by
 * classification: still rising orders, a floor and whose it is, what is rough in the scene. Lines for people, from
 * measured rows; "" where all orders are as expected. g_free it. */
char *tcs_report_loss(const GArray *rows, const cJSON *scene);

cJSON *tcs_report_summary(const GArray *rows, const char *scene);
/* One sentence: the fastest setting whose rms stays under 1/255, beside the fastest of the first-order methods (or,
 * where that is one, of the others). g_free it. */
char *tcs_report_conclusion(const GArray *rows, const char *scene);

/* ---- the page (report_page.c over report.html and its scripts) ---- */

/* json: the text of report.json. g_free it. */
char *tcs_report_page(const char *json);

#endif
