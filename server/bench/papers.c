#include "server/bench/papers.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "server/bench/timing.h"
#include "server/cli/cli.h"

enum { MOST_CELLS = 9, PAPER_RAYS = 5, PAPER_STEPS = 120 };

typedef struct published {
  const char *volume, *dims, *cells[MOST_CELLS];
} published;

typedef struct column {
  int table;
  const char *name; /* in JSON */
  const char *head; /* in the text; NULL: appended to the previous column after a slash */
  tc_classification classification;
  tc_compositing_order order;
  bool coherence, terminate, leap;
  int block;
} column;

/* Paper 000, table 1: GeForce 560 with 1 GiB, frames/s without / with coherence. */
#define COHERENCE(text, title, c, o, t)                                                                                \
  {1, text, title, c, o, false, t, true, 0}, { 1, text ", coherence", NULL, c, o, true, t, true, 0 }
static const column columns_000[] = {
    COHERENCE("post, front-to-back", "post f-to-b", TC_POST, TC_FRONT_TO_BACK, true),
    COHERENCE("post, back-to-front", "post b-to-f", TC_POST, TC_BACK_TO_FRONT, false),
    COHERENCE("preintegrated, front-to-back", "pre f-to-b", TC_PREINTEGRATED, TC_FRONT_TO_BACK, true),
    COHERENCE("preintegrated, back-to-front", "pre b-to-f", TC_PREINTEGRATED, TC_BACK_TO_FRONT, false)};
static const published rows_000[] = {
    {"Bucky Ball", "32x32x32 u8", {"120", "142", "82", "119", "150", "152", "75", "140"}},
    {"Daisy Pollen Grain", "192x180x168 u8", {"59", "100", "58", "98", "66", "108", "66", "112"}},
    {"Engine Block", "256x256x256 u8", {"71", "118", "67", "130", "74", "110", "71", "130"}},
    {"Bonsai Tree", "512x512x154 u8", {"61", "128", "63", "89", "66", "114", "51", "90"}},
    {"Stanford Bunny", "512x512x361 u16", {"36", "92", "38", "79", "38", "47", "34", "44"}},
    {"Orange", "256x256x64 u8", {"61", "86", "75", "98", "84", "100", "60", "120"}}};

/* Paper 001, tables 1 and 2: GeForce 8500 GT. */
#define PLAIN TC_PREINTEGRATED, TC_FRONT_TO_BACK, false
#define BLOCK(n, size)                                                                                                 \
  { 2, "block " size, size "^3", PLAIN, true, true, n }
static const column columns_001[] = {{1, "none", "none", PLAIN, false, false, 0},
                                     {1, "early termination", "early", PLAIN, true, false, 0},
                                     {1, "and leaping", "+leaping", PLAIN, true, true, 0},
                                     BLOCK(128, "128"),
                                     BLOCK(64, "64"),
                                     BLOCK(32, "32"),
                                     BLOCK(16, "16"),
                                     BLOCK(8, "8"),
                                     BLOCK(4, "4")};
static const published rows_001[] = {
    {"head", "256x256x225", {"20.5", "20.7", "22.3"}},
    {"aneurysm", "512x512x512", {"18.1", "18.1", "30.6", "12.2", "20.7", "30.6", "30.6", "30.6", "23.5"}},
    {"engine", "256x256x256", {"20.0", "20.6", "23.5"}},
    {"foot", "256x256x256", {"20.1", "20.6", "23.6"}},
    {"angiography 1", "416x512x112", {"19.6", "19.8", "31.6", "12.5", "15.3", "20.4", "31.6", "20.4", "18.7"}},
    {"angiography 2", "512x512x79", {"21.1", "21.8", "27.3"}}};

typedef struct paper {
  const char *name, *title;
  const column *columns;
  int n_columns;
  const published *rows;
  int n_rows;
} paper;

static const paper papers[] = {
    {"000",
     "frames/s, 5 rays a pixel of at most 120 steps, without / with sub-pixel coherence (front to back with early "
     "termination)",
     columns_000, G_N_ELEMENTS(columns_000), rows_000, G_N_ELEMENTS(rows_000)},
    {"001",
     "frames/s without acceleration, with early termination, and with leaping too; then leaping by size of block",
     columns_001, G_N_ELEMENTS(columns_001), rows_001, G_N_ELEMENTS(rows_001)}};

static const paper *find_paper(const char *name) {
  for (size_t i = 0; i < G_N_ELEMENTS(papers); i++)
    if (!strcmp(papers[i].name, name)) return &papers[i];
  return NULL;
}

bool tcs_paper_known(const char *name) { return find_paper(name) != NULL; }

/* ---- text ---- */

static void print_line(const paper *p, const char *volume, const char *dims, const char *backend,
                       const char *const *cells) {
  printf("%-26.26s %-16.16s %-5s", volume, dims, backend);
  for (int i = 0; i < p->n_columns; i++) {
    bool paired = i + 1 < p->n_columns && !p->columns[i + 1].head;
    char text[32];
    const char *a = cells[i] ? cells[i] : "", *b = paired && cells[i + 1] ? cells[i + 1] : NULL;
    g_snprintf(text, sizeof text, "%s%s%s", a, b ? " / " : "", b ? b : "");
    printf(paired ? " %13s" : " %8s", text);
    i += paired;
  }
  if (p->columns == columns_001) { /* the paper's gain: empty-space skipping in addition to early termination */
    double early = g_ascii_strtod(cells[1], NULL), leaping = g_ascii_strtod(cells[2], NULL);
    if (early > 0 && leaping > 0)
      printf(" %+7.1f %%", 100 * (leaping / early - 1));
    else
      printf("      gain");
  }
  putchar('\n');
}

void tcs_paper_begin(const tcs_paper_run *run, cJSON *report) {
  const paper *p = find_paper(run->paper);
  cJSON *json = cJSON_CreateObject(), *list;
  const char *heads[MOST_CELLS];
  for (int i = 0; i < p->n_columns; i++) heads[i] = p->columns[i].head;
  if (run->print) {
    printf("paper %s: %s; here %dx%d pixels\n", p->name, p->title, run->size, run->size);
    print_line(p, "volume", "voxels", "", heads);
  }
  cJSON_AddStringToObject(json, "paper", p->name);
  list = cJSON_AddArrayToObject(json, "published");
  for (int r = 0; r < p->n_rows; r++) {
    cJSON *row = cJSON_CreateObject(), *cells = cJSON_AddArrayToObject(row, "cells");
    cJSON_AddStringToObject(row, "volume", p->rows[r].volume);
    cJSON_AddStringToObject(row, "voxels", p->rows[r].dims);
    for (int i = 0; i < p->n_columns && p->rows[r].cells[i]; i++) {
      cJSON *cell = cJSON_CreateObject();
      cJSON_AddStringToObject(cell, "name", p->columns[i].name);
      cJSON_AddNumberToObject(cell, "framesPerSecond", g_ascii_strtod(p->rows[r].cells[i], NULL));
      cJSON_AddItemToArray(cells, cell);
    }
    cJSON_AddItemToArray(list, row);
    if (run->print) print_line(p, p->rows[r].volume, p->rows[r].dims, "paper", p->rows[r].cells);
  }
  cJSON_AddItemToArray(report, json);
}

/* ---- measuring ---- */

typedef struct cell {
  tc_scene scene;
  double *ms;
  char *why; /* reason why it was not measured */
} cell;

/* The step at which the longest possible ray has PAPER_STEPS segments; the plan knows how rays share a step. */
static double paper_step(const tc_volume *volume, const tc_scene *scene) {
  double lo[3], hi[3], a[3], b[3], diagonal = 0;
  tc_plan plan;
  tc_volume_index_box(volume, lo, hi);
  tc_volume_index_to_lps(volume, lo, a);
  tc_volume_index_to_lps(volume, hi, b);
  for (int k = 0; k < 3; k++) diagonal += (b[k] - a[k]) * (b[k] - a[k]);
  double step = scene->sampling.step;
  if (!tc_plan_check(volume, scene, scene->image.width, scene->image.height, NULL, NULL)) return step;
  tc_plan_make(volume, scene, NULL, &plan);
  return step * sqrt(diagonal) / PAPER_STEPS / plan.step_mm;
}

static void make_cell(cell *c, const paper *p, const column *how, const tc_volume *volume, const tc_scene *scene) {
  tc_scene_copy(&c->scene, scene);
  tc_scene *s = &c->scene;
  s->classification = how->classification;
  s->order = how->order;
  s->sampling.coherence = how->coherence;
  if (!how->terminate) s->sampling.termination = 0;
  s->skipping.mode = how->leap ? TC_SKIPPING_AUTO : TC_SKIPPING_OFF;
  if (how->block) s->skipping.block = how->block;
  if (strcmp(p->name, "000")) return;
  s->sampling.rays_per_pixel = PAPER_RAYS;
  s->sampling.step = paper_step(volume, s);
}

/* Round -1 builds the resources and is not counted. */
static bool measure(tc_renderer *r, tc_volume *volume, cell *cells, int count, int runs, GError **error) {
  tc_frame frame = {0};
  bool good = true;
  for (int run = -1; run < runs && good; run++)
    for (int i = 0; i < count && good; i++) {
      GError *own = NULL;
      if (cells[i].why) continue;
      if (tc_render(r, volume, &cells[i].scene, NULL, &frame, &own)) {
        if (run >= 0) cells[i].ms[run] = frame.stats.render_ms;
      } else if (g_error_matches(own, TC_ERROR, TC_ERROR_UNSUPPORTED)) {
        cells[i].why = g_strdup(own->message);
        g_error_free(own);
      } else {
        g_propagate_error(error, own);
        good = false;
      }
    }
  tc_frame_finish(&frame);
  for (int i = 0; i < count; i++) tcs_sort(cells[i].ms, (size_t)runs);
  return good;
}

static void print_reasons(const cell *cells, int count) {
  for (int i = 0; i < count; i++) {
    bool said = !cells[i].why;
    for (int k = 0; k < i && !said; k++) said = cells[k].why && !strcmp(cells[k].why, cells[i].why);
    if (!said) printf("  -: %s\n", cells[i].why);
  }
}

static void take(const tcs_paper_run *run, const tc_volume *volume, const char *name, const char *backend,
                 const cell *cells, cJSON *report) {
  const paper *p = find_paper(run->paper);
  const tc_volume_desc *d = tc_volume_describe(volume);
  cJSON *json = cJSON_CreateObject(), *list;
  char texts[MOST_CELLS][16], dims[48];
  const char *shown[MOST_CELLS];
  cJSON_AddStringToObject(json, "paper", p->name);
  cJSON_AddStringToObject(json, "volume", name);
  cJSON_AddItemToObject(json, "dims", cJSON_CreateIntArray(d->dims, 3));
  cJSON_AddStringToObject(json, "type", tc_voxel_type_name(d->type));
  cJSON_AddStringToObject(json, "backend", backend);
  list = cJSON_AddArrayToObject(json, "cells");
  for (int i = 0; i < p->n_columns; i++) {
    double ms = cells[i].ms[run->runs / 2];
    cJSON *one = cJSON_CreateObject();
    cJSON_AddNumberToObject(one, "table", p->columns[i].table);
    cJSON_AddStringToObject(one, "name", p->columns[i].name);
    cJSON_AddNumberToObject(one, "step", cells[i].scene.sampling.step);
    cJSON_AddNumberToObject(one, "ms", cells[i].why ? NAN : ms); /* null if not measured */
    cJSON_AddNumberToObject(one, "framesPerSecond", cells[i].why ? NAN : 1000 / ms);
    if (cells[i].why) cJSON_AddStringToObject(one, "why", cells[i].why);
    cJSON_AddItemToArray(list, one);
    g_snprintf(texts[i], sizeof *texts, cells[i].why ? "-" : "%.*f", ms > 10 ? 1 : 0, 1000 / ms);
    shown[i] = texts[i];
  }
  g_snprintf(dims, sizeof dims, "%dx%dx%d %s", d->dims[0], d->dims[1], d->dims[2], tc_voxel_type_name(d->type));
  if (run->print) {
    print_line(p, name, dims, backend, shown);
    print_reasons(cells, p->n_columns);
    fflush(stdout);
  }
  cJSON_AddItemToArray(report, json);
}

bool tcs_paper_volume(const tcs_paper_run *run, tc_volume *volume, const char *name, const tc_scene *scene,
                      cJSON *report, GError **error) {
  const paper *p = find_paper(run->paper);
  bool good = true;
  for (int b = TC_BACKEND_CPU; b <= (run->gl ? TC_BACKEND_GL : TC_BACKEND_CPU) && good; b++) {
    const tc_renderer_options options = {.backend = (tc_backend)b, .threads = run->threads};
    tc_renderer *renderer = tc_renderer_new(&options, error);
    cell cells[MOST_CELLS] = {0};
    good = renderer != NULL;
    for (int i = 0; i < p->n_columns; i++) {
      make_cell(&cells[i], p, &p->columns[i], volume, scene);
      cells[i].ms = g_new0(double, (size_t)run->runs);
    }
    good = good && measure(renderer, volume, cells, p->n_columns, run->runs, error);
    if (good) take(run, volume, name, tc_renderer_about(renderer)->backend, cells, report);
    for (int i = 0; i < p->n_columns; i++) {
      tc_scene_clear(&cells[i].scene);
      g_free(cells[i].ms);
      g_free(cells[i].why);
    }
    tc_renderer_free(renderer);
  }
  return good;
}
