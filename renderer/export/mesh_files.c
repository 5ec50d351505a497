/* PLY, STL and OBJ, in this machine's byte order, little endian. */
#include <math.h>
#include <string.h>

#include "renderer/export/export.h"
#include "renderer/export/output.h"

/* Distance from the patient's origin beyond which single precision loses a thousandth of a mm. */
#define SINGLE_REACH_MM 8192

static void place(const tc_mesh *m, size_t vertex, double at[3]) {
  for (int k = 0; k < 3; k++) at[k] = m->origin[k] + m->positions[vertex][k];
}

static bool reaches_far(const tc_mesh *m) {
  for (size_t i = 0; i < m->n_vertices; i++)
    for (int k = 0; k < 3; k++)
      if (fabs(m->origin[k] + m->positions[i][k]) > SINGLE_REACH_MM) return true;
  return false;
}

/* Prints digits that restore the same number: nine for single precision, seventeen for double. */
static void print_place(tc_output *o, const double at[3], bool wide) {
  if (wide)
    tc_output_print(o, "%.17g %.17g %.17g", at[0], at[1], at[2]);
  else
    tc_output_print(o, "%.9g %.9g %.9g", (float)at[0], (float)at[1], (float)at[2]);
}

static int channel(const tc_mesh *m, size_t vertex, int c) { return m->colors[vertex] >> 8 * c & 255; }

/* ---- PLY ---- */

static void ply_head(tc_output *o, const tc_mesh *m, bool ascii, bool wide) {
  const char *type = wide ? "double" : "float";
  tc_output_print(o, "ply\nformat %s 1.0\ncomment Tomocast SPACE=LPS mm\nelement vertex %zu\n",
                  ascii ? "ascii" : "binary_little_endian", m->n_vertices);
  tc_output_print(o, "property %s x\nproperty %s y\nproperty %s z\n", type, type, type);
  if (m->normals) tc_output_print(o, "property float nx\nproperty float ny\nproperty float nz\n");
  if (m->colors) tc_output_print(o, "property uchar red\nproperty uchar green\nproperty uchar blue\n");
  tc_output_print(o, "element face %zu\nproperty list uchar uint vertex_indices\nend_header\n", m->n_triangles);
}

static void ply_vertex(tc_output *o, const tc_mesh *m, size_t i, bool ascii, bool wide) {
  double at[3];
  place(m, i, at);
  const float narrow[3] = {(float)at[0], (float)at[1], (float)at[2]}, *n = m->normals ? m->normals[i] : NULL;
  if (ascii) {
    print_place(o, at, wide);
    if (n) tc_output_print(o, " %.9g %.9g %.9g", n[0], n[1], n[2]);
    if (m->colors) tc_output_print(o, " %d %d %d", channel(m, i, 0), channel(m, i, 1), channel(m, i, 2));
    tc_output_print(o, "\n");
    return;
  }
  tc_output_write(o, wide ? (const void *)at : narrow, wide ? sizeof at : sizeof narrow);
  if (n) tc_output_write(o, n, sizeof *m->normals);
  if (m->colors) tc_output_write(o, &m->colors[i], 3);
}

static void write_ply(tc_output *o, const tc_mesh *m, bool ascii) {
  bool wide = reaches_far(m);
  ply_head(o, m, ascii, wide);
  for (size_t i = 0; i < m->n_vertices; i++) ply_vertex(o, m, i, ascii, wide);
  for (size_t i = 0; i < m->n_triangles; i++) {
    const uint32_t *t = m->triangles[i];
    uint8_t record[13] = {3};
    memcpy(record + 1, t, 12);
    if (ascii)
      tc_output_print(o, "3 %u %u %u\n", t[0], t[1], t[2]);
    else
      tc_output_write(o, record, sizeof record);
  }
}

/* ---- STL ---- */

/* Corners of a triangle and the normal of its plane. */
static void facet_of(const tc_mesh *m, size_t i, float facet[4][3]) {
  double p[3][3], n[3], length = 0;
  for (int c = 0; c < 3; c++) place(m, m->triangles[i][c], p[c]);
  for (int k = 0; k < 3; k++) {
    int a = (k + 1) % 3, b = (k + 2) % 3;
    n[k] = (p[1][a] - p[0][a]) * (p[2][b] - p[0][b]) - (p[1][b] - p[0][b]) * (p[2][a] - p[0][a]);
    length = hypot(length, n[k]);
  }
  for (int k = 0; k < 3; k++) {
    facet[0][k] = length > 0 ? (float)(n[k] / length) : 0;
    for (int c = 0; c < 3; c++) facet[1 + c][k] = (float)p[c][k];
  }
}

static void write_stl(tc_output *o, const tc_mesh *m, bool ascii) {
  char head[80] = "Tomocast SPACE=LPS mm"; /* must not begin with "solid" */
  uint32_t count = (uint32_t)m->n_triangles;
  float f[4][3];
  if (ascii) {
    tc_output_print(o, "solid Tomocast SPACE=LPS mm\n");
  } else {
    tc_output_write(o, head, sizeof head);
    tc_output_write(o, &count, sizeof count);
  }
  for (size_t i = 0; i < m->n_triangles; i++) {
    uint8_t record[50] = {0};
    facet_of(m, i, f);
    memcpy(record, f, sizeof f);
    if (!ascii) {
      tc_output_write(o, record, sizeof record);
      continue;
    }
    tc_output_print(o, "facet normal %.6g %.6g %.6g\nouter loop\n", f[0][0], f[0][1], f[0][2]);
    for (int c = 1; c < 4; c++) tc_output_print(o, "vertex %.9g %.9g %.9g\n", f[c][0], f[c][1], f[c][2]);
    tc_output_print(o, "endloop\nendfacet\n");
  }
  if (ascii) tc_output_print(o, "endsolid Tomocast\n");
}

/* ---- OBJ ---- */

static void write_obj(tc_output *o, const tc_mesh *m) {
  const bool wide = reaches_far(m);
  tc_output_print(o, "# Tomocast SPACE=LPS mm\n");
  for (size_t i = 0; i < m->n_vertices; i++) {
    double at[3];
    place(m, i, at);
    tc_output_print(o, "v ");
    print_place(o, at, wide);
    for (int c = 0; c < 3 && m->colors; c++) tc_output_print(o, " %.4g", channel(m, i, c) / 255.0);
    tc_output_print(o, "\n");
  }
  for (size_t i = 0; m->normals && i < m->n_vertices; i++)
    tc_output_print(o, "vn %.9g %.9g %.9g\n", m->normals[i][0], m->normals[i][1], m->normals[i][2]);
  for (size_t i = 0; i < m->n_triangles; i++) {
    const uint32_t a = m->triangles[i][0] + 1, b = m->triangles[i][1] + 1, c = m->triangles[i][2] + 1;
    if (m->normals)
      tc_output_print(o, "f %u//%u %u//%u %u//%u\n", a, a, b, b, c, c);
    else
      tc_output_print(o, "f %u %u %u\n", a, b, c);
  }
}

bool tc_export_mesh(const tc_mesh *mesh, const char *path, bool ascii, GError **error) {
  tc_output o;
  if (!tc_output_begin(&o, path, false, error)) return false;
  if (tc_path_ends(path, ".ply"))
    write_ply(&o, mesh, ascii);
  else if (tc_path_ends(path, ".stl"))
    write_stl(&o, mesh, ascii);
  else
    write_obj(&o, mesh);
  return tc_output_end(&o, error);
}

double tc_export_mesh_loss(const tc_mesh *m, const char *path) {
  const bool wide = reaches_far(m) && !tc_path_ends(path, ".stl");
  double loss = 0;
  for (size_t i = 0; i < m->n_vertices && !wide; i++) {
    double at[3];
    place(m, i, at);
    for (int k = 0; k < 3; k++) loss = fmax(loss, fabs(at[k] - (double)(float)at[k]));
  }
  return loss;
}
