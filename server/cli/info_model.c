/* tomocast info of a run-length voxel model. */
#include <cjson/cJSON.h>
#include <stdio.h>

#include "renderer/splat/vmd.h"
#include "server/cli/cli.h"

static const char *const type_names[TC_VMD_TYPE_COUNT] = {"u8", "i8", "u16", "i16", "f32", "normal"};

static void print_json(const tc_vmd *m) {
  const tc_vmd_head *h = &m->head;
  cJSON *o = cJSON_CreateObject(), *attributes;
  cJSON_AddStringToObject(o, "kind", "vmd");
  cJSON_AddItemToObject(o, "dims", cJSON_CreateIntArray(h->grid.dims, 3));
  cJSON_AddItemToObject(o, "spacing", cJSON_CreateDoubleArray(h->grid.spacing, 3));
  cJSON_AddItemToObject(o, "origin", cJSON_CreateDoubleArray(h->grid.origin, 3));
  cJSON_AddNumberToObject(o, "voxels", (double)m->voxels);
  cJSON_AddNumberToObject(o, "runs", (double)m->runs);
  cJSON_AddNumberToObject(o, "bytes", (double)m->total_bytes);
  cJSON_AddNumberToObject(o, "colors", h->n_palette);
  attributes = cJSON_AddObjectToObject(o, "attributes");
  for (int i = 0; i < h->n_attributes; i++)
    cJSON_AddStringToObject(attributes, h->attributes[i].name, type_names[h->attributes[i].type]);
  char *text = cJSON_Print(o);
  puts(text);
  cJSON_free(text);
  cJSON_Delete(o);
}

static void print_text(const tc_vmd *m) {
  const tc_vmd_head *h = &m->head;
  printf("kind         vmd\ndims         %d x %d x %d\n", h->grid.dims[0], h->grid.dims[1], h->grid.dims[2]);
  printf("spacing      %g x %g x %g mm\n", h->grid.spacing[0], h->grid.spacing[1], h->grid.spacing[2]);
  printf("origin       %g, %g, %g mm LPS\n", h->grid.origin[0], h->grid.origin[1], h->grid.origin[2]);
  printf("voxels       %" G_GUINT64_FORMAT " in %" G_GUINT64_FORMAT " runs\n", m->voxels, m->runs);
  printf("attributes  ");
  for (int i = 0; i < h->n_attributes; i++)
    printf(" %s (%s)", h->attributes[i].name, type_names[h->attributes[i].type]);
  printf("%s\nbytes        %zu\n", h->n_attributes ? "" : " none", m->total_bytes);
}

bool tcs_cli_info_model(const char *path, bool json, GError **error) {
  GError *trouble = NULL;
  tc_vmd *m = tc_vmd_read(path, &trouble);
  if (m) (json ? print_json : print_text)(m);
  if (!m) {
    char *name = g_path_get_basename(path);
    g_propagate_prefixed_error(error, trouble, "open %s: ", name);
    g_free(name);
  }
  const bool good = m != NULL;
  tc_vmd_free(m);
  return good;
}
