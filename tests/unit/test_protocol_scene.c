/* Documents into scenes and back. */
#include "tests/support/test.h"

#include "protocol/protocol.h"
#include "tests/support/scoped.h"

static const tcp_scene_context context = {-1000, 3000};

static tc_scene defaults, scene;

static int set_up(void **state) {
  tc_scene_init(&defaults);
  tc_scene_init(&scene);
  return 0;
}

static int tear_down(void **state) {
  tc_scene_clear(&defaults);
  tc_scene_clear(&scene);
  return 0;
}

static bool patch(const char *text, GError **error) {
  g_autoptr(cJSON) document = tcp_json_parse(text, strlen(text), NULL);
  if (!document) fail_msg("the test's own JSON is wrong: %s", text);
  bool good = tcp_scene_patch(&scene, document, &defaults, &context, error);
  return good;
}

static void accept(const char *text) {
  GError *error = NULL;
  if (!patch(text, &error)) fail_msg("%s: %s", text, error->message);
}

/* Refused with this code, pointer and a message that holds `words`; the scene stays. */
static void refuse(const char *text, tc_error_code code, const char *pointer, const char *words) {
  g_autoptr(GError) error = NULL;
  g_autoptr(cJSON) before = tcp_scene_write(&scene);
  if (patch(text, &error)) fail_msg("accepted: %s", text);
  g_autoptr(cJSON) after = tcp_scene_write(&scene);
  if (!cJSON_Compare(before, after, true)) fail_msg("changed the scene: %s", text);
  if (error->code != (int)code) fail_msg("%s: code %d: %s", text, error->code, error->message);
  if (g_strcmp0(tc_error_pointer(error), pointer) != 0) fail_msg("%s: pointer %s", text, tc_error_pointer(error));
  if (!strstr(error->message, words)) fail_msg("%s: \"%s\" lacks \"%s\"", text, error->message, words);
  if (strchr(error->message, '\n')) fail_msg("%s: more than one line", text);
}

/* A document that sets every member there is. */
static const char everything[] =
    "{\"mode\":\"mpr\",\"image\":{\"width\":640,\"height\":480,\"background\":\"transparent\",\"format\":\"png\","
    "\"quality\":77,\"subsampling\":\"4:2:2\",\"linearLight\":true},"
    "\"camera\":{\"projection\":\"orthographic\",\"position\":[1,2,3],\"target\":[4,5.5,-6],\"up\":[0,1,0],\"fovY\":45,"
    "\"height\":123.25},\"transferFunction\":{\"points\":[{\"value\":-5,\"color\":[0,0.5,1],\"extinction\":0},"
    "{\"value\":7,\"color\":[1,0.25,0],\"extinction\":12.5}],\"unitDistance\":2},\"window\":{\"center\":-600,\"width\":"
    "1500},"
    "\"hideTable\":true,\"classification\":\"linearized\",\"order\":\"back-to-front\",\"filter\":\"cubic\",\"sampling\":{\"step\":0.25,"
    "\"raysPerPixel\":4,\"coherence\":true,\"jitter\":true,\"prefilter\":true,\"termination\":0},\"skipping\":{\"mode\":\"off\",\"block\":"
    "8},"
    "\"shading\":{\"model\":\"gooch\",\"gradient\":\"cubic\",\"ambient\":0.1,\"diffuse\":0.9,\"specular\":0.3,\"shininess\":10,"
    "\"light\":[0,0,1]},\"clip\":{\"box\":[[-1,-2,-3],[1,2,3]],\"planes\":[[1,0,0,5],[0,1,0,-5]]},"
    "\"isosurface\":{\"value\":200,\"color\":[0.1,0.2,0.3]},\"mesh\":{\"surfaces\":[{\"value\":300,\"color\":[1,0,0],"
    "\"opacity\":0.5,\"visible\":true,\"twoSided\":false},{\"label\":7,\"opacity\":1,\"visible\":false,\"twoSided\":true},"
    "{\"mesh\":\"m1\",\"opacity\":1,\"visible\":true,\"twoSided\":true},{\"plane\":\"coronal\",\"opacity\":1,\"visible\":true,"
    "\"twoSided\":true,\"model\":\"lambert\",\"shininess\":5}],\"lights\":[{\"direction\":[0,1,0],\"color\":[1,0.5,0],\"intensity\":2},"
    "{\"color\":[1,1,1],\"intensity\":0.5}],\"withVolume\":true},\"splat\":{\"threshold\":[10,20],\"kernelRadius\":2,"
    "\"attribute\":\"density\",\"opaque\":true,\"culling\":false},\"mpr\":{\"orientation\":\"oblique\","
    "\"center\":[1,2,3],\"normal\":[0,1,0],\"up\":[0,0,1],\"thickness\":5,\"projection\":\"minip\",\"zoom\":2},"
    "\"labels\":{\"volume\":\"seg\",\"opacity\":0.25,\"colors\":{\"1\":[1,0,0,1],\"4294967295\":[0,1,0,0.5]},"
    "\"visible\":[1,2]},\"quality\":{\"maxError\":0.01},\"errorMeter\":{\"pixels\":64}}";

TEST_WITH(round_trip, set_up, tear_down) {
  accept(everything);
  assert_int_equal(scene.mode, TC_MODE_MPR);
  assert_true(scene.image.transparent);
  assert_float_equal(scene.camera.target[1], 5.5, 0);
  assert_int_equal(scene.transfer_function.kind, TC_KNOT_EXTINCTION);
  assert_float_equal(scene.transfer_function.points[1].amount, 12.5, 0);
  assert_int_equal(scene.labels.colors[1].label, 4294967295u);
  cJSON *given = tcp_json_parse(everything, strlen(everything), NULL), *written = tcp_scene_write(&scene);
  char *text = cJSON_Print(written);
  if (!cJSON_Compare(given, written, true)) fail_msg("written otherwise: %s", text);
  cJSON_free(text);
  cJSON_Delete(given);
  cJSON_Delete(written);
}

TEST_WITH(written_scene_is_accepted_unchanged, set_up, tear_down) {
  accept("{\"transferFunction\":{\"preset\":\"surface\"}}");
  g_autoptr(cJSON) first = tcp_scene_write(&scene);
  tc_scene_clear(&scene);
  tc_scene_copy(&scene, &defaults);
  assert_true(tcp_scene_patch(&scene, first, &defaults, &context, NULL));
  g_autoptr(cJSON) second = tcp_scene_write(&scene);
  assert_true(cJSON_Compare(first, second, true));
  assert_string_equal(scene.transfer_function.preset, "surface");
}

TEST_WITH(null_returns_to_defaults, set_up, tear_down) {
  static const char *const groups[] = {"image",          "camera",     "transferFunction",
                                       "window",         "sampling",   "skipping",
                                       "shading",        "clip",       "isosurface",
                                       "splat",          "mpr",        "labels",
                                       "quality",        "errorMeter", "mode",
                                       "classification", "order",      "filter",
                                       "hideTable",      "mesh"};
  accept(everything);
  for (size_t i = 0; i < G_N_ELEMENTS(groups); i++) {
    g_autofree char *text = g_strdup_printf("{\"%s\":null}", groups[i]);
    accept(text);
  }
  cJSON *now = tcp_scene_write(&scene), *wanted = tcp_scene_write(&defaults);
  assert_true(cJSON_Compare(now, wanted, true));
  cJSON_Delete(now);
  cJSON_Delete(wanted);
  accept("{\"camera\":{\"fovY\":60,\"position\":[0,-1,0]}}");
  accept("{\"camera\":{\"fovY\":null}}");
  assert_float_equal(scene.camera.fov_y_deg, defaults.camera.fov_y_deg, 0);
  assert_float_equal(scene.camera.position[1], -1, 0);
}

TEST_WITH(refuses_values, set_up, tear_down) {
  static const struct {
    const char *text, *pointer, *words;
  } cases[] = {
      {"{\"mode\":\"mpi\"}", "/mode", "did you mean \"mip\""},
      {"{\"mode\":3}", "/mode", "a string expected, not a number"},
      {"{\"image\":{\"width\":0}}", "/image/width", "at least 1"},
      {"{\"image\":{\"width\":1.5}}", "/image/width", "whole number"},
      {"{\"image\":{\"quality\":101}}", "/image/quality", "at most 100"},
      {"{\"image\":{\"background\":\"clear\"}}", "/image/background", "transparent"},
      {"{\"image\":{\"background\":[0,0]}}", "/image/background", "3 numbers"},
      {"{\"image\":{\"background\":[0,0,1.1]}}", "/image/background/2", "too large"},
      {"{\"image\":{\"background\":\"transparent\"}}", "/image/background", "png"},
      {"{\"image\":[]}", "/image", "an object expected, not an array"},
      {"{\"camera\":{\"fovY\":180}}", "/camera/fovY", "less than 180 degrees"},
      {"{\"camera\":{\"fovY\":0}}", "/camera/fovY", "more than 0"},
      {"{\"camera\":{\"position\":[0,0,1e10]}}", "/camera/position/2", "too large"},
      {"{\"camera\":{\"up\":[0,0,0]}}", "/camera/up", "no direction"},
      {"{\"camera\":{\"up\":[0,2,0]}}", "/camera/up", "parallel"},
      {"{\"camera\":{\"target\":[0,-600,0]}}", "/camera/target", "same point"},
      {"{\"camera\":{\"position\":[0,0,0]}}", "/camera/position", "same point"},
      {"{\"camera\":{\"height\":0}}", "/camera/height", "more than 0 mm"},
      {"{\"window\":{\"width\":0}}", "/window/width", "more than 0"},
      {"{\"sampling\":{\"step\":0}}", "/sampling/step", "too small"},
      {"{\"sampling\":{\"step\":-1}}", "/sampling/step", "too small"},
      {"{\"sampling\":{\"raysPerPixel\":0}}", "/sampling/raysPerPixel", "too small"},
      {"{\"sampling\":{\"termination\":1.5}}", "/sampling/termination", "too large"},
      {"{\"sampling\":{\"jitter\":1}}", "/sampling/jitter", "true or false expected"},
      {"{\"shading\":{\"light\":[0,0,0]}}", "/shading/light", "no direction"},
      {"{\"shading\":{\"light\":\"sun\"}}", "/shading/light", "camera"},
      {"{\"clip\":{\"box\":[[0,0,0]]}}", "/clip/box", "two corners"},
      {"{\"clip\":{\"box\":[[0,5,0],[1,1,1]]}}", "/clip/box", "along y"},
      {"{\"clip\":{\"planes\":[[0,0,1,0],[0,0,0,1]]}}", "/clip/planes/1", "normal"},
      {"{\"splat\":{\"threshold\":[5,1]}}", "/splat/threshold", "swap"},
      {"{\"splat\":{\"attribute\":\"0123456789012345678901234567890123456789\"}}", "/splat/attribute", "at most 31"},
      {"{\"mpr\":{\"orientation\":\"oblique\",\"normal\":[0,0,0]}}", "/mpr/normal", "no direction"},
      {"{\"mpr\":{\"orientation\":\"oblique\",\"up\":[0,0,1]}}", "/mpr/up", "parallel"},
      {"{\"mesh\":{\"surfaces\":{}}}", "/mesh/surfaces", "an array of surfaces"},
      {"{\"mesh\":{\"surfaces\":[{\"opacity\":1}]}}", "/mesh/surfaces/0", "got none"},
      {"{\"mesh\":{\"surfaces\":[{\"value\":1},{\"value\":1,\"label\":2}]}}", "/mesh/surfaces/1", "got several"},
      {"{\"mesh\":{\"surfaces\":[{\"value\":1,\"opacity\":2}]}}", "/mesh/surfaces/0/opacity", "too large"},
      {"{\"mesh\":{\"surfaces\":[{\"value\":1,\"specular\":2}]}}", "/mesh/surfaces/0/specular", "too large"},
      {"{\"mesh\":{\"lights\":{}}}", "/mesh/lights", "an array of lights"},
      {"{\"mesh\":{\"lights\":[{},{\"direction\":[0,0,0]}]}}", "/mesh/lights/1", "give the direction"},
      {"{\"mesh\":{\"surfaces\":[{\"label\":0}]}}", "/mesh/surfaces/0/label", "too small"},
      {"{\"mesh\":{\"surfaces\":[{\"plane\":\"axal\"}]}}", "/mesh/surfaces/0/plane", "did you mean \"axial\"?"},
      {"{\"mesh\":{\"surfaces\":[{\"value\":1,\"colour\":[0,0,0]}]}}", "/mesh/surfaces/0/colour", "did you mean \"color\"?"},
      {"{\"labels\":{\"colors\":{\"x\":[0,0,0,0]}}}", "/labels/colors/x", "label number"},
      {"{\"labels\":{\"colors\":{\"01\":[0,0,0,0]}}}", "/labels/colors/01", "label number"},
      {"{\"labels\":{\"colors\":{\"4294967296\":[0,0,0,0]}}}", "/labels/colors/4294967296", "label number"},
      {"{\"labels\":{\"colors\":{\"1\":[0,0,0]}}}", "/labels/colors/1", "4 numbers"},
      {"{\"labels\":{\"visible\":[1,2.5]}}", "/labels/visible/1", "whole number"},
      {"{\"labels\":{\"visible\":[-1]}}", "/labels/visible/0", "too small"},
      {"{\"quality\":{\"maxError\":0.1,\"maxMilliseconds\":5}}", "/quality/maxMilliseconds", "exclude"},
      {"{\"quality\":{\"maxError\":0}}", "/quality/maxError", "more than 0"},
      {"[]", "", "JSON object"},
      {"null", "", "JSON object"}};
  for (size_t i = 0; i < G_N_ELEMENTS(cases); i++)
    refuse(cases[i].text, TC_ERROR_INVALID, cases[i].pointer, cases[i].words);
}

TEST_WITH(names_unknown_members, set_up, tear_down) {
  refuse("{\"camera\":{\"fov\":40}}", TC_ERROR_INVALID, "/camera/fov", "did you mean \"fovY\"?");
  refuse("{\"camera\":{\"fovy\":40}}", TC_ERROR_INVALID, "/camera/fovy", "did you mean \"fovY\"?");
  refuse("{\"quality\":{\"max_error\":1}}", TC_ERROR_INVALID, "/quality/max_error", "did you mean \"maxError\"?");
  refuse("{\"camrea\":{}}", TC_ERROR_INVALID, "/camrea", "did you mean \"camera\"?");
  refuse("{\"width\":4}", TC_ERROR_INVALID, "/width", "did you mean \"image.width\"?");
  refuse("{\"clip\":{\"zzz\":1}}", TC_ERROR_INVALID, "/clip/zzz", "known: box, planes");
  refuse("{\"a/b~c\":1}", TC_ERROR_INVALID, "/a~1b~0c", "unknown member");
  refuse("{\"line\\nbreak\":1}", TC_ERROR_INVALID, "/line\nbreak", "unknown member");
}

TEST_WITH(limits, set_up, tear_down) {
  refuse("{\"image\":{\"width\":8193}}", TC_ERROR_LIMIT, "/image/width", "at most 8192");
  refuse("{\"image\":{\"width\":8192,\"height\":8192}}", TC_ERROR_LIMIT, "/image", "at most 16800000");
  refuse("{\"sampling\":{\"raysPerPixel\":65}}", TC_ERROR_LIMIT, "/sampling/raysPerPixel", "at most 64");
  refuse("{\"clip\":{\"planes\":[[1,0,0,0],[1,0,0,0],[1,0,0,0],[1,0,0,0],[1,0,0,0],[1,0,0,0],[1,0,0,0]]}}",
         TC_ERROR_LIMIT, "/clip/planes", "at most 6");
  accept("{\"image\":{\"width\":8192,\"height\":2048},\"sampling\":{\"raysPerPixel\":64}}");
}

/* {"transferFunction":{"points":[count knots]}} */
static cJSON *knots_patch(int count) {
  GString *text = g_string_new("{\"transferFunction\":{\"points\":[");
  for (int i = 0; i < count; i++)
    g_string_append_printf(text, "%s{\"value\":%d,\"color\":[0,0,0],\"opacity\":0.5}", i ? "," : "", count - i);
  g_string_append(text, "]}}");
  cJSON *document = tcp_json_parse(text->str, text->len, NULL);
  g_string_free(text, TRUE);
  return document;
}

TEST_WITH(knot_limit, set_up, tear_down) {
  g_autoptr(GError) error = NULL;
  cJSON *most = knots_patch(TC_MAX_KNOTS), *more = knots_patch(TC_MAX_KNOTS + 1);
  assert_true(tcp_scene_patch(&scene, most, &defaults, &context, NULL));
  assert_int_equal(scene.transfer_function.count, TC_MAX_KNOTS);
  assert_float_equal(scene.transfer_function.points[0].value, 1, 0);
  assert_false(tcp_scene_patch(&scene, more, &defaults, &context, &error));
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_LIMIT));
  cJSON_Delete(most);
  cJSON_Delete(more);
}

#define POINTS(list) "{\"transferFunction\":{\"points\":[" list "]}}"
#define WHITE "\"color\":[1,1,1],"

TEST_WITH(refuses_points, set_up, tear_down) {
  refuse(POINTS(""), TC_ERROR_INVALID, "/transferFunction/points", "at least one");
  refuse(POINTS("1"), TC_ERROR_INVALID, "/transferFunction/points/0", "an object");
  refuse(POINTS("{\"value\":1,\"opacity\":1}"), TC_ERROR_INVALID, "/transferFunction/points/0", "\"color\"");
  refuse(POINTS("{" WHITE "\"opacity\":1}"), TC_ERROR_INVALID, "/transferFunction/points/0", "\"value\"");
  refuse(POINTS("{" WHITE "\"value\":1}"), TC_ERROR_INVALID, "/transferFunction/points/0", "got none");
  refuse(POINTS("{" WHITE "\"value\":1,\"opacity\":1,\"extinction\":1}"), TC_ERROR_INVALID,
         "/transferFunction/points/0", "got both");
  refuse(POINTS("{" WHITE "\"value\":1,\"opacity\":1},{" WHITE "\"value\":2,\"extinction\":1}"), TC_ERROR_INVALID,
         "/transferFunction/points/1", "one of the two");
  refuse(POINTS("{" WHITE "\"value\":1,\"opacity\":1.01}"), TC_ERROR_INVALID, "/transferFunction/points/0/opacity",
         "transferFunction.points[0].opacity: 1.01 is too large");
  refuse(POINTS("{" WHITE "\"value\":1,\"extinction\":-1}"), TC_ERROR_INVALID, "/transferFunction/points/0/extinction",
         "too small");
  refuse(POINTS("{" WHITE "\"value\":1,\"opaciti\":1}"), TC_ERROR_INVALID, "/transferFunction/points/0/opaciti",
         "did you mean \"opacity\"?");
  refuse("{\"transferFunction\":{\"unitDistance\":0}}", TC_ERROR_INVALID, "/transferFunction/unitDistance",
         "too small");
  refuse("{\"transferFunction\":{\"preset\":\"ct-bones\"}}", TC_ERROR_INVALID, "/transferFunction/preset",
         "did you mean \"ct-bone\"?");
}

TEST_WITH(knots_are_sorted_stably, set_up, tear_down) {
  accept(POINTS("{\"value\":5,\"color\":[0,0,1],\"opacity\":0.1},{\"value\":1,\"color\":[0,0,0],\"opacity\":0.2},"
                "{\"value\":5,\"color\":[1,0,0],\"opacity\":0.3},{\"value\":5,\"color\":[0,1,0],\"opacity\":0.4}"));
  const tc_knot *k = scene.transfer_function.points;
  const double wanted[] = {0.2, 0.1, 0.3, 0.4};
  for (int i = 0; i < 4; i++)
    assert_float_equal(k[i].amount, wanted[i], 0);
}

TEST_WITH(presets_and_points, set_up, tear_down) {
  accept("{\"transferFunction\":{\"preset\":\"ct-bone\"}}");
  assert_string_equal(scene.transfer_function.preset, "ct-bone");
  assert_true(scene.transfer_function.count > 1);
  accept(POINTS("{" WHITE "\"value\":1,\"opacity\":1}"));
  assert_string_equal(scene.transfer_function.preset, "");
  assert_int_equal(scene.transfer_function.count, 1);
  /* a relative preset spans the volume's range */
  accept("{\"transferFunction\":{\"preset\":\"grey-ramp\"}}");
  assert_float_equal(scene.transfer_function.points[0].value, context.value_min, 0);
  assert_float_equal(scene.transfer_function.points[scene.transfer_function.count - 1].value, context.value_max, 0);
  /* both: the points count, the name stays; the unit distance given beats the preset's */
  accept("{\"transferFunction\":{\"points\":[{" WHITE "\"value\":1,\"opacity\":1}],\"unitDistance\":3,"
         "\"preset\":\"ct-bone\"}}");
  assert_string_equal(scene.transfer_function.preset, "ct-bone");
  assert_int_equal(scene.transfer_function.count, 1);
  assert_float_equal(scene.transfer_function.unit_distance_mm, 3, 0);
  accept("{\"transferFunction\":{\"points\":null,\"preset\":\"ct-lung\"}}");
  assert_string_equal(scene.transfer_function.preset, "ct-lung");
  accept("{\"transferFunction\":{\"preset\":null}}");
  assert_string_equal(scene.transfer_function.preset, defaults.transfer_function.preset);
  assert_int_equal(scene.transfer_function.count, defaults.transfer_function.count);
}

/* Gradients of each cell show the voxels' faces: a scene has them only if it names them. */
TEST_WITH(a_model_alone_is_lit_smoothly, set_up, tear_down) {
  accept("{\"shading\":{\"model\":\"blinn-phong\"}}");
  assert_int_equal(scene.shading.gradient, TC_GRADIENT_CENTRAL);
  tc_scene_light(&scene, false); /* as a preset without light does */
  accept("{\"shading\":{\"model\":\"lambert\"}}");
  assert_int_equal(scene.shading.gradient, TC_GRADIENT_CENTRAL);
}

TEST_WITH(quality_bounds_replace_each_other, set_up, tear_down) {
  accept("{\"quality\":{\"maxError\":0.25}}");
  accept("{\"quality\":{\"maxMilliseconds\":20}}");
  assert_float_equal(scene.quality.max_error, 0, 0);
  assert_float_equal(scene.quality.max_ms, 20, 0);
  accept("{\"quality\":{\"maxError\":0.5,\"maxMilliseconds\":null}}");
  assert_float_equal(scene.quality.max_error, 0.5, 0);
  assert_float_equal(scene.quality.max_ms, 0, 0);
}

TEST_WITH(label_colors_merge, set_up, tear_down) {
  accept("{\"labels\":{\"colors\":{\"7\":[1,0,0,1],\"3\":[0,1,0,1]}}}");
  accept("{\"labels\":{\"colors\":{\"7\":[0,0,1,1],\"3\":null,\"5\":[1,1,1,1]}}}");
  assert_int_equal(scene.labels.n_colors, 2);
  assert_int_equal(scene.labels.colors[0].label, 5);
  assert_int_equal(scene.labels.colors[1].label, 7);
  assert_float_equal(scene.labels.colors[1].rgba[2], 1, 0);
  accept("{\"labels\":{\"visible\":[]}}"); /* none, which is not "all" */
  assert_non_null(scene.labels.visible);
  assert_int_equal(scene.labels.n_visible, 0);
  tc_scene copy;
  tc_scene_copy(&copy, &scene);
  assert_non_null(copy.labels.visible);
  tc_scene_clear(&copy);
  accept("{\"labels\":null}");
  assert_null(scene.labels.visible);
  assert_int_equal(scene.labels.n_colors, 0);
}

/* A list is replaced as a whole, shared by copies, and empty again by null. */
TEST_WITH(surfaces_are_a_list, set_up, tear_down) {
  accept("{\"mesh\":{\"surfaces\":[{\"value\":1},{\"label\":2,\"color\":[0,0,1]}]}}");
  tc_scene copy;
  tc_scene_copy(&copy, &scene);
  accept("{\"mesh\":{\"surfaces\":[{\"value\":5}]}}");
  assert_int_equal(scene.mesh.n_surfaces, 1);
  assert_true(scene.mesh.surfaces[0].visible && scene.mesh.surfaces[0].two_sided && !scene.mesh.surfaces[0].has_color);
  assert_true(copy.mesh.n_surfaces == 2 && copy.mesh.surfaces[1].source == TC_SURFACE_OF_LABEL);
  assert_true(copy.mesh.surfaces[1].label == 2 && copy.mesh.surfaces[1].has_color && copy.mesh.surfaces[1].color[2] == 1);
  tc_scene_clear(&copy);
  accept("{\"mesh\":null}");
  assert_int_equal(scene.mesh.n_surfaces, 0);
  GString *many = g_string_new("{\"mesh\":{\"surfaces\":[{\"value\":0}");
  for (int i = 0; i < TC_MAX_SURFACES; i++) g_string_append(many, ",{\"value\":0}");
  refuse(g_string_append(many, "]}}")->str, TC_ERROR_LIMIT, "/mesh/surfaces", "at most 256");
  g_string_free(many, TRUE);
}

/* What a picture's header has: the members that its mode uses, and labels only where they are the picture. */
TEST_WITH(what_is_shown_is_what_the_mode_uses, set_up, tear_down) {
  static const char *const modes[][2] = {{"mpr", "mode image window mpr"},
                                         {"minip", "mode image camera window clip"},
                                         {"mesh", "mode image camera isosurface mesh labels"}};
  accept("{\"labels\":{\"volume\":\"parts\"},\"clip\":{\"planes\":[[0,0,1,4],[0,0,-1,8]]}}");
  for (size_t i = 0; i < G_N_ELEMENTS(modes); i++) {
    g_autofree char *patch = g_strdup_printf("{\"mode\":\"%s\"}", modes[i][0]);
    accept(patch);
    g_autoptr(cJSON) shown = tcp_scene_write_shown(&scene);
    g_auto(GStrv) names = g_strsplit(modes[i][1], " ", -1);
    for (guint k = 0; names[k]; k++) assert_true(cJSON_HasObjectItem(shown, names[k]));
    assert_int_equal(cJSON_GetArraySize(shown), g_strv_length(names));
  }
  accept("{\"labels\":null}");
  g_autoptr(cJSON) shown = tcp_scene_write_shown(&scene);
  assert_false(cJSON_HasObjectItem(shown, "labels"));
}

static cJSON *random_labels(void) {
  GString *text = g_string_new("{\"labels\":{\"colors\":{");
  for (int label = 0, n = 0; label < 40; label++) {
    const double red = g_random_double();
    if (g_random_boolean())
      g_string_append_printf(text, red < 0.3 ? "%s\"%d\":null" : "%s\"%d\":[%.3f,0,1,1]", n++ ? "," : "", 39 - label, red);
  }
  g_string_append(text, "},\"visible\":[3,1]},\"transferFunction\":{\"points\":[{\"value\":7,\"color\":[0,0,1],\"opacity\":1}]}}");
  cJSON *document = tcp_json_parse(text->str, text->len, NULL);
  g_string_free(text, TRUE);
  return document;
}

/* Nobody can read it any more. */
static void spoil(cJSON *node) {
  for (; node; node = node->next) {
    spoil(node->child);
    if (cJSON_IsNumber(node)) node->type = cJSON_False;
  }
}

TEST_WITH(lists_read_beforehand_are_not_read_again, set_up, tear_down) {
  accept("{\"labels\":{\"colors\":{\"7\":[1,0,0,1],\"3\":[0,1,0,1],\"30\":[1,1,0,1]}}}");
  tc_scene_take_colors(&defaults, &scene);
  for (int i = 0; i < 50; i++) {
    g_autoptr(cJSON) document = random_labels();
    tcp_lists lists;
    GError *error = NULL;
    g_auto(tc_scene) other;
    tc_scene_copy(&other, &scene);
    assert_true(tcp_scene_patch(&scene, document, &defaults, &context, &error));
    assert_true(tcp_lists_read(document, &lists, &error));
    spoil(document->child);
    const tcp_scene_context with = {context.value_min, context.value_max, &lists};
    if (!tcp_scene_patch(&other, document, &defaults, &with, &error)) fail_msg("%s", error->message);
    cJSON *plain = tcp_scene_write(&scene), *listed = tcp_scene_write(&other);
    assert_true(cJSON_Compare(plain, listed, true));
    cJSON_Delete(plain);
    cJSON_Delete(listed);
    tcp_lists_clear(&lists);
  }
}

TEST_WITH(transparency_needs_png, set_up, tear_down) {
  accept("{\"image\":{\"background\":\"transparent\",\"format\":\"png\"}}");
  refuse("{\"image\":{\"format\":\"jpeg\"}}", TC_ERROR_INVALID, "/image/format", "png");
  accept("{\"image\":{\"format\":\"jpeg\",\"background\":[1,1,1]}}");
  assert_false(scene.image.transparent);
}

TEST(set_expressions) {
  static const char *const good[][2] = {{"camera.fovY=40", "{\"camera\":{\"fovY\":40}}"},
                                        {"mode=mip", "{\"mode\":\"mip\"}"},
                                        {"mode=\"mip\"", "{\"mode\":\"mip\"}"},
                                        {"camera.up=[0,0,1]", "{\"camera\":{\"up\":[0,0,1]}}"},
                                        {"camera=null", "{\"camera\":null}"},
                                        {"labels.volume=a=b", "{\"labels\":{\"volume\":\"a=b\"}}"},
                                        {"image.subsampling=4:4:4", "{\"image\":{\"subsampling\":\"4:4:4\"}}"}};
  static const char *const bad[] = {"",       "mode",  "=1",         ".a=1",  "a.=1",
                                    "a..b=1", "a=[1",  "a={\"b\":1", "a=\"x", "a.b.c.d.e.f.g.h.i=1",
                                    "a=\xff", "\xff=1"};
  for (size_t i = 0; i < G_N_ELEMENTS(good); i++) {
    g_autoptr(cJSON) wanted = tcp_json_parse(good[i][1], strlen(good[i][1]), NULL);
    g_autoptr(cJSON) got = tcp_scene_set_expression(good[i][0], NULL);
    if (!cJSON_Compare(wanted, got, true)) fail_msg("%s", good[i][0]);
  }
  for (size_t i = 0; i < G_N_ELEMENTS(bad); i++) {
    g_autoptr(GError) error = NULL;
    if (tcp_scene_set_expression(bad[i], &error)) fail_msg("accepted: %s", bad[i]);
    assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_SYNTAX));
  }
}

TESTS(NULL, NULL)
