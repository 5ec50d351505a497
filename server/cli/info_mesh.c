/* tomocast info for a mesh file. */
#include <cjson/cJSON.h>
#include <inttypes.h>
#include <stdio.h>

#include "renderer/import/import.h"
#include "renderer/mesh/measure.h"
#include "server/cli/cli.h"

static void print_json(const tc_mesh *m, const tc_mesh_file *from, const tc_mesh_measures *is) {
  cJSON *o = cJSON_CreateObject();
  cJSON_AddStringToObject(o, "kind", from->format);
  cJSON_AddNumberToObject(o, "triangles", (double)m->n_triangles);
  cJSON_AddNumberToObject(o, "vertices", (double)m->n_vertices);
  cJSON_AddNumberToObject(o, "degenerate", (double)from->degenerate);
  cJSON_AddItemToObject(o, "low", cJSON_CreateDoubleArray(is->low, 3));
  cJSON_AddItemToObject(o, "high", cJSON_CreateDoubleArray(is->high, 3));
  cJSON_AddBoolToObject(o, "closed", is->closed);
  cJSON_AddBoolToObject(o, "normals", m->normals != NULL);
  cJSON_AddBoolToObject(o, "colors", m->colors != NULL);
  cJSON_AddNumberToObject(o, "bytes", (double)m->bytes);
  char *text = cJSON_Print(o);
  puts(text);
  cJSON_free(text);
  cJSON_Delete(o);
}

static void print_text(const tc_mesh *m, const tc_mesh_file *from, const tc_mesh_measures *is) {
  printf("kind         %s\n", from->format);
  printf("triangles    %zu, %s", m->n_triangles, is->closed ? "closed" : "open: some edges are a border");
  if (from->degenerate) printf("; %" PRIu64 " degenerate ones left out", from->degenerate);
  printf("\nvertices     %zu, %s normals, %s colours\n", m->n_vertices, m->normals ? "with" : "without",
         m->colors ? "with" : "without");
  printf("extent       %.9g to %.9g, %.9g to %.9g, %.9g to %.9g mm LPS\n", is->low[0], is->high[0], is->low[1], is->high[1],
         is->low[2], is->high[2]);
  printf("bytes        %zu\n", m->bytes);
}

bool tcs_cli_info_mesh(const char *path, bool json, GError **error) {
  tc_mesh_file from;
  tc_mesh_measures is;
  tc_mesh *m = tc_import_mesh(path, NULL, &from, error);
  if (!m) return false;
  tc_mesh_measure(m, &is);
  (json ? print_json : print_text)(m, &from, &is);
  tc_mesh_free(m);
  return true;
}
