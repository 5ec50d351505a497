/* The table of scene members as JSON Schema 2020-12. */
#include <string.h>

#include "protocol/internal.h"

cJSON *tcp_range_schema(const tcp_member *member, const char *type) {
  cJSON *schema = cJSON_CreateObject();
  tcp_add(schema, "type", cJSON_CreateStringReference(type));
  tcp_add(schema, member->flags & TCP_ABOVE ? "exclusiveMinimum" : "minimum", cJSON_CreateNumber(member->min));
  tcp_add(schema, member->flags & TCP_BELOW ? "exclusiveMaximum" : "maximum", cJSON_CreateNumber(member->max));
  return schema;
}

cJSON *tcp_array_schema(cJSON *items, int min, int max) {
  cJSON *schema = cJSON_CreateObject();
  tcp_add(schema, "type", cJSON_CreateStringReference("array"));
  tcp_add(schema, "items", items);
  tcp_add(schema, "minItems", cJSON_CreateNumber(min));
  tcp_add(schema, "maxItems", cJSON_CreateNumber(max));
  return schema;
}

static cJSON *names_schema(const tcp_member *member) {
  cJSON *schema = cJSON_CreateObject(), *names = cJSON_CreateArray();
  for (const char *const *name = member->names; *name; name++)
    cJSON_AddItemToArray(names, cJSON_CreateStringReference(*name));
  tcp_add(schema, "enum", names);
  return schema;
}

static cJSON *type_schema(const char *type) {
  cJSON *schema = cJSON_CreateObject();
  tcp_add(schema, "type", cJSON_CreateStringReference(type));
  return schema;
}

static cJSON *plain_schema(const tcp_member *member) {
  switch (member->kind) {
  case TCP_NUMBER: return tcp_range_schema(member, "number");
  case TCP_INTEGER: return tcp_range_schema(member, "integer");
  case TCP_BOOLEAN: return type_schema("boolean");
  case TCP_NAME: return names_schema(member);
  case TCP_VECTOR: return tcp_array_schema(tcp_range_schema(member, "number"), member->count, member->count);
  case TCP_TEXT: {
    cJSON *schema = type_schema("string");
    tcp_add(schema, "maxLength", cJSON_CreateNumber(member->count - 1));
    return schema;
  }
  case TCP_SPECIAL:
  case TCP_KIND_COUNT: break;
  }
  return cJSON_CreateObject();
}

/* "Where the eye is. LPS mm." */
static void describe(cJSON *schema, const tcp_member *member) {
  char *text = member->unit ? g_strdup_printf("%s Unit: %s.", member->doc, member->unit) : g_strdup(member->doc);
  cJSON_DeleteItemFromObjectCaseSensitive(schema, "description");
  tcp_add(schema, "description", cJSON_CreateString(text));
  g_free(text);
}

cJSON *tcp_leaf_schema(const tcp_member *member) {
  cJSON *schema = plain_schema(member);
  describe(schema, member);
  return schema;
}

/* The default of tc_scene_init(), unless it depends on the volume. */
static void add_default(cJSON *schema, const tcp_member *member, const tc_scene *scene) {
  if (member->flags & TCP_FITTED) return;
  tcp_add(schema, "default", member->special ? member->special->write(member, scene) : tcp_leaf_write(member, scene));
}

static cJSON *member_schema(const tcp_member *member, const tc_scene *scene) {
  cJSON *schema = member->special ? member->special->schema(member) : plain_schema(member);
  describe(schema, member);
  add_default(schema, member, scene);
  return schema;
}

static cJSON *object_schema(const char *description) {
  cJSON *schema = type_schema("object");
  tcp_add(schema, "description", cJSON_CreateString(description));
  tcp_add(schema, "additionalProperties", cJSON_CreateFalse());
  return schema;
}

/* {"not":{"required":["maxError","maxMilliseconds"]}} */
static cJSON *not_both_bounds(void) {
  const char *names[] = {"maxError", "maxMilliseconds"};
  cJSON *not = cJSON_CreateObject();
  tcp_add(not, "required", cJSON_CreateStringArray(names, 2));
  return not ;
}

static cJSON *group_schema(const tcp_group *group, const tc_scene *scene) {
  cJSON *schema = object_schema(group->doc), *properties = cJSON_CreateObject();
  for (size_t i = 0; i < tcp_member_count; i++)
    if (strcmp(tcp_members[i].group, group->name) == 0)
      tcp_add(properties, tcp_members[i].name, member_schema(&tcp_members[i], scene));
  tcp_add(schema, "properties", properties);
  if (strcmp(group->name, "quality") == 0) tcp_add(schema, "not", not_both_bounds());
  return schema;
}

cJSON *tcp_scene_schema(void) {
  tc_scene scene;
  tc_scene_init(&scene);
  cJSON *schema = cJSON_CreateObject(), *properties = cJSON_CreateObject();
  tcp_add(schema, "$schema", cJSON_CreateStringReference("https://json-schema.org/draft/2020-12/schema"));
  tcp_add(schema, "$id", cJSON_CreateStringReference("urn:tomocast:scene"));
  tcp_add(schema, "title", cJSON_CreateStringReference("Scene"));
  tcp_add(schema, "description",
          cJSON_CreateStringReference("Everything a picture is made from; every part is optional. Positions are mm in "
                                      "patient LPS, colours sRGB 0..1, values in the volume's own unit."));
  tcp_add(schema, "type", cJSON_CreateStringReference("object"));
  for (size_t i = 0; i < tcp_member_count; i++)
    if (!*tcp_members[i].group) tcp_add(properties, tcp_members[i].name, member_schema(&tcp_members[i], &scene));
  for (size_t i = 0; i < tcp_group_count; i++)
    tcp_add(properties, tcp_groups[i].name, group_schema(&tcp_groups[i], &scene));
  tcp_add(schema, "properties", properties);
  tcp_add(schema, "additionalProperties", cJSON_CreateFalse());
  tc_scene_clear(&scene);
  return schema;
}
