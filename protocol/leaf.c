/* Plain members: numbers, booleans, names, vectors and short texts, between JSON and a field of a struct. */
#include <math.h>
#include <string.h>

#include "protocol/internal.h"

G_STATIC_ASSERT(sizeof(tc_mode) == sizeof(int)); /* the field of a TCP_NAME member is accessed as an int */

static bool too_low(const tcp_member *m, double v) { return m->flags & TCP_ABOVE ? !(v > m->min) : !(v >= m->min); }
static bool too_high(const tcp_member *m, double v) { return m->flags & TCP_BELOW ? !(v < m->max) : !(v <= m->max); }

static bool check_range(tcp_reader *reader, const tcp_member *m, double v) {
  const char *unit = m->unit ? m->unit : "", *space = m->unit ? " " : "";
  if (too_low(m, v))
    return tcp_fail(reader, TC_ERROR_INVALID, "%.9g is too small; expected %s %.9g%s%s", v,
                    m->flags & TCP_ABOVE ? "more than" : "at least", m->min, space, unit);
  if (too_high(m, v))
    return tcp_fail(reader, m->flags & TCP_LIMIT ? TC_ERROR_LIMIT : TC_ERROR_INVALID,
                    "%.9g is too large; expected %s %.9g%s%s", v, m->flags & TCP_BELOW ? "less than" : "at most",
                    m->max, space, unit);
  return true;
}

bool tcp_number_read(tcp_reader *reader, const tcp_member *member, const cJSON *value, double *number) {
  if (!cJSON_IsNumber(value)) return tcp_fail_type(reader, "a number", value);
  if (!isfinite(value->valuedouble)) return tcp_fail(reader, TC_ERROR_INVALID, "a finite number expected");
  if (!check_range(reader, member, value->valuedouble)) return false;
  *number = value->valuedouble;
  return true;
}

static bool read_integer(tcp_reader *reader, const tcp_member *member, const cJSON *value, int *number) {
  double v;
  if (!tcp_number_read(reader, member, value, &v)) return false;
  if (v != floor(v)) return tcp_fail(reader, TC_ERROR_INVALID, "%.9g is not a whole number", v);
  *number = (int)v;
  return true;
}

static bool read_name(tcp_reader *reader, const tcp_member *member, const cJSON *value, int *number) {
  if (!cJSON_IsString(value)) return tcp_fail_type(reader, "a string", value);
  for (int i = 0; member->names[i]; i++)
    if (strcmp(member->names[i], value->valuestring) == 0) {
      *number = i;
      return true;
    }
  char *quoted = tcp_quote(value->valuestring), *hint = tcp_hint(value->valuestring, member->names);
  tcp_fail(reader, TC_ERROR_INVALID, "%s is not known%s", quoted, hint);
  g_free(quoted);
  g_free(hint);
  return false;
}

bool tcp_vector_read(tcp_reader *reader, const tcp_member *member, const cJSON *value, int count, double *numbers) {
  if (!cJSON_IsArray(value)) return tcp_fail_type(reader, "an array", value);
  int given = cJSON_GetArraySize(value), i = 0;
  if (given != count) return tcp_fail(reader, TC_ERROR_INVALID, "%d numbers expected, got %d", count, given);
  for (const cJSON *item = value->child; item; item = item->next, i++) {
    size_t mark = tcp_enter_index(reader, i);
    if (!tcp_number_read(reader, member, item, &numbers[i])) return false;
    tcp_leave(reader, mark);
  }
  return true;
}

static bool read_text(tcp_reader *reader, const tcp_member *member, const cJSON *value, char *text) {
  if (!cJSON_IsString(value)) return tcp_fail_type(reader, "a string", value);
  size_t size = strlen(value->valuestring);
  if (size >= (size_t)member->count)
    return tcp_fail(reader, TC_ERROR_INVALID, "at most %d bytes are allowed, got %zu", member->count - 1, size);
  memset(text, 0, (size_t)member->count);
  memcpy(text, value->valuestring, size);
  return true;
}

bool tcp_leaf_read(tcp_reader *reader, const tcp_member *member, void *base, const cJSON *value) {
  void *field = (char *)base + member->offset;
  switch (member->kind) {
  case TCP_NUMBER: return tcp_number_read(reader, member, value, field);
  case TCP_INTEGER: return read_integer(reader, member, value, field);
  case TCP_NAME: return read_name(reader, member, value, field);
  case TCP_VECTOR: return tcp_vector_read(reader, member, value, member->count, field);
  case TCP_TEXT: return read_text(reader, member, value, field);
  case TCP_BOOLEAN:
    if (!cJSON_IsBool(value)) return tcp_fail_type(reader, "true or false", value);
    *(bool *)field = cJSON_IsTrue(value);
    return true;
  case TCP_SPECIAL:
  case TCP_KIND_COUNT: break;
  }
  return tcp_fail(reader, TC_ERROR_INTERNAL, "no reader");
}

cJSON *tcp_vector_write(const double *numbers, int count) { return cJSON_CreateDoubleArray(numbers, count); }

cJSON *tcp_leaf_write(const tcp_member *member, const void *base) {
  const void *field = (const char *)base + member->offset;
  bool asked = !(member->flags & TCP_ASKED);
  switch (member->kind) {
  case TCP_NUMBER: {
    double v = *(const double *)field;
    return asked || v != 0 ? cJSON_CreateNumber(v) : NULL;
  }
  case TCP_INTEGER: return cJSON_CreateNumber(*(const int *)field);
  case TCP_BOOLEAN: return cJSON_CreateBool(*(const bool *)field);
  case TCP_NAME: return cJSON_CreateStringReference(member->names[*(const int *)field]);
  case TCP_VECTOR: return tcp_vector_write(field, member->count);
  case TCP_TEXT: return asked || *(const char *)field ? cJSON_CreateString(field) : NULL;
  case TCP_SPECIAL:
  case TCP_KIND_COUNT: break;
  }
  return NULL;
}

static size_t field_size(const tcp_member *member) {
  switch (member->kind) {
  case TCP_NUMBER: return sizeof(double);
  case TCP_INTEGER:
  case TCP_NAME: return sizeof(int);
  case TCP_BOOLEAN: return sizeof(bool);
  case TCP_VECTOR: return sizeof(double) * (size_t)member->count;
  case TCP_TEXT: return (size_t)member->count;
  case TCP_SPECIAL:
  case TCP_KIND_COUNT: break;
  }
  return 0;
}

void tcp_leaf_copy(const tcp_member *member, void *to, const void *from) {
  memcpy((char *)to + member->offset, (const char *)from + member->offset, field_size(member));
}

/* --- rows --------------------------------------------------------------------------------------- */

static bool fail_unknown(tcp_reader *reader, const tcp_member *members, int count, const char *name) {
  const char **names = g_new0(const char *, (gsize)count + 1);
  for (int i = 0; i < count; i++) names[i] = members[i].name;
  char *hint = tcp_hint(name, names);
  tcp_fail(reader, TC_ERROR_INVALID, "unknown member%s", hint);
  g_free(hint);
  g_free(names);
  return false;
}

bool tcp_row_read(tcp_reader *reader, const tcp_member *members, int count, const cJSON *object, void *base,
                  unsigned *seen) {
  if (!cJSON_IsObject(object)) return tcp_fail_type(reader, "an object", object);
  for (const cJSON *item = object->child; item; item = item->next) {
    const size_t mark = tcp_enter(reader, item->string);
    int member = 0;
    while (member < count && strcmp(members[member].name, item->string) != 0) member++;
    if (member == count) return fail_unknown(reader, members, count, item->string);
    if (!tcp_leaf_read(reader, &members[member], base, item)) return false;
    *seen |= 1u << member;
    tcp_leave(reader, mark);
  }
  return true;
}

cJSON *tcp_row_schema(const tcp_member *members, int count, unsigned those, unsigned required) {
  cJSON *schema = cJSON_CreateObject(), *properties = cJSON_CreateObject(), *names = cJSON_CreateArray();
  for (int i = 0; i < count; i++) {
    if (those >> i & 1) tcp_add(properties, members[i].name, tcp_leaf_schema(&members[i]));
    if (required >> i & 1) cJSON_AddItemToArray(names, cJSON_CreateStringReference(members[i].name));
  }
  tcp_add(schema, "type", cJSON_CreateStringReference("object"));
  tcp_add(schema, "properties", properties);
  tcp_add(schema, "required", names);
  tcp_add(schema, "additionalProperties", cJSON_CreateFalse());
  return schema;
}
