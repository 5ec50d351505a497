/* mesh.surfaces: a list of surfaces, replaced as a whole. */
#include <string.h>

#include "protocol/internal.h"

enum { VALUE, LABEL, MESH, PLANE, SOURCES, COLOR = SOURCES, OPACITY, VISIBLE, TWO_SIDED, SURFACE_MEMBERS };
G_STATIC_ASSERT(G_N_ELEMENTS(tcp_surface_members) == SURFACE_MEMBERS);
G_STATIC_ASSERT((int)SOURCES == TC_SURFACE_SOURCE_COUNT); /* sources are numbered alike */

static bool read_surface(tcp_reader *reader, const cJSON *object, tc_mesh_surface *surface) {
  unsigned seen = 0;
  surface->opacity = 1;
  surface->visible = surface->two_sided = true;
  if (!tcp_row_read(reader, tcp_surface_members, SURFACE_MEMBERS, object, surface, &seen)) return false;
  const unsigned sources = seen & ((1u << SOURCES) - 1);
  if (sources == 0 || (sources & (sources - 1)))
    return tcp_fail(reader, TC_ERROR_INVALID, "one of \"value\", \"label\", \"mesh\" and \"plane\" is wanted, got %s",
                    sources ? "several" : "none");
  surface->source = (tc_surface_source)g_bit_nth_lsf(sources, -1);
  surface->has_color = seen & 1u << COLOR;
  return true;
}

static bool read_surfaces(tcp_reader *reader, const tcp_member *member, const cJSON *value) {
  if (!cJSON_IsArray(value)) return tcp_fail_type(reader, "an array of surfaces", value);
  const int count = cJSON_GetArraySize(value);
  int i = 0;
  if (count > TC_MAX_SURFACES)
    return tcp_fail(reader, TC_ERROR_LIMIT, "at most %d surfaces are wanted, got %d", TC_MAX_SURFACES, count);
  tc_mesh_surface *surfaces = count ? g_new0(tc_mesh_surface, count) : NULL;
  tc_scene_set_surfaces(reader->scene, surfaces, (size_t)count);
  for (const cJSON *item = value->child; item; item = item->next, i++) {
    const size_t mark = tcp_enter_index(reader, i);
    if (!read_surface(reader, item, &surfaces[i])) return false;
    tcp_leave(reader, mark);
  }
  return true;
}

static cJSON *write_surfaces(const tcp_member *member, const tc_scene *scene) {
  cJSON *list = cJSON_CreateArray();
  for (size_t i = 0; i < scene->mesh.n_surfaces; i++) {
    const tc_mesh_surface *surface = &scene->mesh.surfaces[i];
    cJSON *object = cJSON_CreateObject();
    for (int m = 0; m < SURFACE_MEMBERS; m++) {
      const tcp_member *own = &tcp_surface_members[m];
      const bool has = m < SOURCES ? m == (int)surface->source : m != COLOR || surface->has_color;
      if (has) tcp_add(object, own->name, tcp_leaf_write(own, surface));
    }
    cJSON_AddItemToArray(list, object);
  }
  return list;
}

static void reset_surfaces(tcp_reader *reader, const tcp_member *member) {
  tc_scene_take_surfaces(reader->scene, reader->defaults);
}

static cJSON *surfaces_schema(const tcp_member *member) {
  cJSON *either = cJSON_CreateArray(), *items = cJSON_CreateObject();
  const unsigned others = (1u << SURFACE_MEMBERS) - (1u << SOURCES);
  for (int source = 0; source < SOURCES; source++)
    cJSON_AddItemToArray(either,
                         tcp_row_schema(tcp_surface_members, SURFACE_MEMBERS, others | 1u << source, 1u << source));
  tcp_add(items, "oneOf", either);
  cJSON *schema = tcp_array_schema(items, 0, TC_MAX_SURFACES);
  tcp_add(schema, "description", cJSON_CreateStringReference(member->doc));
  return schema;
}

const tcp_special tcp_special_surfaces = {read_surfaces, write_surfaces, reset_surfaces, surfaces_schema};
