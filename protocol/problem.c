/* Errors as RFC 9457 problem documents. */
#include "protocol/internal.h"

typedef struct problem {
  int status;
  const char *name, *title;
} problem;

static const problem problems[] = {
    [TC_ERROR_INVALID] = {422, "invalid", "A value is out of its range or has no meaning"},
    [TC_ERROR_SYNTAX] = {400, "syntax", "The text cannot be parsed"},
    [TC_ERROR_NOT_FOUND] = {404, "not-found", "Not found"},
    [TC_ERROR_CONFLICT] = {409, "conflict", "In use, or changed in the meantime"},
    [TC_ERROR_UNSUPPORTED] = {501, "unsupported", "Understood, but not built"},
    [TC_ERROR_LIMIT] = {413, "limit", "Over a limit"},
    [TC_ERROR_FORMAT] = {415, "format", "The file is damaged or of an unknown kind"},
    [TC_ERROR_IO] = {500, "io", "The system refused"},
    [TC_ERROR_MEMORY] = {507, "memory", "Not enough memory"},
    [TC_ERROR_CANCELLED] = {503, "cancelled", "Stopped on request"},
    [TC_ERROR_PAUSED] = {503, "paused", "Under way; to be gone on with"},
    [TC_ERROR_BUSY] = {503, "busy", "Busy; try again later"},
    [TC_ERROR_INTERNAL] = {500, "internal", "A fault of the server"},
};
G_STATIC_ASSERT(G_N_ELEMENTS(problems) == TC_ERROR_CODE_COUNT);

static const problem *find(const GError *error) {
  bool ours = error && error->domain == TC_ERROR && error->code >= 0 && error->code < TC_ERROR_CODE_COUNT;
  return &problems[ours ? error->code : TC_ERROR_INTERNAL];
}

int tcp_problem_status(const GError *error) { return find(error)->status; }

cJSON *tcp_problem(const GError *error) {
  const problem *p = find(error);
  const char *pointer = error ? tc_error_pointer(error) : NULL;
  cJSON *document = cJSON_CreateObject();
  char *type = g_strconcat("urn:tomocast:problem:", p->name, NULL);
  char *detail = g_utf8_make_valid(error && error->message ? error->message : p->title, -1);
  tcp_add(document, "type", cJSON_CreateString(type));
  tcp_add(document, "title", cJSON_CreateString(p->title));
  tcp_add(document, "status", cJSON_CreateNumber(p->status));
  tcp_add(document, "detail", cJSON_CreateString(detail));
  if (pointer) tcp_add(document, "pointer", cJSON_CreateString(pointer));
  g_free(detail);
  g_free(type);
  return document;
}

cJSON *tcp_problem_named(int status, const char *name, const char *title, const char *detail) {
  cJSON *document = cJSON_CreateObject();
  char *type = g_strconcat("urn:tomocast:problem:", name, NULL);
  tcp_add(document, "type", cJSON_CreateString(type));
  tcp_add(document, "title", cJSON_CreateString(title));
  tcp_add(document, "status", cJSON_CreateNumber(status));
  tcp_add(document, "detail", cJSON_CreateString(detail));
  g_free(type);
  return document;
}
