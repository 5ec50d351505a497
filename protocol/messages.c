/* Messages of the WebSocket subprotocol tomocast.v1. */
#include <math.h>
#include <string.h>

#include "protocol/internal.h"

/* Largest integer up to which a double, and so JSON in a browser, is exact. */
#define MAX_COUNTER 9007199254740992.0

static const char *const type_names[] = {"patch", "ack", "pointer", "ping", "size", "cancel", NULL};
G_STATIC_ASSERT(G_N_ELEMENTS(type_names) == TCP_MESSAGE_TYPE_COUNT + 1);

/* Required members of each message type, besides "type". */
static const char *const members[TCP_MESSAGE_TYPE_COUNT][3] = {[TCP_PATCH] = {"seq", "scene"},
                                                               [TCP_ACK] = {"frame"},
                                                               [TCP_POINTER] = {"phase"},
                                                               [TCP_PING] = {"t"},
                                                               [TCP_SIZE] = {"width", "height"}};

static bool fail(GError **error, const char *name, const char *what) {
  char *pointer = g_strconcat("/", name, NULL);
  tcp_fail_at(error, TC_ERROR_INVALID, pointer, "%s", what);
  g_free(pointer);
  return false;
}

static bool read_counter(const cJSON *object, const char *name, uint64_t *counter, GError **error) {
  const cJSON *value = cJSON_GetObjectItemCaseSensitive(object, name);
  double number = cJSON_IsNumber(value) ? value->valuedouble : -1;
  if (number < 0 || number > MAX_COUNTER || number != floor(number))
    return fail(error, name, "a whole number 0..2^53 expected");
  *counter = (uint64_t)number;
  return true;
}

static bool read_type(const cJSON *object, tcp_message_type *type, GError **error) {
  const cJSON *value = cJSON_GetObjectItemCaseSensitive(object, "type");
  if (!cJSON_IsString(value))
    return fail(error, "type", "\"patch\", \"ack\", \"pointer\", \"ping\", \"size\" or \"cancel\" expected");
  for (int i = 0; type_names[i]; i++)
    if (strcmp(type_names[i], value->valuestring) == 0) {
      *type = (tcp_message_type)i;
      return true;
    }
  char *hint = tcp_hint(value->valuestring, type_names), *quoted = tcp_quote(value->valuestring);
  char *text = g_strconcat(quoted, " is not known", hint, NULL);
  fail(error, "type", text);
  g_free(text);
  g_free(quoted);
  g_free(hint);
  return false;
}

static bool check_names(const cJSON *object, tcp_message_type type, GError **error) {
  for (const cJSON *item = object->child; item; item = item->next) {
    bool known = strcmp(item->string, "type") == 0;
    for (int i = 0; members[type][i]; i++) known = known || strcmp(item->string, members[type][i]) == 0;
    if (known) continue;
    tcp_reader reader = {.pointer = g_string_new(NULL), .error = error};
    char *hint = tcp_hint(item->string, members[type]);
    tcp_enter(&reader, item->string);
    tcp_fail(&reader, TC_ERROR_INVALID, "unknown member of a \"%s\" message%s", type_names[type], hint);
    g_free(hint);
    g_string_free(reader.pointer, TRUE);
    return false;
  }
  return true;
}

static bool read_patch(cJSON *object, tcp_message *message, GError **error) {
  if (!read_counter(object, "seq", &message->seq, error)) return false;
  if (!cJSON_IsObject(cJSON_GetObjectItemCaseSensitive(object, "scene")))
    return fail(error, "scene", "expected a merge patch, that is an object");
  message->scene = cJSON_DetachItemFromObjectCaseSensitive(object, "scene");
  return true;
}

static bool read_pointer(const cJSON *object, tcp_message *message, GError **error) {
  const char *phase = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(object, "phase"));
  message->pointer_down = phase && strcmp(phase, "start") == 0;
  if (message->pointer_down || (phase && strcmp(phase, "end") == 0)) return true;
  return fail(error, "phase", "\"start\" or \"end\" expected");
}

static bool read_ping(const cJSON *object, tcp_message *message, GError **error) {
  const cJSON *t = cJSON_GetObjectItemCaseSensitive(object, "t");
  if (!cJSON_IsNumber(t)) return fail(error, "t", "a number expected");
  message->t = t->valuedouble;
  return true;
}

static bool read_pixels(const cJSON *object, const char *name, int *pixels, GError **error) {
  uint64_t count = 0;
  if (!read_counter(object, name, &count, error)) return false;
  if (count < 1 || count > TC_MAX_IMAGE_SIDE) return fail(error, name, "out of range");
  *pixels = (int)count;
  return true;
}

static bool read_message(cJSON *object, tcp_message *message, GError **error) {
  if (!cJSON_IsObject(object)) return tcp_fail_at(error, TC_ERROR_INVALID, "", "a message must be a JSON object");
  if (!read_type(object, &message->type, error) || !check_names(object, message->type, error)) return false;
  switch (message->type) {
  case TCP_PATCH: return read_patch(object, message, error);
  case TCP_ACK: return read_counter(object, "frame", &message->frame, error);
  case TCP_POINTER: return read_pointer(object, message, error);
  case TCP_PING: return read_ping(object, message, error);
  case TCP_SIZE:
    return read_pixels(object, "width", &message->width, error) &&
           read_pixels(object, "height", &message->height, error);
  case TCP_CANCEL: return true;
  case TCP_MESSAGE_TYPE_COUNT: break;
  }
  return false;
}

bool tcp_message_parse(const char *bytes, size_t size, tcp_message *message, GError **error) {
  memset(message, 0, sizeof *message);
  cJSON *object = tcp_json_parse(bytes, size, error);
  if (!object) return false;
  bool good = read_message(object, message, error);
  if (!good) {
    /* an error reply names its patch, even if another member is invalid */
    uint64_t seq = 0;
    tcp_message_clear(message);
    if (read_counter(object, "seq", &seq, NULL)) message->seq = seq;
  }
  cJSON_Delete(object);
  return good;
}

void tcp_message_clear(tcp_message *message) {
  cJSON_Delete(message->scene);
  memset(message, 0, sizeof *message);
}

/* --- frame header ------------------------------------------------------------------------------- */

/* Rounded to microseconds: %.17g of a measured time is mostly noise. */
static cJSON *milliseconds(double ms) { return cJSON_CreateNumber(isfinite(ms) ? round(ms * 1e3) / 1e3 : 0); }

static cJSON *timing(const tcp_frame_header *header) {
  cJSON *object = cJSON_CreateObject();
  tcp_add(object, "queueMs", milliseconds(header->queue_ms));
  tcp_add(object, "tablesMs", milliseconds(header->tables_ms));
  tcp_add(object, "renderMs", milliseconds(header->render_ms));
  tcp_add(object, "encodeMs", milliseconds(header->encode_ms));
  return object;
}

static void add_depths(cJSON *object, const tcp_surface_error *e) {
  tcp_add(object, "depthRms", cJSON_CreateNumber(e->rms));
  tcp_add(object, "depthP99", cJSON_CreateNumber(e->p99));
  tcp_add(object, "depthMax", cJSON_CreateNumber(e->max));
  tcp_add(object, "outline", cJSON_CreateNumber(e->outline));
}

static cJSON *surface_error(const tcp_surface_error *e) {
  cJSON *object = cJSON_CreateObject();
  if (e->surface >= 0) tcp_add(object, "surface", cJSON_CreateNumber(e->surface));
  if (e->label) tcp_add(object, "label", cJSON_CreateNumber(e->label));
  tcp_add(object, "pixels", cJSON_CreateNumber(e->both + e->one));
  add_depths(object, e);
  return object;
}

static cJSON *surface_errors(const tcp_surface_error *of, int n) {
  cJSON *each = cJSON_CreateArray();
  for (int i = 0; i < n; i++) cJSON_AddItemToArray(each, surface_error(&of[i]));
  return each;
}

cJSON *tcp_measured_error(const tcp_frame_header *header) {
  cJSON *object = cJSON_CreateObject();
  tcp_add(object, "rms", cJSON_CreateNumber(header->rms));
  tcp_add(object, "low", cJSON_CreateNumber(header->low));
  tcp_add(object, "high", cJSON_CreateNumber(header->high));
  tcp_add(object, "max", cJSON_CreateNumber(header->max));
  tcp_add(object, "pixels", cJSON_CreateNumber(header->pixels));
  if (!header->depth.both && !header->depth.one) return object;
  add_depths(object, &header->depth);
  tcp_add(object, "surfaces", surface_errors(header->surfaces, header->n_surfaces));
  if (header->n_layers) tcp_add(object, "layers", surface_errors(header->layers, header->n_layers));
  return object;
}

static cJSON *header_json(const tcp_frame_header *header) {
  cJSON *object = cJSON_CreateObject();
  tcp_add(object, "frame", cJSON_CreateNumber((double)header->frame));
  tcp_add(object, "seq", cJSON_CreateNumber((double)header->seq));
  tcp_add(object, "width", cJSON_CreateNumber(header->width));
  tcp_add(object, "height", cJSON_CreateNumber(header->height));
  tcp_add(object, "format", cJSON_CreateString(header->format));
  tcp_add(object, "quality", cJSON_CreateNumber(header->quality));
  tcp_add(object, "final", cJSON_CreateBool(header->final));
  if (header->bridged) tcp_add(object, "bridged", cJSON_CreateNumber(header->bridged));
  tcp_add(object, "timing", timing(header));
  if (header->has_error) tcp_add(object, "error", tcp_measured_error(header));
  if (header->unmeasured) tcp_add(object, "unmeasured", cJSON_CreateString(header->unmeasured));
  if (header->volume) tcp_add(object, "volume", cJSON_CreateString(header->volume));
  if (header->scene) {
    tcp_add(object, "scene", cJSON_CreateRaw(header->scene));
    tcp_add(object, "others", cJSON_CreateNumber((double)header->others));
  }
  return object;
}

uint8_t *tcp_frame_header_write(const tcp_frame_header *header, size_t *size) {
  cJSON *object = header_json(header);
  char *text = cJSON_PrintUnformatted(object);
  size_t length = text ? strlen(text) : 0;
  uint8_t *bytes = g_malloc(4 + length);
  for (int i = 0; i < 4; i++) bytes[i] = (uint8_t)(length >> (8 * i));
  if (length) memcpy(bytes + 4, text, length);
  *size = 4 + length;
  cJSON_free(text);
  cJSON_Delete(object);
  return bytes;
}
