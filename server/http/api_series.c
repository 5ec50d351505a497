/* Lists the DICOM series of a file or folder without loading them. */
#include "server/catalogue/catalogue.h"
#include "server/config/config.h"
#include "server/http/work.h"
#include "server/memory/budget.h"

#define MOST_LOOKS 64 /* limit on waiting requests */

typedef struct look {
  tcs_work work;
  tcs_budget *budget;
  uint64_t held; /* counted for the decoder */
  tcs_source_file source;
  bool patient;
} look;

static bool look_goes_on(void *user, double fraction) { return !atomic_load(&((look *)user)->work.cancel); }

static bool look_holds(void *user, uint64_t bytes, GError **error) {
  look *l = user;
  if (!tcs_budget_resize(l->budget, TCS_MEMORY_DECODERS, l->held, bytes)) {
    tcs_budget_refuse(l->budget, TCS_MEMORY_DECODERS, bytes - l->held, error);
    return false;
  }
  l->held = bytes;
  return true;
}

static void run_look(tcs_work *work) {
  look *l = (look *)work;
  const tc_import_options options = {.progress = look_goes_on, .decoder = look_holds, .user = l, .patient = l->patient};
  tc_series *series = NULL;
  size_t count = 0;
  if (tc_import_list(l->source.path, &options, &series, &count, &work->error)) {
    cJSON *json = cJSON_CreateObject();
    cJSON_AddItemToObject(json, "series", tcs_describe_series(series, count));
    work->text = tcs_json_text(json);
  } else { /* the message names the server's path, unknown to the client */
    const tc_error_code code = (tc_error_code)work->error->code;
    g_clear_error(&work->error);
    tc_set_error(&work->error, code, "/path", "the series there cannot be listed; load it to learn why");
  }
  g_free(series);
  look_holds(l, 0, NULL);
}

static void free_look(tcs_work *work) { g_free(((look *)work)->source.path); }

void tcs_get_series(tcs_request *request) {
  const char *path = tcs_query(request, "path");
  GError *error = NULL;
  tcs_source_file source;
  if (request->caller.session[0]) {
    tcs_reply_problem(request, 403, "forbidden", "Not allowed",
                      "a share link opens one session and lists no series");
    return;
  }
  if (!path) {
    tcs_reply_problem(request, 422, "invalid", "Invalid value", "query path: give a file or folder of GET /v1/volumes");
    return;
  }
  if (!tcs_catalogue_resolve(request->server->catalogue, TCS_KIND_VOLUME, path, &source, &error)) {
    tcs_reply_error(request, error);
    g_clear_error(&error);
    return;
  }
  look *l = g_new0(look, 1);
  *l = (look){.work = {.run = run_look, .free = free_look},
              .budget = request->server->budget,
              .source = source,
              .patient = request->server->config->limits.patient_tags != 0};
  tcs_work_start(request, request->server->walk_worker, &l->work, MOST_LOOKS);
}
