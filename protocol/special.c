/* Special members: those that are not one field: a word or a colour, lists, optional parts. */
#include <string.h>

#include "protocol/internal.h"

static cJSON *described(const tcp_member *member, cJSON *schema) {
  tcp_add(schema, "description", cJSON_CreateStringReference(member->doc));
  return schema;
}

static cJSON *vector_schema(const tcp_member *member, int count) {
  return tcp_array_schema(tcp_range_schema(member, "number"), count, count);
}

/* Schema of either one fixed word or a vector of three numbers. */
static cJSON *word_or_vector_schema(const tcp_member *member, const char *word) {
  cJSON *schema = cJSON_CreateObject(), *either = cJSON_CreateArray(), *constant = cJSON_CreateObject();
  tcp_add(constant, "const", cJSON_CreateStringReference(word));
  cJSON_AddItemToArray(either, constant);
  cJSON_AddItemToArray(either, vector_schema(member, 3));
  tcp_add(schema, "oneOf", either);
  return described(member, schema);
}

static bool is_word(const cJSON *value, const char *word) {
  return cJSON_IsString(value) && strcmp(value->valuestring, word) == 0;
}

/* --- image.background --------------------------------------------------------------------------- */

static bool read_background(tcp_reader *reader, const tcp_member *member, const cJSON *value) {
  reader->scene->image.transparent = is_word(value, "transparent");
  if (reader->scene->image.transparent) return true;
  if (cJSON_IsString(value)) return tcp_fail(reader, TC_ERROR_INVALID, "\"transparent\" or [r,g,b] expected");
  return tcp_vector_read(reader, member, value, 3, reader->scene->image.background);
}

static cJSON *write_background(const tcp_member *member, const tc_scene *scene) {
  if (scene->image.transparent) return cJSON_CreateStringReference("transparent");
  return tcp_vector_write(scene->image.background, 3);
}

static void reset_background(tcp_reader *reader, const tcp_member *member) {
  reader->scene->image.transparent = reader->defaults->image.transparent;
  memcpy(reader->scene->image.background, reader->defaults->image.background, sizeof reader->scene->image.background);
}

static cJSON *background_schema(const tcp_member *member) { return word_or_vector_schema(member, "transparent"); }

const tcp_special tcp_special_background = {read_background, write_background, reset_background, background_schema};

/* --- shading.light ------------------------------------------------------------------------------ */

static bool is_zero(const double v[3]) { return v[0] == 0 && v[1] == 0 && v[2] == 0; }

static bool read_light(tcp_reader *reader, const tcp_member *member, const cJSON *value) {
  reader->scene->shading.light_at_camera = is_word(value, "camera");
  if (reader->scene->shading.light_at_camera) return true;
  if (cJSON_IsString(value)) return tcp_fail(reader, TC_ERROR_INVALID, "\"camera\" or a direction [x,y,z] expected");
  if (!tcp_vector_read(reader, member, value, 3, reader->scene->shading.light)) return false;
  return !is_zero(reader->scene->shading.light) ||
         tcp_fail(reader, TC_ERROR_INVALID, "[0,0,0] is no direction; give the direction to the light");
}

static cJSON *write_light(const tcp_member *member, const tc_scene *scene) {
  if (scene->shading.light_at_camera) return cJSON_CreateStringReference("camera");
  return tcp_vector_write(scene->shading.light, 3);
}

static void reset_light(tcp_reader *reader, const tcp_member *member) {
  reader->scene->shading.light_at_camera = reader->defaults->shading.light_at_camera;
  memcpy(reader->scene->shading.light, reader->defaults->shading.light, sizeof reader->scene->shading.light);
}

static cJSON *light_schema(const tcp_member *member) { return word_or_vector_schema(member, "camera"); }

const tcp_special tcp_special_light = {read_light, write_light, reset_light, light_schema};

/* --- clip --------------------------------------------------------------------------------------- */

/* Parses `count` rows of `width` numbers each. */
static bool read_rows(tcp_reader *reader, const tcp_member *member, const cJSON *value, int width, double *rows) {
  int i = 0;
  for (const cJSON *row = value->child; row; row = row->next, i++) {
    size_t mark = tcp_enter_index(reader, i);
    if (!tcp_vector_read(reader, member, row, width, rows + i * width)) return false;
    tcp_leave(reader, mark);
  }
  return true;
}

static bool read_box(tcp_reader *reader, const tcp_member *member, const cJSON *value) {
  double(*box)[3] = reader->scene->clip.box;
  if (!cJSON_IsArray(value) || cJSON_GetArraySize(value) != 2)
    return tcp_fail(reader, TC_ERROR_INVALID, "two corners [[x,y,z],[x,y,z]] expected");
  if (!read_rows(reader, member, value, 3, box[0])) return false;
  for (int axis = 0; axis < 3; axis++)
    if (box[0][axis] > box[1][axis])
      return tcp_fail(reader, TC_ERROR_INVALID, "the first corner exceeds the second along %c; swap the two values",
                      "xyz"[axis]);
  reader->scene->clip.has_box = true;
  return true;
}

static cJSON *write_box(const tcp_member *member, const tc_scene *scene) {
  if (!scene->clip.has_box) return NULL;
  cJSON *rows = cJSON_CreateArray();
  for (int i = 0; i < 2; i++) cJSON_AddItemToArray(rows, tcp_vector_write(scene->clip.box[i], 3));
  return rows;
}

static void reset_box(tcp_reader *reader, const tcp_member *member) {
  reader->scene->clip.has_box = reader->defaults->clip.has_box;
  memcpy(reader->scene->clip.box, reader->defaults->clip.box, sizeof reader->scene->clip.box);
}

static cJSON *box_schema(const tcp_member *member) {
  return described(member, tcp_array_schema(vector_schema(member, 3), 2, 2));
}

const tcp_special tcp_special_box = {read_box, write_box, reset_box, box_schema};

#define MAX_PLANES ((int)G_N_ELEMENTS(((tc_scene *)0)->clip.planes))

static bool read_planes(tcp_reader *reader, const tcp_member *member, const cJSON *value) {
  if (!cJSON_IsArray(value)) return tcp_fail_type(reader, "an array of planes", value);
  int count = cJSON_GetArraySize(value);
  if (count > MAX_PLANES)
    return tcp_fail(reader, TC_ERROR_LIMIT, "at most %d planes are allowed, got %d", MAX_PLANES, count);
  if (!read_rows(reader, member, value, 4, reader->scene->clip.planes[0])) return false;
  for (int i = 0; i < count; i++)
    if (is_zero(reader->scene->clip.planes[i])) {
      tcp_enter_index(reader, i);
      return tcp_fail(reader, TC_ERROR_INVALID, "the normal [nx,ny,nz] is zero; give it a direction");
    }
  reader->scene->clip.n_planes = count;
  return true;
}

static cJSON *write_planes(const tcp_member *member, const tc_scene *scene) {
  cJSON *rows = cJSON_CreateArray();
  for (int i = 0; i < scene->clip.n_planes; i++) cJSON_AddItemToArray(rows, tcp_vector_write(scene->clip.planes[i], 4));
  return rows;
}

static void reset_planes(tcp_reader *reader, const tcp_member *member) {
  reader->scene->clip.n_planes = reader->defaults->clip.n_planes;
  memcpy(reader->scene->clip.planes, reader->defaults->clip.planes, sizeof reader->scene->clip.planes);
}

static cJSON *planes_schema(const tcp_member *member) {
  return described(member, tcp_array_schema(vector_schema(member, 4), 0, MAX_PLANES));
}

const tcp_special tcp_special_planes = {read_planes, write_planes, reset_planes, planes_schema};

/* --- mpr.center --------------------------------------------------------------------------------- */

static bool read_center(tcp_reader *reader, const tcp_member *member, const cJSON *value) {
  reader->scene->mpr.has_center = true;
  return tcp_vector_read(reader, member, value, 3, reader->scene->mpr.center);
}

static cJSON *write_center(const tcp_member *member, const tc_scene *scene) {
  return scene->mpr.has_center ? tcp_vector_write(scene->mpr.center, 3) : NULL;
}

static void reset_center(tcp_reader *reader, const tcp_member *member) {
  reader->scene->mpr.has_center = reader->defaults->mpr.has_center;
  memcpy(reader->scene->mpr.center, reader->defaults->mpr.center, sizeof reader->scene->mpr.center);
}

static cJSON *center_schema(const tcp_member *member) { return described(member, vector_schema(member, 3)); }

const tcp_special tcp_special_mpr_center = {read_center, write_center, reset_center, center_schema};

/* --- quality ------------------------------------------------------------------------------------ */

/* One bound at a time: setting one clears the other, and setting both is an error. */
static bool read_quality(tcp_reader *reader, const tcp_member *member, const cJSON *value) {
  bool is_error = member->offset == offsetof(tc_scene, quality.max_error);
  double bound;
  if (!tcp_number_read(reader, member, value, &bound)) return false;
  if (!is_error && reader->max_error_given)
    return tcp_fail(reader, TC_ERROR_INVALID, "maxError and maxMilliseconds exclude each other; give one of them");
  reader->max_error_given = is_error;
  reader->scene->quality.max_error = is_error ? bound : 0;
  reader->scene->quality.max_ms = is_error ? 0 : bound;
  return true;
}

static cJSON *write_quality(const tcp_member *member, const tc_scene *scene) {
  double bound = *(const double *)((const char *)scene + member->offset);
  return bound > 0 ? cJSON_CreateNumber(bound) : NULL;
}

static void reset_quality(tcp_reader *reader, const tcp_member *member) {
  memcpy((char *)reader->scene + member->offset, (const char *)reader->defaults + member->offset, sizeof(double));
}

static cJSON *quality_schema(const tcp_member *member) { return described(member, tcp_range_schema(member, "number")); }

const tcp_special tcp_special_quality = {read_quality, write_quality, reset_quality, quality_schema};

/* --- labels.force -------------------------------------------------------------------------------- */

/* Only read by checks of the document (tcs_scene_check()); nothing is stored in the scene. */
static bool read_force(tcp_reader *reader, const tcp_member *member, const cJSON *value) {
  return cJSON_IsBool(value) || tcp_fail(reader, TC_ERROR_INVALID, "true or false expected");
}

static cJSON *write_force(const tcp_member *member, const tc_scene *scene) { return NULL; }

static void reset_force(tcp_reader *reader, const tcp_member *member) {}

static cJSON *force_schema(const tcp_member *member) {
  cJSON *schema = cJSON_CreateObject();
  tcp_add(schema, "type", cJSON_CreateStringReference("boolean"));
  return schema;
}

const tcp_special tcp_special_force = {read_force, write_force, reset_force, force_schema};
