/* The command line from outside: exit codes, one-line errors, files written. */
#include "tests/support/test.h"
#include <sys/wait.h>

#include <glib.h>
#include <glib/gstdio.h>

#include "protocol/protocol.h"
#include "tests/support/folder.h"


typedef struct outcome {
  int code;
  char *out, *err;
} outcome;

static void outcome_clear(outcome *o) {
  g_free(o->out);
  g_free(o->err);
}

/* Runs the program in `folder` with these words (NULL ends them). */
static outcome run(const char *const *words) {
  outcome o = {-1, NULL, NULL};
  GPtrArray *argv = g_ptr_array_new();
  GError *error = NULL;
  int status;
  g_ptr_array_add(argv, (gpointer)TC_BINARY_DIR "/tomocast");
  for (; *words; words++)
    g_ptr_array_add(argv, (gpointer)*words);
  g_ptr_array_add(argv, NULL);
  if (!g_spawn_sync(folder, (char **)argv->pdata, NULL, G_SPAWN_DEFAULT, NULL, NULL, &o.out, &o.err, &status, &error))
    fail_msg("%s", error->message);
  if (WIFEXITED(status)) o.code = WEXITSTATUS(status);
  g_ptr_array_free(argv, TRUE);
  return o;
}

#define RUN(...) run((const char *const[]){__VA_ARGS__, NULL})

/* Exit code, nothing on stdout, one line on stderr that holds `words`. */
static void refuse(outcome o, int code, const char *words) {
  if (o.code != code) fail_msg("exit code %d, expected %d: %s", o.code, code, o.err);
  if (!strstr(o.err, words)) fail_msg("\"%s\" lacks \"%s\"", o.err, words);
  assert_string_equal(o.out, "");
  assert_true(g_str_has_prefix(o.err, "tomocast"));
  assert_ptr_equal(strchr(o.err, '\n'), o.err + strlen(o.err) - 1);
  outcome_clear(&o);
}

static void accept(outcome o) {
  if (o.code != 0) fail_msg("exit code %d: %s", o.code, o.err);
  assert_string_equal(o.err, "");
  outcome_clear(&o);
}

/* The bytes of a file of `folder`, which is then removed. */
static char *take_file(const char *name, gsize *size) {
  char *path = g_build_filename(folder, name, NULL), *bytes = NULL;
  if (!g_file_get_contents(path, &bytes, size, NULL)) fail_msg("%s was not written", name);
  g_remove(path);
  g_free(path);
  return bytes;
}

static void put_file(const char *name, const char *text) {
  g_autofree char *path = g_build_filename(folder, name, NULL);
  assert_true(g_file_set_contents(path, text, -1, NULL));
}

static unsigned be32(const char *bytes) {
  const uint8_t *b = (const uint8_t *)bytes;
  return (unsigned)b[0] << 24 | b[1] << 16 | b[2] << 8 | b[3];
}

static void assert_png(const char *name, unsigned width, unsigned height, int color_type) {
  gsize size;
  g_autofree char *bytes = take_file(name, &size);
  assert_true(size > 33);
  assert_memory_equal(bytes, "\x89PNG\r\n\x1a\n", 8);
  assert_int_equal(be32(bytes + 16), width);
  assert_int_equal(be32(bytes + 20), height);
  assert_int_equal(bytes[25], color_type);
  assert_memory_equal(bytes + size - 8, "IEND", 4);
}

TEST(version_and_help) {
  outcome o = RUN("--version");
  assert_string_equal(o.out, "tomocast " TC_VERSION "\n");
  accept(o);
  o = RUN("--help");
  assert_true(strstr(o.out, "serve") && strstr(o.out, "render") && strstr(o.out, "info"));
  accept(o);
  o = RUN("render", "--help");
  assert_non_null(strstr(o.out, "--scene"));
  accept(o);
}

TEST(bad_usage) {
  refuse(run((const char *const[]){NULL}), 2, "known: serve, render, info");
  refuse(RUN("rendr"), 2, "unknown sub-command rendr; known: serve, render, info");
  refuse(RUN("--frobnicate"), 2, "unknown option --frobnicate");
  refuse(RUN("render"), 2, "give one VOLUME");
  refuse(RUN("render", "a", "b"), 2, "give one VOLUME");
  refuse(RUN("render", "--frobnicate", "demo:head"), 2, "--frobnicate");
  refuse(RUN("render", "demo:bucky", "--backend", "cuda"), 2, "auto, cpu or gl");
  refuse(RUN("render", "demo:bucky", "-o", "picture.bmp"), 2, ".png or .jpg");
  refuse(RUN("render", "demo:bucky", "--width", "-5"), 2, "more than 0");
  refuse(RUN("render", "demo:bucky", "--width", "0"), 2, "--width 0: must be more than 0");
  refuse(RUN("render", "demo:bucky", "--height", "0"), 2, "--height 0: must be more than 0");
  refuse(RUN("render", "demo:bucky", "--width", "9000"), 2, "at most 8192");
  refuse(RUN("render", "demo:bucky", "--set", "camera.fovY=1e999"), 2, "camera.fovY: 1e999 is too large");
  refuse(RUN("render", "demo:bucky", "--set", "camera.fovY=-1e999"), 2, "camera.fovY: -1e999 is too large");
  refuse(RUN("render", "demo:bucky", "--isa", "mmx"), 2, "mmx");
  refuse(RUN("render", "demo:bucky", "--set", "camera.fovY"), 2, "key=value");
  refuse(RUN("render", "demo:bucky", "--set", "camera.fov=3"), 2, "did you mean \"fovY\"?");
  refuse(RUN("render", "demo:bucky", "--set", "camera.fovY=200"), 2, "camera.fovY: 200 is too large");
  refuse(RUN("info"), 2, "give one VOLUME");
  refuse(RUN("convert", "demo:bucky"), 2, "give IN and OUT");
  refuse(RUN("convert", "demo:bucky", "b.txt"), 2, "OUT must end in .nrrd");
  refuse(RUN("convert", "demo:bucky", "b.ply"), 2, "--iso V");
  refuse(RUN("convert", "demo:bucky", "b.nrrd", "--iso", "1"), 2, "--iso, --label and --simplify go with");
  refuse(RUN("convert", "demo:bucky", "b.ply", "--iso", "much"), 2, "a number expected");
  refuse(RUN("convert", "demo:bucky", "b.vmd"), 2, "--threshold LOW,HIGH");
  refuse(RUN("convert", "demo:bucky", "b.vmd", "--threshold", "1"), 2, "LOW,HIGH expected");
  refuse(RUN("convert", "demo:bucky", "b.nrrd", "--labels"), 2, "go with .vmd");
  refuse(RUN("convert", "demo:bucky", "b.vmd", "--iso-shell", "1e9"), 1, "no voxel is in that range");
  refuse(RUN("convert", "demo:bucky", "b.ply", "--iso", "1", "--label", "1"), 2, "--iso V, its value, or --label N");
  refuse(RUN("convert", "demo:bucky", "b.ply", "--label", "0"), 2, "--label: must be a number of at least 1");
  refuse(RUN("convert", "demo:bucky", "b.ply", "--label", "1e300"), 2, "--label: must be a whole number");
  refuse(RUN("convert", "demo:head-labels", "b.ply", "--label", "200"), 1,
         "--label 200: the volume has no voxel of that label");
  refuse(RUN("convert", "demo:bucky", "b.nrrd", "--label", "all"), 2, "--iso, --label and --simplify go with");
  refuse(RUN("convert", "demo:bucky", "b.ply", "--iso", "1e9"), 1, "no surface of that value; its values are 0 to ");
}

TEST(failures) {
  put_file("broken.json", "{\"mode\":}");
  put_file("wrong.json", "{\"mode\":\"mipp\"}");
  put_file("absurd.mha", "ObjectType = Image\nNDims = 3\nDimSize = 1 1 2\nElementType = MET_UCHAR\nOffset = 1e12 0 0\n"
                         "ElementDataFile = LOCAL\nab");
  put_file("not-a-volume.nrrd", "hello");
  refuse(RUN("render", "demo:nobody"), 1, "nobody");
  refuse(RUN("render", "no-such-file.nii"), 1, "no-such-file.nii");
  refuse(RUN("render", "not-a-volume.nrrd"), 1, "not-a-volume.nrrd");
  refuse(RUN("info", "no-such-file.nii"), 1, "no-such-file.nii");
  refuse(RUN("render", "absurd.mha"), 1, "absurd.mha: volume: the origin 1e+12 mm is absurd"); /* the file's fault, not the camera's */
  refuse(RUN("render", "demo:bucky", "--scene", "none.json"), 1, "none.json");
  refuse(RUN("render", "demo:bucky", "--scene", "broken.json"), 1, "broken.json: JSON line 1 column 9");
  refuse(RUN("render", "demo:bucky", "--scene", "wrong.json"), 1, "did you mean \"mip\"?");
  refuse(RUN("render", "demo:bucky", "--width", "16", "--height", "16", "-o", "no/such/folder.png"), 1, "folder.png");
}

TEST(renders_demo_head) {
  accept(RUN("render", "demo:head", "--width", "80", "--height", "60"));
  assert_png("render.png", 80, 60, 2);
  accept(RUN("render", "demo:head", "-o", "head.jpg", "--width", "80", "--height", "60"));
  gsize size;
  g_autofree char *bytes = take_file("head.jpg", &size);
  assert_memory_equal(bytes, "\xff\xd8\xff", 3);
}

TEST(scene_and_set) {
  put_file("scene.json", "{\"image\":{\"width\":40,\"height\":30,\"background\":[1,0,0]},\"camera\":{\"fovY\":20}}");
  accept(RUN("render", "demo:bucky", "--scene", "scene.json", "-o", "a.png"));
  accept(RUN("render", "demo:bucky", "--scene", "scene.json", "-o", "b.png", "--set", "image.background=[0,0,1]"));
  gsize size_a, size_b;
  char *a = take_file("a.png", &size_a), *b = take_file("b.png", &size_b);
  assert_true(size_a != size_b || memcmp(a, b, size_a) != 0);
  g_free(a);
  g_free(b);
  accept(RUN("render", "demo:bucky", "--scene", "scene.json", "-o", "c.png", "--set", "image.width=24", "--set",
             "image.background=transparent"));
  assert_png("c.png", 24, 30, 6);
  refuse(RUN("render", "demo:bucky", "-o", "c.jpg", "--set", "image.background=transparent"), 2, "png");
  /* Out of place until all members are set */
  const char *const above = "camera.position=[0,0,900]", *const down = "camera.target=[0,0,0]";
  refuse(RUN("render", "demo:bucky", "-o", "d.png", "--set", above, "--set", down), 2, "parallel to the view direction");
  accept(RUN("render", "demo:bucky", "-o", "d.png", "--set", above, "--set", down, "--set", "camera.up=[0,1,0]"));
  refuse(RUN("render", "demo:bucky", "-o", "d.png", "--set", "camera.fovY=20", "--set", "camera.fovY=200"), 2, "200 is too large");
}

TEST(same_picture_twice) {
  for (int i = 0; i < 2; i++)
    accept(RUN("render", "demo:bucky", "-o", i ? "2.png" : "1.png", "--width", "64", "--height", "64"));
  gsize one, two;
  char *a = take_file("1.png", &one), *b = take_file("2.png", &two);
  assert_int_equal(one, two);
  assert_memory_equal(a, b, one);
  g_free(a);
  g_free(b);
}

TEST(an_empty_picture_is_explained) {
  static const char *const empty[][2] = {{"mode=mesh", "isosurface.value=99999"},
                                         {"mode=isosurface", "isosurface.value=99999"},
                                         {"mode=splat", "splat.threshold=[99998,99999]"}};
  for (int i = 0; i < 3; i++) {
    outcome o = RUN("render", "demo:head", "--set", "image.width=16", "--set", "image.height=16", "--set", empty[i][0], "--set", empty[i][1]);
    if (!strstr(o.err, "tomocast render: empty picture: ") || !strstr(o.err, "99999") || !strstr(o.err, "2122")) fail_msg("%s: %s", empty[i][0], o.err);
    assert_int_equal(o.code, 0);
    outcome_clear(&o);
  }
}

TEST(timing_is_printed) {
  outcome o = RUN("render", "demo:bucky", "--timing", "--backend", "cpu", "--width", "16", "--height", "16");
  assert_true(strstr(o.out, "render.png: 16 x 16, cpu") && strstr(o.out, "Msamples"));
  accept(o);
}

TEST(info_for_people_and_programs) {
  outcome o = RUN("info", "demo:head");
  assert_true(strstr(o.out, "orientation  LPS") && strstr(o.out, "modality     CT"));
  accept(o);
  o = RUN("info", "demo:head", "--json");
  cJSON *json = tcp_json_parse(o.out, strlen(o.out), NULL);
  assert_string_equal(cJSON_GetObjectItem(json, "kind")->valuestring, "demo");
  assert_int_equal(cJSON_GetArraySize(cJSON_GetObjectItem(json, "dims")), 3);
  assert_int_equal(cJSON_GetArraySize(cJSON_GetObjectItem(json, "direction")), 3);
  assert_string_equal(cJSON_GetObjectItem(json, "unit")->valuestring, "HU");
  cJSON_Delete(json);
  accept(o);
  accept(RUN("convert", "demo:bucky", "b.vmd", "--threshold", "100,255", "--attributes", "value,normal", "--gzip"));
  o = RUN("info", "b.vmd", "--json");
  json = tcp_json_parse(o.out, strlen(o.out), NULL);
  assert_true(cJSON_GetObjectItem(json, "voxels")->valuedouble > 0);
  assert_string_equal(cJSON_GetObjectItem(cJSON_GetObjectItem(json, "attributes"), "normal")->valuestring, "normal");
  cJSON_Delete(json);
  accept(o);
  put_file("b.vmd", "TVMD and no more");
  refuse(RUN("info", "b.vmd"), 1, "open b.vmd: ");
}

static void assert_same_files(const char *one, const char *other) {
  gsize sizes[2];
  g_autofree char *a = take_file(one, &sizes[0]), *b = take_file(other, &sizes[1]);
  assert_int_equal(sizes[0], sizes[1]);
  assert_memory_equal(a, b, sizes[0]);
}

/* A voxel model is read as well as written: packed and unpacked to the same bytes, and its grid gives the same model. */
TEST(voxel_models_there_and_back) {
  accept(RUN("convert", "demo:head", "head.nrrd"));
  accept(RUN("convert", "head.nrrd", "a.vmd", "--threshold", "300,1e9", "--attributes", "value,normal"));
  accept(RUN("convert", "a.vmd", "b.vmd", "--gzip"));
  accept(RUN("convert", "b.vmd", "c.vmd"));
  assert_same_files("a.vmd", "c.vmd");
  refuse(RUN("convert", "b.vmd", "c.vmd", "--threshold", "1,2"), 2, "IN is a .vmd");
  accept(RUN("convert", "b.vmd", "grid.nii.gz"));
  accept(RUN("convert", "grid.nii.gz", "a.vmd", "--threshold", "300,1e9", "--attributes", "value"));
  accept(RUN("convert", "head.nrrd", "b.vmd", "--threshold", "300,1e9", "--attributes", "value"));
  outcome a = RUN("info", "a.vmd"), b = RUN("info", "b.vmd");
  assert_string_equal(strstr(a.out, "note "), strstr(b.out, "note "));
  accept(a), accept(b);
  /* Labels, and what has no value: 1 where it is filled. */
  accept(RUN("convert", "demo:head-labels", "a.vmd", "--labels", "--attributes", "label"));
  accept(RUN("convert", "a.vmd", "grid.nrrd"));
  accept(RUN("convert", "grid.nrrd", "b.vmd", "--labels", "--attributes", "label"));
  assert_same_files("a.vmd", "b.vmd");
  accept(RUN("convert", "demo:bucky", "a.vmd", "--threshold", "100,255"));
  accept(RUN("convert", "a.vmd", "grid.nrrd"));
  a = RUN("info", "grid.nrrd");
  assert_true(strstr(a.out, "range        0 .. 1") != NULL);
  accept(a);
}

/* Value, label, normal and user of each voxel; labels that select the voxels; --labels without a volume, wherever it stands. */
TEST(voxel_models_have_four_attributes) {
  static const char all[] = "value,label,normal,user", head[] = "head.nrrd", labels[] = "labels.nrrd";
  accept(RUN("convert", "demo:head", head)); /* once: painting them takes longer than all else */
  accept(RUN("convert", "demo:head-labels", labels));
  accept(RUN("convert", head, "a.vmd", "--threshold", "300,1e9", "--labels", labels, "--user", labels, "--attributes", all));
  outcome a = RUN("info", "a.vmd");
  assert_non_null(strstr(a.out, "attributes   value 300 .. 2122, label 0 .. "));
  assert_non_null(strstr(a.out, ", normal, user 0 .. "));
  accept(a);
  accept(RUN("convert", head, "b.vmd", "--labels", labels, "--attributes", "value,label"));
  a = RUN("info", "b.vmd");
  assert_non_null(strstr(a.out, "label 1 .. "));
  accept(a);
  accept(RUN("convert", labels, "a.vmd", "--labels", "--attributes", "label"));
  accept(RUN("convert", "--labels", labels, "b.vmd", "--attributes", "label"));
  assert_same_files("a.vmd", "b.vmd");
  refuse(RUN("convert", head, "a.vmd", "--threshold", "1,2", "--user", labels), 2, "--attributes must list user");
  refuse(RUN("convert", head, "a.vmd", "--threshold", "1,2", "--labels", labels), 2, "--attributes must list label");
  refuse(RUN("convert", head, "a.vmd", "--threshold", "1,2", "--labels"), 2, "a .vmd needs its voxels");
  refuse(RUN("convert", head, "a.vmd", "--threshold", "300,1e9", "--user", head, "--attributes", "user"), 1, "from 0 to 255 expected");
  refuse(RUN("convert", head, "a.vmd", "--labels", "none.nrrd"), 1, "none.nrrd: no such file");
}

TEST(meshes_among_each_other) {
  put_file("t.obj", "v 0 0 0\nv 2 0 0\nv 0 2 0\nv 0 0 2\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\nf 1 1 2\n");
  accept(RUN("convert", "t.obj", "t.stl"));
  accept(RUN("convert", "t.stl", "t.ply", "--ascii"));
  outcome o = RUN("info", "t.ply", "--json");
  cJSON *json = tcp_json_parse(o.out, strlen(o.out), NULL);
  assert_string_equal(cJSON_GetObjectItem(json, "kind")->valuestring, "ply");
  assert_true(cJSON_GetObjectItem(json, "triangles")->valueint == 4 && cJSON_GetObjectItem(json, "vertices")->valueint == 4);
  assert_true(cJSON_IsTrue(cJSON_GetObjectItem(json, "closed")));
  assert_true(cJSON_GetArrayItem(cJSON_GetObjectItem(json, "high"), 2)->valuedouble == 2);
  cJSON_Delete(json);
  accept(o);
  o = RUN("info", "t.obj");
  assert_true(strstr(o.out, "triangles    4, closed; 1 degenerate ones left out\n") != NULL);
  accept(o);
  refuse(RUN("convert", "t.stl", "t.nrrd"), 2, "IN is a mesh: OUT must end in .ply, .stl or .obj");
  refuse(RUN("convert", "t.stl", "t.obj", "--iso", "3"), 2, "--iso and --label are of volumes");
  put_file("t.stl", "no");
  refuse(RUN("info", "t.stl"), 1, "open t.stl: the file is cut short");
}

/* In their colours, of one label a single one. */
/* STL has single precision only: said where that moves vertices. */
TEST(far_meshes_lose_nothing_unsaid) {
  put_file("far.obj", "v 10000000.25 0 0\nv 10000003 0 0\nv 10000000.25 5 0\nf 1 2 3\n");
  outcome o = RUN("convert", "far.obj", "far.stl");
  assert_true(o.code == 0 && strstr(o.err, "moves vertices by up to 0.25 mm"));
  outcome_clear(&o);
  o = RUN("convert", "far.obj", "far.ply");
  assert_string_equal(o.err, "");
  accept(o);
  o = RUN("info", "far.ply");
  assert_non_null(strstr(o.out, "extent       10000000.2 to 10000003, 0 to 5"));
  accept(o);
  put_file("near.obj", "v 8000.3 0 0\nv 3 0 0\nv 1 5 0\nf 1 2 3\n");
  o = RUN("convert", "near.obj", "near.stl");
  assert_string_equal(o.err, "");
  accept(o);
}

/* A cube of four columns of labels 1 to 4. */
static void put_labels(const char *name) {
  enum { SIDE = 24, RIM = 3 };
  static const char header[] = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 24 24 24\nencoding: raw\n\n";
  g_autofree char *path = g_build_filename(folder, name, NULL);
  g_autoptr(GByteArray) bytes = g_byte_array_new();
  g_byte_array_append(bytes, (const guint8 *)header, sizeof header - 1);
  for (int i = 0; i < SIDE * SIDE * SIDE; i++) {
    const int x = i % SIDE, y = i / SIDE % SIDE, z = i / (SIDE * SIDE);
    const bool inside = MIN(x, MIN(y, z)) >= RIM && MAX(x, MAX(y, z)) < SIDE - RIM;
    const guint8 label = inside ? (guint8)(1 + (x >= SIDE / 2) + 2 * (y >= SIDE / 2)) : 0;
    g_byte_array_append(bytes, &label, 1);
  }
  assert_true(g_file_set_contents(path, (const char *)bytes->data, bytes->len, NULL));
}

/* The colours of the vertices of an OBJ, which is then removed; a set of strings. */
static GHashTable *take_colors(const char *name) {
  gsize size;
  g_autofree char *bytes = take_file(name, &size);
  GHashTable *colors = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, NULL);
  g_auto(GStrv) lines = g_strsplit(bytes, "\n", -1);
  for (char **line = lines; *line; line++) {
    if (!g_str_has_prefix(*line, "v ")) continue;
    g_auto(GStrv) words = g_strsplit(*line, " ", 5);
    g_hash_table_add(colors, g_strdup(words[4]));
  }
  return colors;
}

TEST(labels_become_a_mesh) {
  put_labels("labels.nrrd");
  accept(RUN("convert", "labels.nrrd", "l.obj", "--label", "1"));
  g_autoptr(GHashTable) one = take_colors("l.obj");
  assert_int_equal(g_hash_table_size(one), 1);
  assert_true(g_hash_table_contains(one, "0.902 0.6235 0"));
  accept(RUN("convert", "labels.nrrd", "l.obj", "--label", "all", "--simplify", ".5"));
  g_autoptr(GHashTable) all = take_colors("l.obj");
  assert_int_equal(g_hash_table_size(all), 4);
  g_autofree char *path = g_build_filename(folder, "labels.nrrd", NULL);
  assert_int_equal(g_unlink(path), 0);
}

/* The same words as the HTTP service's: each sample where the last one ended. */
TEST(a_ray_sample_by_sample) {
  outcome o = RUN("render", "demo:bucky", "--width", "40", "--height", "40", "--ray", "20,20");
  cJSON *json = tcp_json_parse(o.out, strlen(o.out), NULL), *sample;
  assert_int_equal(cJSON_GetArraySize(cJSON_GetObjectItem(json, "color")), 3);
  assert_true(cJSON_IsNumber(cJSON_GetObjectItem(json, "opacity")));
  double end = -1, clear = 1;
  cJSON_ArrayForEach(sample, cJSON_GetObjectItem(json, "samples")) {
    double depth = cJSON_GetObjectItem(sample, "depth")->valuedouble;
    if (end >= 0 && !(depth - end < 1e-6 && end - depth < 1e-6)) fail_msg("depth %g after %g", depth, end);
    end = depth + cJSON_GetObjectItem(sample, "length")->valuedouble;
    double transparency = cJSON_GetObjectItem(sample, "transparency")->valuedouble;
    assert_true(transparency <= clear && transparency >= 0);
    clear = transparency;
  }
  assert_true(cJSON_GetArraySize(cJSON_GetObjectItem(json, "samples")) > 127); /* the cells between 128 voxels */
  cJSON_Delete(json);
  accept(o);
  refuse(RUN("render", "demo:bucky", "--width", "40", "--height", "40", "--ray", "40,0"), 2, "40x40");
  refuse(RUN("render", "demo:bucky", "--ray", "3"), 2, "must be X,Y");
  refuse(RUN("render", "demo:bucky", "--ray", "1,2", "--set", "mode=mpr"), 1, "mode");
}

/* What a frame and a sample cost, and what a dragged transfer function adds. */
TEST(bench_names_the_costs) {
  static const char *const edits[] = {"a knot slides", "all knots shift", "presets change", "fetch", "shade", "resolve"};
  outcome o = RUN("bench", "--size", "32", "--runs", "2", "--error", "0", "demo:bucky");
  assert_non_null(strstr(o.out, "cycles"));
  for (size_t i = 0; i < G_N_ELEMENTS(edits); i++) assert_non_null(strstr(o.out, edits[i]));
  accept(o);
  o = RUN("bench", "--size", "32", "--runs", "2", "--error", "0", "--json", "-", "demo:bucky");
  cJSON *json = tcp_json_parse(o.out, strlen(o.out), NULL), *volume = cJSON_GetArrayItem(json, 0);
  cJSON *first = cJSON_GetArrayItem(cJSON_GetObjectItem(volume, "variants"), 0);
  assert_true(cJSON_GetObjectItem(first, "cyclesPerSample")->valuedouble > 1);
  assert_int_equal(cJSON_GetArraySize(cJSON_GetObjectItem(volume, "edits")), 3);
  assert_int_equal(cJSON_GetArraySize(cJSON_GetObjectItem(volume, "stagesMs")), 8);
  cJSON_Delete(json);
  accept(o);
}

TEST(bench_measures_one_instruction_set) {
  outcome o = RUN("bench", "--size", "32", "--runs", "2", "--error", "0", "--isa", "scalar", "demo:bucky");
  assert_non_null(strstr(o.out, "  scalar, no leaping "));
  assert_null(strstr(o.out, "  avx"));
  accept(o);
  refuse(RUN("bench", "--isa", "scaler", "demo:bucky"), 2, "\"scaler\" is unknown: one of scalar, avx2");
}

/* Both papers' tables on a demo, as text and as JSON: cells of every column, numbers or a reason. */
TEST(tables_of_the_papers) {
  static const struct {
    const char *paper, *heads[2], *published;
    int cells;
  } cases[] = {{"000", {"post b-to-f", "pre f-to-b"}, "71 / 118", 8}, {"001", {"+leaping", "16^3"}, "31.6", 9}};
  for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
    outcome o = RUN("bench", "--paper", cases[i].paper, "--size", "32", "--runs", "2", "demo:bucky");
    for (int k = 0; k < 2; k++)
      assert_non_null(strstr(o.out, cases[i].heads[k]));
    assert_non_null(strstr(o.out, cases[i].published));
    assert_non_null(strstr(o.out, "demo:bucky"));
    accept(o);
    o = RUN("bench", "--paper", cases[i].paper, "--size", "32", "--runs", "2", "--json", "-", "demo:bucky");
    cJSON *json = tcp_json_parse(o.out, strlen(o.out), NULL), *cell;
    assert_int_equal(cJSON_GetArraySize(json), 2);
    assert_int_equal(cJSON_GetArraySize(cJSON_GetObjectItem(cJSON_GetArrayItem(json, 0), "published")), 6);
    cJSON *cells = cJSON_GetObjectItem(cJSON_GetArrayItem(json, 1), "cells");
    assert_int_equal(cJSON_GetArraySize(cells), cases[i].cells);
    cJSON_ArrayForEach(cell, cells) {
      cJSON *fps = cJSON_GetObjectItem(cell, "framesPerSecond"), *why = cJSON_GetObjectItem(cell, "why");
      assert_true(why ? cJSON_IsNull(fps) : fps->valuedouble > 0);
      if (i == 1) assert_null(why); /* nothing of paper 001 is refused */
    }
    cJSON_Delete(json);
    accept(o);
  }
  refuse(RUN("bench", "--paper", "002"), 2, "000 or 001");
}

TESTS(make_folder, remove_folder)
