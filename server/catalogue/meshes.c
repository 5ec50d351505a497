/* Meshes of the catalogue: import and description. */
#include "server/catalogue/own.h"

#include "server/observe/log.h"

static bool import(tcs_load *load, const tc_import_options *options) {
  load->mesh = tc_import_mesh(load->source.path, options, &load->file, &load->error);
  return load->mesh != NULL;
}

/* The import's reservation includes the normals. */
static bool dress(tcs_load *load) {
  tc_mesh_measure(load->mesh, &load->measures);
  if (load->mesh->normals || tc_mesh_add_normals(load->mesh, tcs_load_goes_on, load, &load->error)) return true;
  g_clear_pointer(&load->mesh, tc_mesh_free);
  load->late = g_get_monotonic_time() > load->deadline_us;
  return false;
}

static void keep(tcs_load *load, tcs_entry *entry) {
  tc_mesh *mesh = entry->mesh = g_steal_pointer(&load->mesh);
  entry->held = mesh->freed_user = tcs_hold(load, mesh->bytes);
  mesh->freed = tcs_hold_freed;
  entry->file = load->file;
  entry->measures = load->measures;
  tcs_log(TCS_LOG_INFO, "mesh.loaded", "triangles=%zu vertices=%zu format=%s bytes=%zu ms=%.0f", mesh->n_triangles,
          mesh->n_vertices, load->file.format, mesh->bytes, (double)(g_get_monotonic_time() - load->began_us) / 1000);
}

const tcs_kind_row tcs_kind_mesh = {TCS_MEMORY_MESHES, import, dress, keep};

void tcs_mesh_describe(cJSON *json, const tc_mesh *mesh, const tc_mesh_file *file, const tc_mesh_measures *measures) {
  cJSON_AddNumberToObject(json, "triangles", (double)mesh->n_triangles);
  cJSON_AddNumberToObject(json, "vertices", (double)mesh->n_vertices);
  cJSON_AddNumberToObject(json, "degenerate", (double)file->degenerate);
  cJSON_AddItemToObject(json, "low", cJSON_CreateDoubleArray(measures->low, 3));
  cJSON_AddItemToObject(json, "high", cJSON_CreateDoubleArray(measures->high, 3));
  cJSON_AddBoolToObject(json, "closed", measures->closed);
  cJSON_AddBoolToObject(json, "colors", mesh->colors != NULL);
  cJSON_AddStringToObject(json, "format", file->format);
  cJSON_AddNumberToObject(json, "bytes", (double)mesh->bytes);
}
