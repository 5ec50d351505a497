/* The report's page: report.json and the scripts that draw it, in one self-contained file. */
#include "renderer/base/embedded.h"
#include "server/bench/report.h"

static const char *file_named(const char *name) { return tc_embedded_text(tcs_report_files, name); }

char *tcs_report_page(const char *json) {
  GString *page = g_string_new(file_named("report.html")), *data = g_string_new(json);
  g_string_replace(data, "<", "\\u003c", 0); /* text from a volume must not end the script element */
  g_string_replace(page, "/*CHART*/", file_named("report_chart.js"), 1);
  g_string_replace(page, "/*SCENES*/", file_named("report_scenes.js"), 1);
  g_string_replace(page, "/*OBJECTS*/", file_named("report_objects.js"), 1);
  g_string_replace(page, "/*REPORT*/", file_named("report.js"), 1);
  g_string_replace(page, "/*DATA*/", data->str, 1);
  g_string_free(data, TRUE);
  return g_string_free(page, FALSE);
}
