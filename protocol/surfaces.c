/* mesh.surfaces and mesh.lights: lists replaced as a whole. */
#include <string.h>

#include "protocol/internal.h"

enum { VALUE, LABEL, MESH, PLANE, SOURCES, COLOR = SOURCES, OPACITY, VISIBLE, TWO_SIDED, MODEL, SURFACE_MEMBERS = MODEL + 5 };
G_STATIC_ASSERT(G_N_ELEMENTS(tcp_surface_members) == SURFACE_MEMBERS);
G_STATIC_ASSERT((int)SOURCES == TC_SURFACE_SOURCE_COUNT); /* both enums have the same order */

static bool read_surface(tcp_reader *reader, const cJSON *object, tc_mesh_surface *surface) {
  unsigned seen = 0;
  surface->opacity = 1;
  surface->visible = surface->two_sided = true;
  if (!tcp_row_read(reader, tcp_surface_members, SURFACE_MEMBERS, object, surface, &seen)) return false;
  const unsigned sources = seen & ((1u << SOURCES) - 1);
  if (sources == 0 || (sources & (sources - 1)))
    return tcp_fail(reader, TC_ERROR_INVALID, "one of \"value\", \"label\", \"mesh\" and \"plane\" expected, got %s",
                    sources ? "several" : "none");
  surface->source = (tc_surface_source)g_bit_nth_lsf(sources, -1);
  surface->has_color = seen & 1u << COLOR;
  surface->own_shading = seen >> MODEL;
  return true;
}

static bool read_surfaces(tcp_reader *reader, const tcp_member *member, const cJSON *value) {
  if (!cJSON_IsArray(value)) return tcp_fail_type(reader, "an array of surfaces", value);
  const int count = cJSON_GetArraySize(value);
  int i = 0;
  if (count > TC_MAX_SURFACES)
    return tcp_fail(reader, TC_ERROR_LIMIT, "at most %d surfaces are allowed, got %d", TC_MAX_SURFACES, count);
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
      const bool has = m < SOURCES  ? m == (int)surface->source
                       : m >= MODEL ? surface->own_shading >> (m - MODEL) & 1
                                    : m != COLOR || surface->has_color;
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

enum { DIRECTION, LIGHT_MEMBERS = 3 };
G_STATIC_ASSERT(G_N_ELEMENTS(tcp_light_members) == LIGHT_MEMBERS);

static bool read_light(tcp_reader *reader, const cJSON *object, tc_mesh_light *light) {
  unsigned seen = 0;
  *light = (tc_mesh_light){.color = {1, 1, 1}, .intensity = 1};
  if (!tcp_row_read(reader, tcp_light_members, LIGHT_MEMBERS, object, light, &seen)) return false;
  light->at_camera = !(seen & 1u << DIRECTION);
  const double *d = light->direction;
  return light->at_camera || d[0] != 0 || d[1] != 0 || d[2] != 0 ||
         tcp_fail(reader, TC_ERROR_INVALID, "direction [0,0,0] is none; give the direction to the light");
}

static bool read_lights(tcp_reader *reader, const tcp_member *member, const cJSON *value) {
  const int count = cJSON_GetArraySize(value);
  int i = 0;
  if (!cJSON_IsArray(value)) return tcp_fail_type(reader, "an array of lights", value);
  if (count > TC_MAX_LIGHTS) return tcp_fail(reader, TC_ERROR_LIMIT, "at most %d lights are allowed, got %d", TC_MAX_LIGHTS, count);
  for (const cJSON *item = value->child; item; item = item->next, i++) {
    const size_t mark = tcp_enter_index(reader, i);
    if (!read_light(reader, item, &reader->scene->mesh.lights[i])) return false;
    tcp_leave(reader, mark);
  }
  reader->scene->mesh.n_lights = count;
  return true;
}

static cJSON *write_lights(const tcp_member *member, const tc_scene *scene) {
  cJSON *list = cJSON_CreateArray();
  for (int i = 0; i < scene->mesh.n_lights; i++) {
    const tc_mesh_light *light = &scene->mesh.lights[i];
    cJSON *object = cJSON_CreateObject();
    for (int m = light->at_camera ? DIRECTION + 1 : DIRECTION; m < LIGHT_MEMBERS; m++)
      tcp_add(object, tcp_light_members[m].name, tcp_leaf_write(&tcp_light_members[m], light));
    cJSON_AddItemToArray(list, object);
  }
  return list;
}

static void reset_lights(tcp_reader *reader, const tcp_member *member) { reader->scene->mesh.n_lights = 0; }

static cJSON *lights_schema(const tcp_member *member) {
  cJSON *schema = tcp_array_schema(tcp_row_schema(tcp_light_members, LIGHT_MEMBERS, (1u << LIGHT_MEMBERS) - 1, 0), 0, TC_MAX_LIGHTS);
  tcp_add(schema, "description", cJSON_CreateStringReference(member->doc));
  return schema;
}

const tcp_special tcp_special_lights = {read_lights, write_lights, reset_lights, lights_schema};
