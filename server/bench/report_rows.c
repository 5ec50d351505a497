/* One table of members drives the JSON writer, its reader and the CSV. */
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "server/bench/report.h"

typedef enum field_kind { TEXT, NUMBER, FLAG } field_kind;
typedef struct field {
  const char *name;
  field_kind kind;
  size_t offset, size;
} field;

#define F(json, member, kind)                                                                                          \
  { json, kind, offsetof(tcs_report_row, member), sizeof((tcs_report_row *)0)->member }
static const field fields[] = {F("key", key, TEXT),
                               F("scene", scene, TEXT),
                               F("backend", backend, TEXT),
                               F("classification", classification, TEXT),
                               F("order", order, TEXT),
                               F("filter", filter, TEXT),
                               F("step", step, NUMBER),
                               F("raysPerPixel", rays, NUMBER),
                               F("coherence", coherence, FLAG),
                               F("jitter", jitter, FLAG),
                               F("termination", termination, NUMBER),
                               F("tableSize", table_size, NUMBER),
                               F("tableBits", table_bits, NUMBER),
                               F("tableNodes", table_nodes, NUMBER),
                               F("kernel", kernel, TEXT),
                               F("pixels", pixels, NUMBER),
                               F("rms", rms, NUMBER),
                               F("rmsLow", rms_lo, NUMBER),
                               F("rmsHigh", rms_hi, NUMBER),
                               F("p999", p999, NUMBER),
                               F("max", max, NUMBER),
                               F("ciede2000", ciede, NUMBER),
                               F("ciede2000Max", ciede_max, NUMBER),
                               F("ssim", ssim, NUMBER),
                               F("areaPixels", area_pixels, NUMBER),
                               F("areaRms", area_rms, NUMBER),
                               F("areaRmsLow", area_rms_lo, NUMBER),
                               F("areaRmsHigh", area_rms_hi, NUMBER),
                               F("areaP999", area_p999, NUMBER),
                               F("areaMax", area_max, NUMBER),
                               F("endedRms", ended_rms, NUMBER),
                               F("endedMax", ended_max, NUMBER),
                               F("renderMs", render_ms, NUMBER),
                               F("renderMsLeast", render_ms_least, NUMBER),
                               F("anchorMs", anchor_ms, NUMBER),
                               F("timeMs", time_ms, NUMBER),
                               F("tablesMs", tables_ms, NUMBER),
                               F("skipMs", skip_ms, NUMBER),
                               F("runs", runs, NUMBER),
                               F("samples", samples, NUMBER)};

cJSON *tcs_report_row_write(const tcs_report_row *row) {
  cJSON *json = cJSON_CreateObject();
  for (size_t i = 0; i < G_N_ELEMENTS(fields); i++) {
    const field *f = &fields[i];
    const void *at = (const char *)row + f->offset;
    double number = f->kind == TEXT ? 0 : *(const double *)at;
    switch (f->kind) {
    case TEXT: cJSON_AddStringToObject(json, f->name, at); break;
    case NUMBER: cJSON_AddNumberToObject(json, f->name, number); break; /* cJSON writes null for NaN and infinity */
    case FLAG: cJSON_AddBoolToObject(json, f->name, number != 0); break;
    }
  }
  return json;
}

bool tcs_report_row_read(const cJSON *json, tcs_report_row *row) {
  *row = (tcs_report_row){0};
  for (size_t i = 0; i < G_N_ELEMENTS(fields); i++) {
    const field *f = &fields[i];
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(json, f->name);
    void *at = (char *)row + f->offset;
    if (f->kind == TEXT   ? !cJSON_IsString(item)
        : f->kind == FLAG ? !cJSON_IsBool(item)
                          : !cJSON_IsNumber(item) && !cJSON_IsNull(item))
      return false;
    if (f->kind == TEXT && g_strlcpy(at, item->valuestring, f->size) >= f->size) return false;
    if (f->kind == NUMBER) *(double *)at = cJSON_IsNull(item) ? NAN : item->valuedouble;
    if (f->kind == FLAG) *(double *)at = cJSON_IsTrue(item);
  }
  return true;
}

static void csv_text(GString *out, const char *text) {
  if (!strpbrk(text, ",\"\r\n")) {
    g_string_append(out, text);
    return;
  }
  g_string_append_c(out, '"');
  for (; *text; text++) g_string_append_printf(out, *text == '"' ? "\"\"" : "%c", *text);
  g_string_append_c(out, '"');
}

char *tcs_report_csv(const GArray *rows) {
  GString *out = g_string_new(NULL);
  for (size_t i = 0; i < G_N_ELEMENTS(fields); i++) g_string_append_printf(out, "%s%s", i ? "," : "", fields[i].name);
  g_string_append(out, "\r\n");
  for (guint r = 0; r < rows->len; r++) {
    for (size_t i = 0; i < G_N_ELEMENTS(fields); i++) {
      const void *at = (const char *)&g_array_index(rows, tcs_report_row, r) + fields[i].offset;
      char digits[G_ASCII_DTOSTR_BUF_SIZE];
      if (i) g_string_append_c(out, ',');
      if (fields[i].kind == TEXT)
        csv_text(out, at);
      else if (isfinite(*(const double *)at))
        g_string_append(out, g_ascii_formatd(digits, sizeof digits, "%.9g", *(const double *)at));
    }
    g_string_append(out, "\r\n");
  }
  return g_string_free(out, FALSE);
}

char *tcs_report_row_title(const tcs_report_row *r) {
  GString *s = g_string_new(r->classification);
  g_string_append_printf(s, ", step %g", r->step);
  if (strcmp(r->filter, "linear")) g_string_append_printf(s, ", %s", r->filter);
  if (r->rays > 1) g_string_append_printf(s, ", %g rays%s", r->rays, r->coherence ? " coherent" : "");
  if (r->jitter) g_string_append(s, ", jitter");
  if (r->termination > 0) g_string_append_printf(s, ", ends at %.3g", r->termination);
  if (r->table_size) g_string_append_printf(s, ", table of %g", r->table_size);
  if (r->table_bits) g_string_append_printf(s, ", %g-bit table", r->table_bits);
  if (strcmp(r->order, "front-to-back")) g_string_append_printf(s, ", %s", r->order);
  g_string_append_printf(s, ", %s", r->backend);
  return g_string_free(s, FALSE);
}
