/* Scenes into documents, by the same table that reads them. */
#include <string.h>

#include "protocol/internal.h"

void tcp_add(cJSON *object, const char *constant_name, cJSON *value) {
  if (value && !cJSON_AddItemToObjectCS(object, constant_name, value)) cJSON_Delete(value);
}

static cJSON *write_member(const tcp_member *member, const tc_scene *scene) {
  return member->special ? member->special->write(member, scene) : tcp_leaf_write(member, scene);
}

/* NULL: none of its members has a meaning now. */
static cJSON *write_group(const char *group, const tc_scene *scene) {
  cJSON *object = cJSON_CreateObject();
  for (size_t i = 0; i < tcp_member_count; i++)
    if (strcmp(tcp_members[i].group, group) == 0)
      tcp_add(object, tcp_members[i].name, write_member(&tcp_members[i], scene));
  if (object && object->child) return object;
  cJSON_Delete(object);
  return NULL;
}

/* In the order of the table: a group appears where its first member stands. */
cJSON *tcp_scene_write(const tc_scene *scene) {
  cJSON *document = cJSON_CreateObject();
  for (size_t i = 0; i < tcp_member_count; i++) {
    const tcp_member *m = &tcp_members[i];
    if (!*m->group)
      tcp_add(document, m->name, write_member(m, scene));
    else if (i == 0 || strcmp(m->group, tcp_members[i - 1].group) != 0)
      tcp_add(document, m->group, write_group(m->group, scene));
  }
  return document;
}
