/* The report from outside (files, resuming, interruption, the page) and what it concludes from rows. */
#include "tests/support/test.h"
#include <signal.h>
#include <sys/wait.h>

#include <glib/gstdio.h>

#include "protocol/protocol.h"
#include "server/bench/report.h"
#include "tests/support/folder.h"
#include "tests/support/scoped.h"

static char *path_of(const char *name) { return g_build_filename(folder, "out", name, NULL); }

static char *read_out(const char *name) {
  char *path = path_of(name), *text = NULL;
  if (!g_file_get_contents(path, &text, NULL, NULL)) fail_msg("%s was not written", name);
  g_free(path);
  return text;
}

static cJSON *json_out(const char *name) {
  g_autofree char *text = read_out(name);
  GError *error = NULL;
  cJSON *json = tcp_json_parse(text, strlen(text), &error);
  if (!json) fail_msg("%s: %s", name, error->message);
  return json;
}

static const char *const quick[] = {TC_BINARY_DIR "/tomocast",
                                    "report",
                                    "--quick",
                                    "--output",
                                    "out",
                                    "--volume",
                                    "a<b&c.nrrd",
                                    "--scene",
                                    "scene.json",
                                    "--size",
                                    "24",
                                    "--side",
                                    "24",
                                    "--threads",
                                    "2",

                                    NULL};

/* Exit code; *out receives stdout. */
static int run(const char *const *argv, char **out, char **err) {
  int status;
  GError *error = NULL;
  if (!g_spawn_sync(folder, (char **)argv, NULL, G_SPAWN_DEFAULT, NULL, NULL, out, err, &status, &error))
    fail_msg("%s", error->message);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

static void run_quick(int measured) {
  char *out, *err, words[64];
  int code = run(quick, &out, &err);
  if (code != 0) fail_msg("exit code %d: %s", code, err);
  g_snprintf(words, sizeof words, " %d of them measured now", measured);
  if (measured >= 0 && !strstr(out, words)) fail_msg("\"%s\" lacks \"%s\"", out, words);
  g_free(out);
  g_free(err);
}

static int lines_of(const char *text) {
  int n = 0;
  for (; *text; text++) n += *text == '\n';
  return n;
}

/* ---- the page ---- */

/* Holds report.json, and nothing that would be fetched. What it draws: tests/browser/report.test.mjs. */
static void page_is_whole(void) {
  static const char start[] = "<script type=\"application/json\" id=\"data\">";
  char *html = read_out("report.html"), *data = strstr(html, start);
  assert_non_null(data);
  const char *const outside[] = {"src=", "http:", "https:", "url(", "@import", "fetch(", "import ", "/*DATA*/"};
  for (size_t i = 0; i < G_N_ELEMENTS(outside); i++) {
    const char *at = strstr(html, outside[i]);
    if (at && strcmp(outside[i], "http:")) fail_msg("report.html holds \"%s\"", outside[i]);
    if (at && !g_str_has_prefix(at, "http://www.w3.org/2000/svg'")) fail_msg("report.html holds \"%.40s\"", at);
  }
  data += strlen(start);
  GError *error = NULL;
  cJSON *inside = tcp_json_parse(data, (size_t)(strchr(data, '<') - data), &error), *report = json_out("report.json");
  if (!inside) fail_msg("data of report.html: %s", error->message);
  assert_true(cJSON_Compare(inside, report, true));
  cJSON_Delete(inside);
  cJSON_Delete(report);
  g_free(html);
}

/* ---- files ---- */

static const tcs_report_row *row_where(const GArray *rows, double bits, double termination, double step) {
  for (guint i = 0; i < rows->len; i++) {
    const tcs_report_row *r = &g_array_index(rows, tcs_report_row, i);
    if (r->table_bits == bits && r->termination == termination && r->step == step && r->rays == 1 && !r->jitter &&
        !r->table_size && !strcmp(r->classification, "preintegrated") && !strcmp(r->filter, "linear") &&
        !strcmp(r->order, "front-to-back"))
      return r;
  }
  fail_msg("no row of %g bits, termination %g, step %g", bits, termination, step);
  return NULL;
}

static GArray *rows_of(const cJSON *report) {
  GArray *rows = g_array_new(FALSE, FALSE, sizeof(tcs_report_row));
  const cJSON *json;
  cJSON_ArrayForEach(json, cJSON_GetObjectItem(report, "results")) {
    tcs_report_row row;
    assert_true(tcs_report_row_read(json, &row));
    g_array_append_val(rows, row);
  }
  return rows;
}

/* Every way of drawing an object has its time, what the plan expects and its error: rays next to none. */
static void objects_are_judged(const cJSON *report) {
  const cJSON *objects = cJSON_GetObjectItem(report, "objects"), *object;
  assert_int_equal(cJSON_GetArraySize(objects), tcs_report_object_count(true));
  double last = 1;
  cJSON_ArrayForEach(object, objects) {
    const double filled = cJSON_GetObjectItem(object, "filled")->valuedouble;
    assert_true(filled > 0 && filled <= last); /* thresholds rise */
    last = filled;
    double rms[3];
    const char *const ways[] = {"splat", "isosurface", "mesh"};
    for (int i = 0; i < 3; i++) {
      const cJSON *ms = cJSON_GetObjectItem(object, "ms"), *expected = cJSON_GetObjectItem(object, "expectedMs"),
                  *error = cJSON_GetObjectItem(cJSON_GetObjectItem(object, "errors"), ways[i]),
                  *build = cJSON_GetObjectItem(cJSON_GetObjectItem(object, "buildMs"), ways[i]);
      assert_true(build->valuedouble >= 0 && (i < 2 || build->valuedouble > 0)); /* triangles are extracted first */
      assert_true(cJSON_GetObjectItem(ms, ways[i])->valuedouble > 0);
      assert_true(cJSON_GetObjectItem(expected, ways[i])->valuedouble > 0);
      rms[i] = cJSON_GetObjectItem(error, "rms")->valuedouble;
    }
    assert_int_equal(cJSON_GetArraySize(cJSON_GetObjectItem(object, "sizes")), 3);
    assert_true(rms[1] < 0.01 && rms[1] <= rms[0] && rms[1] <= rms[2] && rms[0] < 0.5);
  }
}

/* One object in ever larger grids costs as many splats. */
static void grids_are_swept(const cJSON *report) {
  const cJSON *grids = cJSON_GetObjectItem(cJSON_GetArrayItem(cJSON_GetObjectItem(report, "objects"), 0), "grids"), *one;
  double put = 0, side = 0;
  assert_true(cJSON_GetArraySize(grids) >= 3);
  cJSON_ArrayForEach(one, grids) {
    const double now = cJSON_GetObjectItem(cJSON_GetObjectItem(one, "samples"), "splat")->valuedouble;
    assert_true(cJSON_GetObjectItem(one, "grid")->valuedouble >= 2 * side && now > 0 && (put == 0 || now == put));
    put = now, side = cJSON_GetObjectItem(one, "grid")->valuedouble;
  }
}

/* The surface by ever fewer triangles: the full one is near the exact one, simpler ones are farther off, and the ray caster's,
 * which is last, is exact. */
static void surfaces_are_judged(const cJSON *report) {
  const cJSON *object = cJSON_GetArrayItem(cJSON_GetObjectItem(report, "objects"), 1),
              *surface = cJSON_GetObjectItem(object, "surface"), *row;
  double triangles = INFINITY, full = 0, least = 0;
  assert_true(cJSON_GetArraySize(surface) >= 4);
  cJSON_ArrayForEach(row, surface) {
    const cJSON *n = cJSON_GetObjectItem(row, "triangles");
    const double rms = cJSON_GetObjectItem(row, "depthRmsMm")->valuedouble;
    assert_true(cJSON_GetObjectItem(row, "ms")->valuedouble > 0);
    assert_true(cJSON_GetObjectItem(row, "outline")->valuedouble < 0.1);
    if (!n) {
      assert_true(!row->next && rms < 1e-3);
      continue;
    }
    assert_true(n->valuedouble <= triangles);
    triangles = n->valuedouble, least = rms;
    if (row == surface->child) full = rms;
  }
  assert_true(full > 0 && full < 0.2 && least > full);
}

TEST(reports_a_volume) {
  run_quick(-1);
  cJSON *report = json_out("report.json");
  GArray *rows = rows_of(report);
  assert_true(rows->len >= 8);
  assert_true(cJSON_IsTrue(cJSON_GetObjectItem(cJSON_GetObjectItem(report, "about"), "complete")));
  for (guint i = 0; i < rows->len; i++) {
    const tcs_report_row *r = &g_array_index(rows, tcs_report_row, i);
    assert_true(r->pixels == 24 * 24 && r->runs == 3 && r->render_ms > 0 && r->time_ms > 0);
    assert_true(r->rms >= r->rms_lo && r->rms <= r->rms_hi && r->rms <= r->max && r->p999 <= r->max &&
                r->area_p999 <= r->area_max);
    assert_true(isfinite(r->max) && r->ssim <= 1 && r->ciede <= r->ciede_max && isfinite(r->area_rms));
  }
  /* Both back ends, or the reason why not. */
  int gl = 0;
  for (guint i = 0; i < rows->len; i++) gl += !strcmp(g_array_index(rows, tcs_report_row, i).backend, "gl");
  char *text = read_out("report.json");
  assert_true(gl >= 3 || strstr(text, "gl back end"));
  g_free(text);
  /* Halving the step quarters the error; narrow tables and an early end cost what they must. */
  const tcs_report_row *usual = row_where(rows, 0, 0, 1);
  double ratio = row_where(rows, 0, 0, 2)->rms / usual->rms, half = row_where(rows, 16, 0, 1)->rms,
         byte = row_where(rows, 8, 0, 1)->rms;
  print_message("step 2 over step 1: %.2f; rms %.2g, half floats %.2g, 8 bit %.2g\n", ratio, usual->rms, half, byte);
  assert_true(ratio > 3 && ratio < 5);
  assert_true(byte > 4 * usual->rms && half < byte);
  const tcs_report_row *ended = row_where(rows, 0, 0.02, 1);
  assert_true(ended->max <= usual->max + 0.02 + 1e-6);
  assert_true(ended->ended_rms > 0 && ended->ended_rms < ended->ended_max && ended->ended_max <= 0.02 + 1e-6);
  assert_true(row_where(rows, 0, 1e-3, 1)->ended_max <= 1e-3 + 1e-6 && usual->ended_max == 0);
  objects_are_judged(report);
  grids_are_swept(report);
  surfaces_are_judged(report);
  char *csv = read_out("report.csv");
  assert_int_equal(lines_of(csv), (int)rows->len + 1);
  assert_true(g_str_has_prefix(csv, "key,scene,backend,classification,"));
  g_free(csv);
  g_array_free(rows, TRUE);
  cJSON_Delete(report);
  page_is_whole();
}

/* What is there is not measured again; a torn line is; nothing is lost. */
TEST(goes_on_where_it_ended) {
  run_quick(0);
  char *text = read_out("results.jsonl"), *path = path_of("results.jsonl");
  int before = lines_of(text);
  char *cut = text + strlen(text) - 1;
  for (int i = 0; i < 3; i++) cut = g_strrstr_len(text, cut - text, "\n");
  assert_true(g_file_set_contents(path, text, cut - text - 20, NULL)); /* three lines gone, a fourth torn */
  run_quick(4);
  g_autofree char *again = read_out("results.jsonl");
  assert_int_equal(lines_of(again), before + 1); /* the torn one stays, ended */
  assert_memory_equal(again, text, (size_t)(cut - text - 20));
  run_quick(0);
  g_free(path);
  g_free(text);
}

TEST(an_interrupt_leaves_a_report) {
  const char *const argv[] = {TC_BINARY_DIR "/tomocast",
                              "report",
                              "--output",
                              "out",
                              "--volume",
                              "a<b&c.nrrd",
                              "--size",
                              "256",
                              "--side",
                              "24",
                              "--no-gl",
                              NULL};
  GPid pid;
  char *path = path_of("results.jsonl"), *text = NULL;
  g_remove(path);
  assert_true(g_spawn_async(folder, (char **)argv, NULL,
                            G_SPAWN_DO_NOT_REAP_CHILD | G_SPAWN_STDOUT_TO_DEV_NULL | G_SPAWN_STDERR_TO_DEV_NULL, NULL,
                            NULL, &pid, NULL));
  for (int i = 0; i < 9000; i++) { /* until two rows are there: at most three minutes */
    g_usleep(20000);
    g_clear_pointer(&text, g_free);
    if (g_file_get_contents(path, &text, NULL, NULL) && lines_of(text) >= 3) break;
  }
  kill(pid, SIGINT);
  int status;
  waitpid(pid, &status, 0);
  assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 1);
  cJSON *report = json_out("report.json");
  assert_true(cJSON_IsFalse(cJSON_GetObjectItem(cJSON_GetObjectItem(report, "about"), "complete")));
  assert_true(cJSON_GetArraySize(cJSON_GetObjectItem(report, "results")) >= 2);
  cJSON_Delete(report);
  page_is_whole();
  g_free(text);
  text = read_out("results.jsonl");
  g_auto(GStrv) lines = g_strsplit(text, "\n", -1);
  for (char **line = lines; **line; line++) {
    g_autoptr(cJSON) json = tcp_json_parse(*line, strlen(*line), NULL);
    assert_non_null(json);
  }
  g_free(text);
  g_free(path);
}

TEST(bad_usage) {
  const struct {
    const char *words, *argument, *value;
  } cases[] = {
      {"--output DIR", NULL, NULL}, {"--scene S goes with", "--scene", "scene.json"}, {"--size", "--size", "3"}};
  for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
    const char *argv[] = {
        TC_BINARY_DIR "/tomocast", "report", i ? "--output" : NULL, "unused", cases[i].argument, cases[i].value, NULL};
    char *out, *err;
    assert_int_equal(run(argv, &out, &err), 2);
    if (!strstr(err, cases[i].words)) fail_msg("\"%s\" lacks \"%s\"", err, cases[i].words);
    g_free(out);
    g_free(err);
  }
}

/* ---- scenes and settings ---- */

TEST(scenes_can_be_rendered) {
  int smooth = 0, stiff = 0;
  assert_true(tcs_report_scene_count() >= 8);
  for (int i = 0; i < tcs_report_scene_count(); i++) {
    tcs_report_scene scene;
    tc_explanation plan;
    GError *error = NULL;
    if (!tcs_report_scene_make(i, &scene, &error) || !tc_explain(scene.volume, &scene.scene, 64, 64, &plan, &error))
      fail_msg("%s: %s", scene.name, error->message);
    smooth += scene.smooth;
    stiff += g_str_has_prefix(scene.title, "Stiff");
    tcs_report_scene_clear(&scene);
  }
  assert_true(smooth >= 1 && stiff >= 3);
}

/* The built-in objects fill from next to nothing to most of the grid. */
TEST(objects_grow) {
  const int ends[] = {0, tcs_report_object_count(false) - 1};
  double mean[2];
  for (int i = 0; i < 2; i++) {
    tcs_report_scene object;
    assert_true(tcs_report_object_make(ends[i], NULL, 64, &object, NULL));
    const tc_volume_desc *d = tc_volume_describe(object.volume);
    const int16_t *voxels = tc_volume_data(object.volume);
    const size_t n = (size_t)d->dims[0] * (size_t)d->dims[1] * (size_t)d->dims[2];
    size_t inside = 0;
    for (size_t v = 0; v < n; v++) inside += voxels[v] >= object.scene.splat.threshold[0];
    mean[i] = (double)inside / (double)n;
    tcs_report_scene_clear(&object);
  }
  assert_true(mean[0] > 0 && mean[0] < 0.002 && mean[1] > 0.5 && mean[1] < 0.95);
}

/* A classification is swept exactly when the plan takes it; what is refused is said. */
TEST(settings_follow_the_plan) {
  tcs_report_scene scene;
  cJSON *left_out = cJSON_CreateArray();
  assert_true(tcs_report_scene_make(0, &scene, NULL));
  GArray *settings = tcs_report_settings(&scene, false, true, left_out);
  for (int c = 0; c < TC_CLASSIFICATION_COUNT; c++) {
    g_auto(tc_scene) asked;
    tc_explanation plan;
    int found = 0;
    tc_scene_copy(&asked, &scene.scene);
    asked.classification = (tc_classification)c;
    bool taken = tc_explain(scene.volume, &asked, 64, 64, &plan, NULL);
    for (guint i = 0; i < settings->len; i++)
      found += g_array_index(settings, tcs_setting, i).classification == (tc_classification)c;
    if (taken != (found > 0)) fail_msg("classification %d: %d settings, plan says %d", c, found, taken);
    if (!taken) assert_true(cJSON_GetArraySize(left_out) > 0);
  }
  g_array_free(settings, TRUE);
  cJSON_Delete(left_out);
  tcs_report_scene_clear(&scene);
}

/* ---- conclusions ---- */

static void add(GArray *rows, double step, double ms, double rms, double anchor) {
  tcs_report_row r = {.scene = "s",
                      .backend = "cpu",
                      .classification = "preintegrated",
                      .order = "front-to-back",
                      .filter = "linear",
                      .step = step,
                      .rays = 1,
                      .runs = 3,
                      .render_ms = ms,
                      .time_ms = ms,
                      .rms = rms,
                      .max = 10 * rms,
                      .anchor_ms = anchor};
  g_snprintf(r.key, sizeof r.key, "%g-%g", step, ms);
  g_array_append_val(rows, r);
}

static void says(const GArray *rows, const char *expected) {
  g_autofree char *conclusion = tcs_report_conclusion(rows, "s");
  assert_string_equal(conclusion, expected);
}

TEST(fronts_slopes_and_cheapest) {
  GArray *rows = g_array_new(FALSE, FALSE, sizeof(tcs_report_row));
  double slope;
  assert_false(tcs_report_slope(rows, "s", "cpu", "preintegrated", &slope));
  for (int i = 0; i < 5; i++) add(rows, ldexp(4, -i), 1 << i, 0.016 * pow(0.25, i), 2);
  assert_true(tcs_report_slope(rows, "s", "cpu", "preintegrated", &slope));
  assert_true(fabs(slope - 2) < 1e-9);
  add(rows, 0.125, 40, 5e-7, 2); /* single precision's end: not part of the slope */
  assert_true(tcs_report_slope(rows, "s", "cpu", "preintegrated", &slope) && fabs(slope - 2) < 1e-9);
  add(rows, 3, 3, 0.016, 2); /* slower than step 4 and no better: not on the front */
  GArray *front = tcs_report_front(rows, "s");
  assert_int_equal(front->len, 6);
  for (guint i = 0; i < front->len; i++) assert_int_equal(g_array_index(front, guint, i), i);
  assert_int_equal(tcs_report_cheapest(rows, "s", 1.0 / 255, false), 2);
  assert_int_equal(tcs_report_cheapest(rows, "s", 1.0 / 255, true), 3);
  assert_int_equal(tcs_report_cheapest(rows, "s", 1e-8, false), -1);
  assert_int_equal(tcs_report_cheapest(rows, "other", 1, false), -1);
  g_array_free(front, TRUE);
  says(rows, "Fastest under 1/255: preintegrated, step 1, cpu (4 ms); no first-order setting comes under it.");
  add(rows, 0.5, 14, 1e-3, 2);
  g_strlcpy(g_array_index(rows, tcs_report_row, rows->len - 1).classification, "post", 24);
  says(rows,
       "Fastest under 1/255: preintegrated, step 1, cpu (4 ms), 3.5 times faster than the best first-order setting: "
       "post, step 0.5, cpu (14 ms).");
  g_array_index(rows, tcs_report_row, rows->len - 1).time_ms = 2;
  says(rows, "Fastest under 1/255: post, step 0.5, cpu (2 ms), 2 times faster than the best higher-order setting: "
             "preintegrated, step 1, cpu (4 ms).");
  g_array_set_size(rows, 2);
  says(rows, "No setting stays under 1/255; the least rms is 0.004: preintegrated, step 2, cpu (2 ms).");
  /* A batch on a machine at half its speed. */
  g_array_set_size(rows, 0);
  add(rows, 1, 5, 0.1, 2), add(rows, 1, 5, 0.1, 2), add(rows, 1, 10, 0.1, 4);
  tcs_report_steady(rows, 0);
  for (guint i = 0; i < 3; i++) assert_true(fabs(g_array_index(rows, tcs_report_row, i).time_ms - 5) < 1e-12);
  g_array_free(rows, TRUE);
}

/* Rows of a classification at steps 2, 1, 0.5, 0.25, and with a larger table at the finest (0: none). */
static void add_line(GArray *rows, const char *classification, const double rms[4], double nodes, double larger) {
  for (int i = 0; i < 5; i++) {
    if (i == 4 && larger == 0) continue;
    add(rows, ldexp(2, -MIN(i, 3)), 1, i < 4 ? rms[i] : larger, 1);
    tcs_report_row *r = &g_array_index(rows, tcs_report_row, rows->len - 1);
    g_strlcpy(r->classification, classification, sizeof r->classification);
    r->table_size = i < 4 ? 0 : 4 * nodes;
    r->table_nodes = i < 4 ? nodes : 4 * nodes;
  }
}

/* Each cause of a lost order is told from the others by the rows, and nothing is said where nothing is lost. */
TEST(losses_are_explained) {
  const struct {
    const char *classification;
    double rms[4], nodes, larger, depth;
    const char *says, *says_not; /* NULL: nothing at all */
  } cases[] = {
      {"preintegrated2", {1e-2, 1.25e-3, 1.6e-4, 2e-5}, 256, 2e-5, 0.1, NULL, NULL},
      {"approximate",
       {1e-2, 5e-3, 2.5e-3, 1.25e-3},
       0,
       0,
       0.1,
       "order 1.00, 1.00, 1.00 from octave to octave",
       "floor"},
      {"approximate", {1.6e-1, 4e-2, 1e-2, 2.5e-3}, 0, 0, 0.1, NULL, NULL},
      {"preintegrated2",
       {1e-2, 1.25e-3, 1e-3, 9.9e-4},
       256,
       1e-4,
       0.1,
       "a floor of 0.00099. It is the table's: at a step of 0.25, 1024 entries a side leave 0.0001, the usual 256 "
       "leave "
       "0.00099",
       "Not smooth"},
      {"preintegrated2", {1e-2, 1.25e-3, 1e-3, 9.9e-4}, 256, 9.8e-4, 0.1, "Not for want of entries: ", "table's"},
      {"preintegrated2",
       {1e-2, 1.25e-3, 1e-3, 9.9e-4},
       256,
       5e-3,
       0.1,
       "without the plan's subtables leave more, 0.005",
       "table's"},
      {"preintegrated2", {1e-4, 1.25e-5, 5e-6, 4.9e-6}, 256, 4.9e-6, 0.1, "Sums in single precision", "Not smooth"},
      {"preintegrated2",
       {1e-2, 2.5e-3, 6.3e-4, 1.6e-4},
       256,
       1.6e-4,
       0.1,
       "Not smooth along a ray: the interpolated field, at every cell face; the transfer function, at 3 knots",
       "floor"},
      {"preintegrated", {4e-2, 3e-2, 1.5e-2, 4e-3}, 256, 4e-3, 0.1, "Still rising", "floor"},
      {"post", {1.1e-2, 1.1e-2, 1e-2, 1e-2}, 0, 0, 1e4, "A step of 0.25 is up to 2.5e+03 deep", "Not smooth"},
      {"approximate",
       {1.6e-1, 4e-2, 2e-2, 1.9e-2},
       1024,
       1e-3,
       0.1,
       "4096 entries leave 0.001, the usual 1024 leave 0.019",
       "Not smooth"},
      {"preintegrated2", {1e-5, 1.2e-6, 5e-7, 6e-7}, 256, 0, 0.1, "fewer than three steps", "Not smooth"},
  };
  for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
    GArray *rows = g_array_new(FALSE, FALSE, sizeof(tcs_report_row));
    add_line(rows, cases[i].classification, cases[i].rms, cases[i].nodes, cases[i].larger);
    cJSON *scene = cJSON_CreateObject(), *rough = cJSON_AddObjectToObject(scene, "roughness");
    cJSON_AddStringToObject(scene, "name", "s");
    cJSON_AddNumberToObject(rough, "knots", 3);
    cJSON_AddNumberToObject(rough, "depth", cases[i].depth);
    char *loss = tcs_report_loss(rows, scene);
    if (cases[i].says ? !strstr(loss, cases[i].says) || strstr(loss, cases[i].says_not) : *loss != 0)
      fail_msg("case %zu: \"%s\"", i, loss);
    g_free(loss);
    cJSON_Delete(scene);
    g_array_free(rows, TRUE);
  }
}

/* Of a method without a table of segments that leaves less at the same step, and of another field that bends nowhere.
 */
TEST(losses_are_told_by_other_methods) {
  GArray *rows = g_array_new(FALSE, FALSE, sizeof(tcs_report_row));
  cJSON *scene = cJSON_CreateObject();
  cJSON_AddStringToObject(scene, "name", "s");
  cJSON_AddObjectToObject(scene, "roughness");
  add_line(rows, "preintegrated", (const double[]){1e-2, 2.6e-3, 1.4e-3, 1.3e-3}, 256, 1.3e-3);
  add_line(rows, "approximate", (const double[]){1e-2, 2.5e-3, 6.3e-4, 1.6e-4}, 0, 0);
  char *loss = tcs_report_loss(rows, scene);
  assert_non_null(strstr(loss, "approximate, without one of segments, leaves 0.00016 at a step of 0.25, this 0.0013"));
  assert_null(strstr(loss, "Not smooth"));
  g_free(loss);
  g_array_set_size(rows, 0);
  add_line(rows, "preintegrated2", (const double[]){1e-2, 2.5e-3, 6.3e-4, 1.6e-4}, 256, 1.6e-4);
  guint first = rows->len;
  add_line(rows, "preintegrated2", (const double[]){1e-2, 1.25e-3, 1.6e-4, 2e-5}, 256, 0);
  for (guint i = first; i < rows->len; i++) g_strlcpy(g_array_index(rows, tcs_report_row, i).filter, "cubic", 12);
  loss = tcs_report_loss(rows, scene);
  assert_non_null(
      strstr(loss, "preintegrated2 is of order 3.00 from a step of 0.5 to 0.25, under the linear one of 1.98"));
  g_free(loss);
  cJSON_Delete(scene);
  g_array_free(rows, TRUE);
}

TEST(rows_survive_json) {
  tcs_report_row row = {.key = "a \"b\",c", .scene = "s", .step = 0.5, .jitter = 1, .rms = 1.0 / 3, .ssim = NAN}, back;
  cJSON *json = tcs_report_row_write(&row);
  char *text = cJSON_PrintUnformatted(json);
  cJSON *read = tcp_json_parse(text, strlen(text), NULL);
  assert_true(tcs_report_row_read(read, &back));
  assert_string_equal(back.key, row.key);
  assert_true(back.rms == row.rms && back.jitter == 1 && isnan(back.ssim));
  GArray *rows = g_array_new(FALSE, FALSE, sizeof row);
  g_array_append_val(rows, row);
  char *csv = tcs_report_csv(rows);
  assert_non_null(strstr(csv, "\r\n\"a \"\"b\"\",c\",s,"));
  cJSON_DeleteItemFromObject(read, "rms");
  assert_false(tcs_report_row_read(read, &back));
  g_array_free(rows, TRUE);
  g_free(csv);
  cJSON_Delete(read);
  cJSON_Delete(json);
  cJSON_free(text);
}

/* ---- set-up ---- */

static int set_up(void **state) {
  enum { SIDE = 20 };
  if (make_folder(state)) return 1;
  GString *nrrd =
      g_string_new("NRRD0004\ntype: uchar\ndimension: 3\nsizes: 20 20 20\nspacings: 1 1 1\nencoding: raw\n\n");
  for (int z = 0; z < SIDE; z++)
    for (int y = 0; y < SIDE; y++)
      for (int x = 0; x < SIDE; x++) {
        double r2 = ((x - 9.5) * (x - 9.5) + (y - 9.5) * (y - 9.5) + (z - 9.5) * (z - 9.5)) / 60;
        g_string_append_c(nrrd, (char)(250 * exp(-r2)));
      }
  char *path = g_build_filename(folder, "a<b&c.nrrd", NULL);
  g_file_set_contents(path, nrrd->str, (gssize)nrrd->len, NULL);
  g_free(path);
  g_string_free(nrrd, TRUE);
  path = g_build_filename(folder, "scene.json", NULL);
  g_file_set_contents(path,
                      "{\"transferFunction\":{\"points\":[{\"value\":0,\"color\":[0.2,0.4,0.9],\"extinction\":0},"
                      "{\"value\":255,\"color\":[0.9,0.6,0.3],\"extinction\":0.5}]}}",
                      -1, NULL);
  g_free(path);
  return 0;
}

TESTS(set_up, remove_folder)
