/* Files that are written: volumes come back with their values and place, meshes with their triangles. */
#include "tests/support/test.h"

#include <errno.h>
#include <fcntl.h>
#include <glib/gstdio.h>
#include <signal.h>
#include <sys/resource.h>
#include <unistd.h>

#include "renderer/export/export.h"
#include "renderer/export/output.h"
#include "renderer/import/import.h"
#include "tests/support/folder.h"
#include "tests/support/scoped.h"

static char *path_of(const char *name) { return g_build_filename(folder, name, NULL); }

static char *read_all(const char *path, gsize *size) {
  char *bytes = NULL;
  if (!g_file_get_contents(path, &bytes, size, NULL)) fail_msg("%s was not written", path);
  return bytes;
}

/* ---- volumes ---- */

static tc_volume *make(tc_voxel_type type, double slope, double intercept) {
  tc_volume_desc d = {
      .dims = {7, 5, 3},
      .type = type,
      .spacing = {0.5, 1.25, 3},
      .origin = {-12.5, 1000.25, 7},
      .direction = {0.8, -0.6, 0, 0.6, 0.8, 0.28, 0, 0, 0.96}, /* sheared, as a tilted gantry makes them */
      .slope = slope,
      .intercept = intercept,
      .frames = 1,
      .modality = "CT"};
  tc_volume *v = tc_volume_new(&d, NULL);
  for (int i = 0; i < 7 * 5 * 3; i++) switch (type) {
    case TC_U8: ((uint8_t *)tc_volume_voxels(v))[i] = (uint8_t)(2 * i); break;
    case TC_I8: ((int8_t *)tc_volume_voxels(v))[i] = (int8_t)(i - 60); break;
    case TC_U16: ((uint16_t *)tc_volume_voxels(v))[i] = (uint16_t)(600 * i); break;
    case TC_I16: ((int16_t *)tc_volume_voxels(v))[i] = (int16_t)(300 * i - 15000); break;
    default: ((float *)tc_volume_voxels(v))[i] = i % 40 == 17 ? NAN : (float)(i / 7.0 - 3); break; /* NaN: a gap */
    }
  tc_volume_seal(v);
  return v;
}

static void check_same(const tc_volume *a, const tc_volume *b, const char *name) {
  const tc_volume_desc *p = tc_volume_describe(a), *q = tc_volume_describe(b);
  assert_memory_equal(p->dims, q->dims, sizeof p->dims);
  for (int z = 0; z < 3; z++)
    for (int y = 0; y < 5; y++)
      for (int x = 0; x < 7; x++) {
        const double index[3] = {x, y, z};
        double va, vb, la[3], lb[3];
        const bool known = tc_volume_value_at(a, index, &va);
        assert_int_equal(tc_volume_value_at(b, index, &vb), known);
        if (known && fabs(va - vb) > 1e-6 * fabs(va)) fail_msg("%s: voxel %d %d %d is %.9g, was %.9g", name, x, y, z, vb, va);
        tc_volume_index_to_lps(a, index, la);
        tc_volume_index_to_lps(b, index, lb);
        for (int k = 0; k < 3; k++)
          if (fabs(la[k] - lb[k]) > 1e-4)
            fail_msg("%s: voxel %d %d %d lies at %g, lay at %g", name, x, y, z, lb[k], la[k]);
      }
}

TEST(volumes_come_back) {
  static const char *const names[] = {"v.nrrd", "z.nrrd", "v.mha", "v.nii", "v.NII.GZ"};
  static const struct {
    tc_voxel_type type;
    double slope, intercept;
    tc_voxel_type values; /* what holds them where slope and intercept have no place */
  } cases[] = {{TC_U8, 1, 0, TC_U8},   {TC_I8, 1, 0, TC_I8},        {TC_U16, 1, 0, TC_U16},  {TC_I16, 1, 0, TC_I16},
               {TC_F32, 1, 0, TC_F32}, {TC_U8, 1, -1024, TC_I16},   {TC_I16, -1, 0, TC_I16}, {TC_U8, 0.5, 3, TC_F32},
               {TC_U16, 2, 7, TC_F32}, {TC_F32, 1e-3, 0.25, TC_F32}};
  for (size_t c = 0; c < G_N_ELEMENTS(cases); c++)
    for (size_t n = 0; n < G_N_ELEMENTS(names); n++) {
      g_autoptr(tc_volume) v = make(cases[c].type, cases[c].slope, cases[c].intercept);
      g_autofree char *path = path_of(names[n]);
      GError *error = NULL;
      if (!tc_export_volume(v, path, names[n][0] == 'z', &error)) fail_msg("%s: %s", names[n], error->message);
      g_autoptr(tc_volume) back = tc_import(path, NULL, &error);
      if (!back) fail_msg("%s: %s", names[n], error->message);
      check_same(v, back, names[n]);
      bool nifti = n >= 3;
      assert_int_equal(tc_volume_describe(back)->type, nifti ? cases[c].type : cases[c].values);
      if (n < 2) assert_string_equal(tc_volume_describe(back)->modality, "CT");
      g_remove(path);
    }
}

/* ---- meshes ---- */

/* A tetrahedron. */
static tc_mesh *tetrahedron(double far) {
  static const float at[4][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  static const uint32_t triangles[4][3] = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  tc_mesh *m = tc_mesh_new(4, 4, true, NULL);
  m->origin[1] = far;
  memcpy(m->positions, at, sizeof at);
  memcpy(m->normals, at, sizeof at);
  memcpy(m->triangles, triangles, sizeof triangles);
  return m;
}

static char *write_mesh(const tc_mesh *m, const char *name, bool ascii, gsize *size) {
  char *path = path_of(name), *bytes;
  GError *error = NULL;
  if (!tc_export_mesh(m, path, ascii, &error)) fail_msg("%s", error->message);
  bytes = read_all(path, size);
  g_remove(path);
  g_free(path);
  return bytes;
}

TEST(ply_holds_the_mesh) {
  for (int far = 0; far < 2; far++) {
    g_autoptr(tc_mesh) m = tetrahedron(far ? 1e7 + 0.0625 : 0.0625);
    gsize size;
    char *bytes = write_mesh(m, "m.ply", false, &size), *body = strstr(bytes, "end_header\n");
    assert_non_null(body);
    assert_non_null(strstr(bytes, far ? "property double x" : "property float x"));
    assert_non_null(strstr(bytes, "element vertex 4\n"));
    assert_non_null(strstr(bytes, "element face 4\n"));
    assert_non_null(strstr(bytes, "SPACE=LPS"));
    body += strlen("end_header\n");
    size_t vertex = far ? 36 : 24;
    assert_int_equal(size - (gsize)(body - bytes), 4 * vertex + 4 * 13);
    double y;
    float narrow;
    memcpy(&y, body + 2 * vertex + 8, sizeof y), memcpy(&narrow, body + 2 * vertex + 4, sizeof narrow);
    assert_true((far ? y : narrow) == m->origin[1] + 1); /* not rounded away */
    uint32_t last[3];
    memcpy(last, body + 4 * vertex + 3 * 13 + 1, sizeof last);
    assert_memory_equal(last, m->triangles[3], sizeof last);
    g_free(bytes);
    bytes = write_mesh(m, "m.ply", true, &size);
    assert_non_null(strstr(bytes, "format ascii 1.0"));
    assert_non_null(strstr(bytes, "\n3 1 2 3\n"));
    g_free(bytes);
  }
}

TEST(stl_and_obj_hold_the_mesh) {
  g_autoptr(tc_mesh) m = tetrahedron(2);
  gsize size;
  char *bytes = write_mesh(m, "m.stl", false, &size);
  uint32_t count;
  float facet[12];
  memcpy(&count, bytes + 80, sizeof count);
  memcpy(facet, bytes + 84, sizeof facet);
  assert_true(size == 84 + 4 * 50 && count == 4 && strncmp(bytes, "solid", 5) != 0);
  const float first[12] = {0, 0, -1, 0, 2, 0, 0, 3, 0, 1, 2, 0}; /* outward, then corners 0, 2 and 1 */
  assert_memory_equal(facet, first, sizeof first);
  g_free(bytes);
  bytes = write_mesh(m, "m.stl", true, &size);
  assert_true(g_str_has_prefix(bytes, "solid ") && strstr(bytes, "vertex 1 2 0\n"));
  g_free(bytes);
  bytes = write_mesh(m, "m.obj", false, &size);
  assert_non_null(strstr(bytes, "\nv 1 2 0\n"));
  assert_non_null(strstr(bytes, "\nf 2//2 3//3 4//4\n"));
  g_free(bytes);
}

/* ---- failures ---- */

TEST(a_failure_keeps_what_was_there) {
  g_autoptr(tc_volume) v = make(TC_U8, 1, 0);
  char *path = path_of("taken.nrrd"), *inside = g_build_filename(path, "kept", NULL);
  GError *error = NULL;
  assert_int_equal(g_mkdir(path, 0700), 0); /* a folder of that name cannot be replaced */
  assert_true(g_file_set_contents(inside, "x", 1, NULL));
  assert_false(tc_export_volume(v, path, false, &error));
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_IO));
  g_clear_error(&error);
  GDir *dir = g_dir_open(folder, 0, NULL);
  assert_string_equal(g_dir_read_name(dir), "taken.nrrd");
  assert_null(g_dir_read_name(dir)); /* and nothing half done beside */
  g_dir_close(dir);
  assert_false(tc_export_volume(v, "v.nii", true, &error));
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_INVALID));
  g_clear_error(&error);
  assert_true(tc_export_kind_of("a.STL") == TC_EXPORT_MESH && tc_export_kind_of(".ply") == TC_EXPORT_UNKNOWN);
  g_remove(inside);
  g_rmdir(path);
  g_free(inside);
  g_free(path);
}

/* A limit on a file's size stands for a full disk. */
TEST(a_full_disk_keeps_the_older_file) {
  g_autofree char *path = path_of("picture.png"), *bytes = g_malloc0(1 << 16), *kept = NULL;
  g_autoptr(GError) error = NULL;
  struct rlimit had, small;
  assert_true(tc_export_bytes("older", 5, path, NULL));
  getrlimit(RLIMIT_FSIZE, &had);
  small = (struct rlimit){4096, had.rlim_max};
  void (*handler)(int) = signal(SIGXFSZ, SIG_IGN);
  setrlimit(RLIMIT_FSIZE, &small);
  const bool good = tc_export_bytes(bytes, 1 << 16, path, &error);
  setrlimit(RLIMIT_FSIZE, &had);
  signal(SIGXFSZ, handler);
  assert_false(good);
  if (!strstr(error->message, path) || !strstr(error->message, "File too large")) fail_msg("%s", error->message);
  kept = read_all(path, &(gsize){0});
  assert_string_equal(kept, "older");
  g_autoptr(GDir) dir = g_dir_open(folder, 0, NULL);
  for (const char *name; (name = g_dir_read_name(dir));) assert_false(g_str_has_prefix(name, "picture.png."));
  g_remove(path);
}

/* An interrupted process leaves nothing behind: a file has no name until it is complete. */
TEST(a_file_being_written_has_no_name) {
  g_autofree char *within = path_of("within"), *inside = g_build_filename(within, "whole.ply", NULL);
  assert_int_equal(g_mkdir(within, 0700), 0);
  const int nameless = open(within, O_TMPFILE | O_WRONLY, 0600);
  if (nameless < 0) print_message("this file system has no files without names: %s\n", g_strerror(errno));
  tc_output o;
  assert_true(tc_output_begin(&o, inside, false, NULL));
  tc_output_print(&o, "%d", 123);
  g_autoptr(GDir) dir = g_dir_open(within, 0, NULL);
  assert_true((g_dir_read_name(dir) == NULL) == (nameless >= 0));
  if (nameless >= 0) close(nameless);
  assert_true(tc_output_end(&o, NULL));
  g_dir_rewind(dir);
  assert_string_equal(g_dir_read_name(dir), "whole.ply");
  assert_null(g_dir_read_name(dir));
  g_remove(inside);
  g_rmdir(within);
}

/* What is no file of its own is written to, not replaced. */
TEST(links_and_devices_stay) {
  g_autofree char *target = path_of("target"), *link = path_of("link"), *bytes = NULL;
  assert_int_equal(symlink("target", link), 0);
  assert_true(tc_export_bytes("picture", 7, link, NULL) && tc_export_bytes("new", 3, link, NULL));
  assert_true(g_file_test(link, G_FILE_TEST_IS_SYMLINK));
  bytes = read_all(target, &(gsize){0});
  assert_string_equal(bytes, "new");
  assert_true(tc_export_bytes("x", 1, "/dev/null", NULL));
  assert_false(g_file_test("/dev/null", G_FILE_TEST_IS_REGULAR));
  assert_false(tc_export_bytes("x", 1, "/dev/full", NULL));
  g_remove(link);
  g_remove(target);
}

TESTS(make_folder, remove_folder)
