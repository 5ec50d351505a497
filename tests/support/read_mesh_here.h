/* Reads mesh files in this process with the helper's readers (read_here.h does volumes), and checks what holds for
 * every mesh. */
#ifndef TC_TEST_READ_MESH_HERE_H
#define TC_TEST_READ_MESH_HERE_H

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/import/helper/format.h"
#include "renderer/import/import.h"
#include "renderer/mesh/mesh.h"

typedef struct mesh_here {
  tc_mesh_head head;
  GByteArray *bytes;
  int asked, most_asked; /* calls of the progress callback; above `most_asked`, if not 0, it cancels */
  uint8_t slot[TC_ORDER_MOST_BYTES];
} mesh_here;

static bool mesh_here_begin(void *user, const tc_mesh_head *head, GError **error) {
  ((mesh_here *)user)->head = *head;
  return true;
}

static void *mesh_here_room(void *user, GError **error) { return ((mesh_here *)user)->slot; }

static bool mesh_here_filled(void *user, size_t bytes, GError **error) {
  mesh_here *here = user;
  if (bytes > sizeof here->slot || !here->head.n_triangles) abort();
  g_byte_array_append(here->bytes, here->slot, (guint)bytes);
  return true;
}

static bool mesh_here_goes_on(void *user, double fraction, GError **error) {
  mesh_here *here = user;
  here->asked++;
  if (!(fraction >= 0 && fraction <= 1)) abort();
  if (!here->most_asked || here->asked <= here->most_asked) return true;
  tc_set_error(error, TC_ERROR_CANCELLED, NULL, "cancelled");
  return false;
}

static void mesh_here_take(mesh_here *here, void *to, size_t bytes) {
  if (bytes > here->bytes->len) abort();
  memcpy(to, here->bytes->data, bytes);
  g_byte_array_remove_range(here->bytes, 0, (guint)bytes);
}

static inline bool mesh_is_sound(const tc_mesh *m) {
  bool sound = m->n_triangles > 0;
  for (size_t i = 0; i < m->n_vertices; i++) {
    const float *n = m->normals ? m->normals[i] : NULL;
    for (int k = 0; k < 3; k++) sound &= fabsf(m->positions[i][k]) <= 4e9f;
    if (n) sound &= fabsf(n[0] * n[0] + n[1] * n[1] + n[2] * n[2] - 1) < 1e-4f;
  }
  for (size_t i = 0; i < m->n_triangles; i++)
    for (int c = 0; c < 3; c++) {
      const uint32_t p = m->triangles[i][c], q = m->triangles[i][(c + 1) % 3];
      sound &= p < m->n_vertices && q < m->n_vertices && p != q;
    }
  return sound;
}

/* Reads with `read`, a tc_format's function, or NULL: detects the format. Aborts if the mesh differs from its header.
 */
static inline tc_mesh *read_mesh_here(const void *bytes, size_t size, const char *name,
                                      bool (*read)(const tc_input *, const tc_order *, GError **), uint64_t most_bytes,
                                      int most_asked, tc_mesh_head *head, GError **error) {
  mesh_here *here = g_new0(mesh_here, 1);
  const tc_order order = {.mesh = true, .max_voxel_bytes = most_bytes, .user = here, .begin_mesh = mesh_here_begin,
                          .room = mesh_here_room, .filled = mesh_here_filled, .goes_on = mesh_here_goes_on};
  tc_input input;
  tc_mesh *m = NULL;
  here->bytes = g_byte_array_new();
  here->most_asked = most_asked;
  tc_input_memory(&input, bytes, size, name);
  if (read ? read(&input, &order, error) : tc_formats_read(&input, "", &order, error)) {
    m = tc_mesh_new(here->head.n_vertices, here->head.n_triangles, here->head.normals, error);
    memcpy(m->origin, here->head.origin, sizeof m->origin);
    mesh_here_take(here, m->positions, m->n_vertices * sizeof *m->positions);
    if (m->normals) mesh_here_take(here, m->normals, m->n_vertices * sizeof *m->normals);
    if (here->head.colors && !tc_mesh_add_colors(m, error)) abort();
    if (m->colors) mesh_here_take(here, m->colors, m->n_vertices * sizeof *m->colors);
    mesh_here_take(here, m->triangles, m->n_triangles * sizeof *m->triangles);
    if (here->bytes->len || !mesh_is_sound(m)) abort();
    if (head) *head = here->head;
  }
  tc_input_close(&input);
  g_byte_array_unref(here->bytes);
  g_free(here);
  return m;
}

#endif
