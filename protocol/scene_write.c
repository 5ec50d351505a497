/* Writes scenes as documents, by the table that drives the reader. */
#include <string.h>

#include "protocol/internal.h"

void tcp_add(cJSON *object, const char *constant_name, cJSON *value) {
  if (value && !cJSON_AddItemToObjectCS(object, constant_name, value)) cJSON_Delete(value);
}

static cJSON *write_member(const tcp_member *member, const tc_scene *scene) {
  return member->special ? member->special->write(member, scene) : tcp_leaf_write(member, scene);
}

/* NULL: none of the group's members has a meaning in this scene. */
static cJSON *write_group(const char *group, const tc_scene *scene) {
  cJSON *object = cJSON_CreateObject();
  for (size_t i = 0; i < tcp_member_count; i++)
    if (strcmp(tcp_members[i].group, group) == 0)
      tcp_add(object, tcp_members[i].name, write_member(&tcp_members[i], scene));
  if (object && object->child) return object;
  cJSON_Delete(object);
  return NULL;
}

/* In the order of the table: a group is written at the place of its first member. */
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

#define MODE(mode) (1u << (mode))
#define PROJECTIONS (MODE(TC_MODE_MIP) | MODE(TC_MODE_MINIP) | MODE(TC_MODE_AVERAGE))
#define SURFACES (MODE(TC_MODE_ISOSURFACE) | MODE(TC_MODE_MESH))
#define ALL (MODE(TC_MODE_COUNT) - 1)

static const struct {
  const char *group, *name; /* NULL: the whole group */
  unsigned modes;
} shown[] = {
    {"image", "background", ALL},
    {"camera", NULL, ALL & ~MODE(TC_MODE_MPR)},
    {"transferFunction", "preset", MODE(TC_MODE_DVR)},
    {"window", NULL, PROJECTIONS | MODE(TC_MODE_MPR)},
    {"isosurface", "value", SURFACES},
    {"mesh", "surfaces", MODE(TC_MODE_MESH)},
    {"splat", "threshold", MODE(TC_MODE_SPLAT)},
    {"mpr", NULL, MODE(TC_MODE_MPR)},
    {"clip", "planes", PROJECTIONS},
    {"labels", "volume", MODE(TC_MODE_MESH)},
};

cJSON *tcp_scene_write_shown(const tc_scene *scene) {
  cJSON *document = cJSON_CreateObject();
  tcp_add(document, "mode", cJSON_CreateString(tc_mode_names[scene->mode]));
  for (size_t i = 0; i < tcp_member_count; i++) {
    const tcp_member *m = &tcp_members[i];
    for (size_t k = 0; k < G_N_ELEMENTS(shown); k++) {
      if (strcmp(m->group, shown[k].group) != 0 || (shown[k].name && strcmp(m->name, shown[k].name) != 0)) continue;
      if (!(shown[k].modes & MODE(scene->mode))) continue;
      cJSON *value = write_member(m, scene), *group = cJSON_GetObjectItemCaseSensitive(document, m->group);
      if (value) tcp_add(group ? group : cJSON_AddObjectToObject(document, m->group), m->name, value);
    }
  }
  return document;
}
