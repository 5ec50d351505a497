/* Meshes from OBJ, PLY and STL: what comes out, exactly; what is refused, and in which words. */
#include "import_files.h"

#include <stdlib.h>

#include "renderer/export/export.h"
#include "renderer/mesh/measure.h"
#include "tests/support/read_mesh_here.h"

static tc_mesh *read_bytes(const void *bytes, size_t size, const char *name, tc_mesh_head *head) {
  GError *error = NULL;
  tc_mesh *m = read_mesh_here(bytes, size, name, NULL, 0, 0, head, &error);
  if (!m) fail_msg("%s: %s", name, error->message);
  return m;
}

static tc_mesh *read_text(const char *text, const char *name) { return read_bytes(text, strlen(text), name, NULL); }

/* A torus: closed, 600 vertices, 1200 triangles. */
static tc_mesh *torus(bool normals, double x) {
  enum { U = 30, V = 20 };
  tc_mesh *m = tc_mesh_new(U * V, 2 * U * V, normals, NULL);
  m->origin[0] = x;
  for (int u = 0; u < U; u++)
    for (int v = 0; v < V; v++) {
      const double a = 2 * M_PI * u / U, b = 2 * M_PI * v / V;
      const float n[3] = {(float)(cos(a) * cos(b)), (float)(sin(a) * cos(b)), (float)sin(b)};
      const float p[3] = {(float)(40 * cos(a) + 10 * n[0]), (float)(40 * sin(a) + 10 * n[1]), 10 * n[2]};
      memcpy(m->positions[u * V + v], p, sizeof p);
      if (normals) memcpy(m->normals[u * V + v], n, sizeof n);
      const uint32_t q[4] = {u * V + v, (u + 1) % U * V + v, (u + 1) % U * V + (v + 1) % V, u * V + (v + 1) % V};
      memcpy(m->triangles[2 * (u * V + v)], (uint32_t[3]){q[0], q[1], q[2]}, 12);
      memcpy(m->triangles[2 * (u * V + v) + 1], (uint32_t[3]){q[0], q[2], q[3]}, 12);
    }
  return m;
}

static tc_mesh *written_and_read(const tc_mesh *m, const char *name, bool ascii) {
  GError *error = NULL;
  char *path = path_of(name), *bytes;
  gsize size;
  assert_true(tc_export_mesh(m, path, ascii, &error));
  assert_true(g_file_get_contents(path, &bytes, &size, NULL));
  tc_mesh *back = read_bytes(bytes, size, name, NULL);
  g_free(bytes);
  g_free(path);
  return back;
}

/* ---- what comes out ---- */

/* Indexed formats bring back every bit; of far meshes every bit of the second writing. */
TEST(indexed_formats_come_back_exactly) {
  static const char *const names[] = {"m.ply", "m.obj", "a.ply"};
  for (int c = 0; c < 12; c++) {
    const bool far = c / 3 % 2;
    tc_mesh *first = torus(c >= 6, far ? 1e7 + 0.0625 : 0), *m = written_and_read(first, names[c % 3], c % 3 == 2),
            *back = written_and_read(m, names[c % 3], c % 3 == 2);
    tc_mesh *same = far ? m : first;
    assert_int_equal(back->n_vertices, 600);
    assert_int_equal(back->n_triangles, 1200);
    assert_memory_equal(back->origin, same->origin, sizeof back->origin);
    assert_memory_equal(back->positions, same->positions, 600 * 12);
    assert_memory_equal(back->triangles, first->triangles, 1200 * 12);
    assert_true((back->normals != NULL) == (c >= 6));
    if (c >= 6) assert_memory_equal(back->normals, first->normals, 600 * 12);
    for (int i = 0; i < 600; i++) { /* far from the origin nothing is rounded to single precision */
      const double off = m->origin[0] + m->positions[i][0] - (first->origin[0] + first->positions[i][0]);
      if (fabs(off) > 3e-5) fail_msg("%s: vertex %d is off by %g mm", names[c % 3], i, off);
    }
    tc_mesh_free(first), tc_mesh_free(m), tc_mesh_free(back);
  }
}

/* Colours too, of 8 bits; those of a vertex with two normals go with both of its places. */
TEST(colours_of_vertices_come_back) {
  static const char *const names[] = {"m.ply", "m.obj", "a.ply"};
  for (int c = 0; c < 6; c++) {
    g_autoptr(tc_mesh) m = torus(c >= 3, 0);
    assert_true(tc_mesh_add_colors(m, NULL));
    for (uint32_t i = 0; i < 600; i++) m->colors[i] = i * 0x9e3779b1u >> 8;
    g_autoptr(tc_mesh) back = written_and_read(m, names[c % 3], c % 3 == 2);
    assert_memory_equal(back->colors, m->colors, 600 * 4);
    assert_true(back->bytes == m->bytes);
  }
  g_autoptr(tc_mesh) wide = read_text("ply\nformat ascii 1.0\nelement vertex 3\nproperty float blue\nproperty float x\nproperty float y\n"
                                      "property float z\nproperty ushort red\nproperty double green\nelement face 1\n"
                                      "property list uchar int vertex_index\nend_header\n0.5 0 0 0 65535 -3\nnan 1 0 0 32768 7\n"
                                      "0 0 1 0 0 0.2\n3 0 1 2\n", "w.ply");
  assert_true(wide->colors[0] == 0x8000ff && wide->colors[1] == 0xff80 && wide->colors[2] == 0x3300);
  g_autoptr(tc_mesh) two = read_text("v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nvn 0 0 1\nvn 0 0 -1\nf 1//1 2//1 3//1\nf 1//2 3//2 2//2\n", "o.obj");
  assert_true(two->n_vertices == 6 && two->colors[3] == 0xff && two->colors[4] == 0xff0000 && two->colors[5] == 0xff00);
  g_autoptr(tc_mesh) some = read_text("v 0 0 0 1 0 0\nv 1 0 0\nv 0 1 0 0.5\nf 1 2 3\n", "s.obj"); /* not all have one */
  assert_null(some->colors);
  g_autoptr(tc_mesh) bytes = read_text("ply\nformat ascii 1.0\nelement vertex 3\nproperty int red\nproperty int green\nproperty int blue\n"
                                       "property float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_index\n"
                                       "end_header\n9 9 9 0 0 0\n9 9 9 1 0 0\n9 9 9 0 1 0\n3 0 1 2\n", "i.ply");
  assert_null(bytes->colors); /* of a type that says no brightness */
}

/* What other programs write, within the formats or beside them. */
TEST(habits_of_other_programs_are_read) {
  g_autoptr(tc_mesh) mark = read_text("\xef\xbb\xbfv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "mark.obj");
  assert_true(mark->n_vertices == 3 && mark->n_triangles == 1);
  g_autoptr(tc_mesh) outline = read_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nfo 1/ 2/ 3/\n", "old.obj");
  assert_int_equal(outline->n_triangles, 1);
  g_autoptr(tc_mesh) lines = read_text("ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
                                       "property uchar diffuse_red\nproperty uchar diffuse_green\nproperty uchar diffuse_blue\n"
                                       "element face 1\nproperty list uchar int vertex_indices\nend_header\n\n0 0 0 1 2 3\n \n"
                                       "1 0 0 4 5 6\n\n\n0 1 0 7 8 9\n\t\r\n3 0 1 2\n", "lines.ply");
  assert_true(lines->n_triangles == 1 && lines->colors[2] == 0x090807);
}

TEST(corners_of_an_stl_are_welded) {
  for (int ascii = 0; ascii < 2; ascii++) {
    tc_mesh *m = torus(true, 100.5), *back = written_and_read(m, "m.stl", ascii);
    tc_mesh_measures is, was;
    tc_mesh_measure(back, &is);
    tc_mesh_measure(m, &was);
    assert_true(back->n_vertices == 600 && back->n_triangles == 1200 && is.closed && was.closed && !back->normals);
    check_near(is.low, was.low, 3, 1e-5);
    check_near(is.high, was.high, 3, 1e-5);
    back->triangles[7][1] = back->triangles[7][0]; /* a hole */
    tc_mesh_measure(back, &is);
    assert_false(is.closed);
    tc_mesh_free(m), tc_mesh_free(back);
  }
}

static void put_vertex(GByteArray *out, float x, float y, float z, bool big) {
  const float at[3] = {x, y, z};
  for (int k = 0; k < 3; k++) put_element(out, TC_ELEMENT_F32, at[k], big);
}

/* Either byte order, properties nobody asked for, a polygon of five corners, other elements before and behind. */
TEST(a_ply_of_any_shape_is_read) {
  for (int big = 0; big < 2; big++) {
    g_autofree char *head = g_strdup_printf("ply\r\nformat binary_%s_endian 1.0\r\ncomment SPACE=RAS\r\nelement camera 1\r\n"
                                 "property double focus\r\nproperty list uchar short path\r\nelement vertex 5\r\n"
                                 "property uchar red\r\nproperty float x\r\nproperty float y\r\nproperty float z\r\n"
                                 "element face 2\r\nproperty list ushort int vertex_index\r\nproperty short flags\r\n"
                                 "element edge 1\r\nproperty int v\r\nend_header\r\n",
                                 big ? "big" : "little");
    g_autoptr(GByteArray) b = with_header(head, NULL);
    put_element(b, TC_ELEMENT_F64, 50, big);
    put_uint(b, 2, 1, big), put_uint(b, 7, 2, big), put_uint(b, 8, 2, big);
    for (int i = 0; i < 5; i++) {
      put_uint(b, 255, 1, big);
      put_vertex(b, (float)i, (float)(i * i), 2, big);
    }
    put_uint(b, 5, 2, big);
    for (int i = 0; i < 5; i++) put_uint(b, (uint64_t)i, 4, big);
    put_uint(b, 9, 2, big);
    put_uint(b, 2, 2, big), put_uint(b, 0, 4, big), put_uint(b, 1, 4, big), put_uint(b, 9, 2, big);
    put_uint(b, 3, 4, big);
    tc_mesh_head told;
    g_autoptr(tc_mesh) m = read_bytes(b->data, b->len, "no-name", &told);
    assert_true(m->n_vertices == 5 && m->n_triangles == 3 && told.degenerate == 1);
    const float fourth[3] = {-3, -9, 2}; /* right, anterior became left, posterior */
    const uint32_t last[3] = {0, 3, 4};
    assert_memory_equal(m->positions[3], fourth, sizeof fourth);
    assert_memory_equal(m->triangles[2], last, sizeof last);
  }
}

TEST(an_obj_of_any_shape_is_read) {
  tc_mesh *m = read_text("# x\nmtllib nobody.mtl\no part\nv 0 0 0 1 0.5 0.5\nv 4 0 0\r\nv 4 4 0\nv 0 4 0\nvt 0 0\n"
                         "vn 0 0 2\nvn 0 0 -1\nf 1/1/1 2/1/1 3/1/1 \\\n 4/1/1\nf -1//2 -2//2 -3//2\nf 1//1 1//1 2//1\n"
                         "l 1 2\nf 1//1 2//1",
                         "x.obj");
  assert_true(m->n_triangles == 3 && m->n_vertices == 4 + 3 && m->normals); /* three corners have a second normal */
  const uint32_t last[3] = {4, 5, 6};
  const float up[3] = {0, 0, 1}, down[3] = {0, 0, -1};
  assert_memory_equal(m->triangles[2], last, sizeof last);
  assert_memory_equal(m->normals[3], up, sizeof up);
  assert_memory_equal(m->normals[4], down, sizeof down);
  assert_memory_equal(m->positions[5], m->positions[2], sizeof up);
  tc_mesh_free(m);
  m = read_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\nf 3 2 1\n", "x.obj");
  assert_true(m->n_vertices == 3 && !m->normals); /* a corner without one: none */
  assert_true(tc_mesh_add_normals(m, NULL, NULL, NULL) && m->normals[0][2] == 1);
  tc_mesh_free(m);
}

TEST(missing_normals_point_outwards) {
  tc_mesh *m = torus(true, 0), *bare = torus(false, 0);
  assert_true(tc_mesh_add_normals(bare, NULL, NULL, NULL));
  for (int i = 0; i < 600; i++) {
    const float *a = m->normals[i], *b = bare->normals[i];
    const float along = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    if (!(along > 0.99f)) fail_msg("normal %d is off: cosine %g", i, along);
  }
  tc_mesh_free(m), tc_mesh_free(bare);
}

/* ---- what is refused ---- */

#define PLY "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
#define FACES "element face 1\nproperty list uchar int vertex_indices\nend_header\n"

TEST(bad_meshes_are_one_clear_error) {
  static const struct {
    const char *name, *text, *wanted;
  } cases[] = {
      {"a.obj", "v 0 0\n", "line 1: a vertex wants three numbers"},
      {"a.obj", "v 0 0 0\nv 1 nan 0\n", "line 2: vertex 2 has a coordinate that is no finite number; repair"},
      {"a.obj", "v 0 0 0\nv 1 2e9 0\n", "farther than 1e9 mm"},
      {"a.obj", "v 0 0 0\nf 1 2 3\n", "line 2: a face names a vertex that is not there"},
      {"a.obj", "v 0 0 0\nf 0 1 1\n", "a face names a vertex"},
      {"a.obj", "v 0 0 0\nf -2 1 1\n", "a face names a vertex"},
      {"a.obj", "v 0 0 0\nf 1//1 1//1 1//1\n", "a face names a normal that is not there"},
      {"a.obj", "v 0 0 0\nf 1x 1 1\n", "corners are v, v/t, v//n or v/t/n"},
      {"a.obj", "v 0 0 0\nv 1 0 0\nf 1 1 2\n", "holds no triangle but degenerate ones"},
      {"a.obj", "v 0 0 0\nv 1 0 0\nl 1 2\n", "holds no triangle; save a surface"},
      {"a.ply", "ply\nformat ascii 2.0\n", "header line 2: format"},
      {"a.ply", "ply\nformat ascii 1.0\nelement vertex -3\n", "header line 3: element"},
      {"a.ply", PLY "element face 1\nproperty list uchar int wrong\nend_header\n", "faces want vertex_indices"},
      {"a.ply", PLY "element tristrips 1\n", "triangle strips are not read"},
      {"a.ply", PLY, "no end_header"},
      {"a.ply", PLY FACES "0 0 0\n1 0 inf\n", "vertex 2 of 3: vertex 2 has a coordinate that is no finite"},
      {"a.ply", PLY FACES "0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "face 1 of 1: it names vertex 3 of 3"},
      {"a.ply", PLY FACES "0 0 0\n1 0\n", "line 11: fewer numbers"},
      {"a.ply", PLY FACES "0 0 0\n1 0 0\n0 1 0\n", "face 1 of 1: the file is cut short"},
      {"a.ply", PLY FACES "0 0 0\n1 0 0\n0 1 0\n-1\n", "a list has -1 entries"},
      {"a.stl", "solid x\nfacet\nouter loop\nvertex 0 0 0\nvertex 1 0\n", "line 5: a vertex wants three numbers"},
      {"a.stl", "solid x\nfacet\nouter loop\nvertex 0 0 0\nendloop\n", "line 5: a loop wants three corners"},
      {"a.stl", "solid x\nfacet\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nvertex 1 1 0\n", "more than three corners"},
      {"a.stl", "solid x\nfacet\nouter loop\nvertex 0 0 0\n", "the file is cut short"},
      {"a.stl", "solid x\nendsolid\n", "holds no triangle"},
      {"a.stl", "short", "the file is cut short after 5 bytes"},
      {"none", "what is this", "meshes are read from OBJ, PLY and STL"},
      {"none", "NRRD0004\n", "the file is NRRD, a volume: open it as a volume"},
  };
  for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
    g_autoptr(GError) error = NULL;
    tc_mesh *m = read_mesh_here(cases[i].text, strlen(cases[i].text), cases[i].name, NULL, 0, 0, NULL, &error);
    if (m || !strstr(error->message, cases[i].wanted))
      fail_msg("case %zu wants ...%s..., got %s", i, cases[i].wanted, m ? "a mesh" : error->message);
    assert_null(strchr(error->message, '\n'));
  }
}

static char *torus_file(const char *name, gsize *size) {
  char *path = path_of(name), *bytes = NULL;
  g_autoptr(tc_mesh) m = torus(true, 0);
  assert_true(tc_export_mesh(m, path, name[0] == 'a', NULL) && g_file_get_contents(path, &bytes, size, NULL));
  g_free(path);
  return bytes;
}

/* Damaged by a few bytes, or cut: a sound mesh (the reader of this test checks) or one line. Any unread end is seen. */
TEST(damaged_files_are_meshes_or_errors) {
  static const char *const names[] = {"m.obj", "m.ply", "a.ply", "m.stl", "a.stl"};
  unsigned seed = 1;
  for (size_t n = 0; n < G_N_ELEMENTS(names); n++) {
    gsize size;
    g_autofree char *whole = torus_file(names[n], &size);
    int failed = 0;
    for (int round = 0; round < 150; round++) {
      g_autoptr(GError) error = NULL;
      const bool cut = round % 3 == 0;
      gsize left = cut ? (gsize)rand_r(&seed) % (size - 10) : size;
      g_autofree char *bytes = g_memdup2(whole, left + 1);
      for (int k = 0; !cut && k < 3; k++) bytes[(gsize)rand_r(&seed) % size] ^= (char)(1 << rand_r(&seed) % 8);
      g_autoptr(tc_mesh) m = read_mesh_here(bytes, left, names[n], NULL, 0, 0, NULL, &error);
      if (cut && n != 0 && n != 4) assert_null(m); /* text without numbers of lines may end anywhere */
      assert_true(!m == !!error);
      if (error) assert_null(strchr(error->message, '\n'));
      failed += !m;
    }
    print_message("%s: %d of 150 damaged files refused\n", names[n], failed);
  }
}

TEST(limits_hold_and_a_caller_cancels) {
  gsize size;
  g_autofree char *stl = torus_file("m.stl", &size);
  GError *error = NULL;
  assert_null(read_mesh_here(stl, size, "m.stl", NULL, 1000, 0, NULL, &error));
  assert_int_equal(error->code, TC_ERROR_LIMIT);
  g_clear_error(&error);
  for (int asked = 1; asked < 3; asked++) {
    assert_null(read_mesh_here(stl, size, "m.stl", NULL, 0, asked, NULL, &error));
    assert_int_equal(error->code, TC_ERROR_CANCELLED);
    g_clear_error(&error);
  }
}

/* ---- by the helper process ---- */

typedef struct watched {
  uint64_t reserved;
  int told, most;
} watched;

static bool on_reserve(void *user, uint64_t bytes, GError **error) {
  ((watched *)user)->reserved = bytes;
  return true;
}

static bool on_progress(void *user, double fraction) {
  watched *w = user;
  return ++w->told <= w->most;
}

TEST(the_helper_reads_meshes) {
  gsize size;
  GError *error = NULL;
  char *stl = torus_file("m.stl", &size), *path = path_of("m.stl"), *packed_path = path_of("m.stl.gz");
  GByteArray *packed = deflated(stl, size, true);
  write_bytes("m.stl.gz", packed);
  watched w = {.most = 1 << 30};
  tc_import_options options = {.user = &w, .reserve = on_reserve, .progress = on_progress};
  tc_mesh_file from;
  tc_mesh *m = tc_import_mesh(path, &options, &from, &error), *unpacked = tc_import_mesh(packed_path, NULL, NULL, NULL);
  if (!m) fail_msg("%s", error->message);
  assert_string_equal(from.format, "stl");
  assert_true(m->n_vertices == 600 && w.reserved == tc_mesh_bytes(600, 1200, true) && unpacked->n_vertices == 600);
  w = (watched){0}; /* told once, it says no: nothing is told after that */
  assert_null(tc_import_mesh(path, &options, NULL, &error));
  assert_true(error->code == TC_ERROR_CANCELLED && w.told == 1);
  g_clear_error(&error);
  options = (tc_import_options){.max_voxel_bytes = 1000};
  assert_null(tc_import_mesh(path, &options, NULL, &error));
  assert_true(error->code == TC_ERROR_LIMIT && g_str_has_prefix(error->message, "open m.stl: "));
  g_clear_error(&error);
  assert_null(tc_import(path, NULL, &error));
  assert_non_null(strstr(error->message, "STL, a mesh: open it as a mesh"));
  g_clear_error(&error);
  assert_true(tc_import_names_mesh("A.STL") && tc_import_names_mesh("x.ply.gz") && !tc_import_names_mesh("x.nii.gz"));
  tc_mesh_free(m), tc_mesh_free(unpacked);
  g_byte_array_unref(packed);
  g_free(stl), g_free(path), g_free(packed_path);
}

/* ---- what the daemon believes of a helper ---- */

typedef struct said {
  const uint8_t *bytes;
  size_t size, at;
} said;

static bool read_said(void *user, void *bytes, size_t size, GError **error) {
  said *s = user;
  if (size > s->size - s->at) return tc_set_error(error, TC_ERROR_FORMAT, NULL, "end"), false;
  memcpy(bytes, s->bytes + s->at, size);
  s->at += size;
  return true;
}

static void no_reply(void *user, char what, int fd) {}

TEST(lies_about_the_mesh_are_refused) {
  static uint8_t ring[TC_WIRE_RING_BYTES];
  for (int lie = 0; lie < 13; lie++) {
    tc_mesh_head head = {.n_vertices = 3, .n_triangles = 1, .normals = true, .format = "stl"};
    float floats[2][3][3] = {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 0, 1}, {0, 0, 1}, {0, 0, 1}}};
    uint32_t corners[3] = {0, 1, 2};
    size_t bytes = sizeof floats + sizeof corners;
    if (lie == 1) head.n_triangles = 0;
    if (lie == 2) head.n_vertices = UINT64_C(1) << 40;
    if (lie == 3) head.origin[1] = NAN;
    if (lie == 4) memcpy(head.format, "a\nb", 4);
    if (lie == 5) floats[0][2][1] = INFINITY;
    if (lie == 6) floats[1][2][1] = 2;
    if (lie == 7) corners[1] = 3;
    if (lie == 8) bytes -= 4;
    if (lie == 9) bytes += 4;
    if (lie == 10) head.normals = false;
    if (lie == 12) head.colors = true; /* the corners are missing then */
    memcpy(ring, floats, sizeof floats);
    memcpy(ring + sizeof floats, corners, sizeof corners);
    int ends[2];
    uint8_t all[1024];
    assert_int_equal(pipe(ends), 0);
    tc_wire_send_mesh(ends[1], &head);
    if (lie == 11) tc_wire_send_mesh(ends[1], &head);
    tc_wire_send_voxels(ends[1], 0, bytes);
    tc_wire_send_end(ends[1]);
    said s = {.bytes = all, .size = (size_t)read(ends[0], all, sizeof all)};
    close(ends[0]), close(ends[1]);
    const tc_wire_reader reader = {.read = read_said, .user = &s, .reply = no_reply, .ring = ring};
    tc_mesh_file from;
    GError *error = NULL;
    tc_mesh *m = tc_wire_load_mesh(&reader, &from, &error);
    if (!m != (lie > 0)) fail_msg("lie %d: %s", lie, m ? "believed" : error->message);
    g_clear_error(&error);
    tc_mesh_free(m);
    s.at = 0;
    assert_null(tc_wire_load(&reader, NULL)); /* nor is it a volume */
  }
}

TESTS(make_folder, remove_folder)
