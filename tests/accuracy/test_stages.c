/* What thirty scenes take and what they leave out: the plan's stages as rendered, and counts that say the plan is
 * kept. */
#include "tests/support/test.h"

#include <cjson/cJSON.h>

#include "protocol/protocol.h"
#include "renderer/tomocast.h"
#include "tests/support/scoped.h"

/* Stages that are in, in the plan's order; resolve and encode are always and not named. */
static const struct { const char *scene, *in;
} scenes[] = {
    {"{}", "table-2d skipping termination"},
    {"{\"mode\":\"mesh\",\"shading\":{\"model\":\"lambert\"},\"sampling\":{\"raysPerPixel\":4}}", "gradient skipping rays-per-pixel mesh"},
    {"{\"shading\":{\"model\":\"lambert\"}}", "table-2d gradient skipping termination"},
    {"{\"shading\":{\"model\":\"blinn-phong\"}}", "table-2d gradient skipping termination"},
    {"{\"shading\":{\"model\":\"gooch\"}}", "table-2d gradient skipping termination"},
    {"{\"shading\":{\"model\":\"lambert\",\"gradient\":\"central\"}}", "table-2d gradient skipping termination"},
    {"{\"shading\":{\"gradient\":\"cubic\"}}", "table-2d skipping termination"},
    {"{\"skipping\":{\"mode\":\"off\"}}", "table-2d termination"},
    {"{\"sampling\":{\"termination\":0}}", "table-2d skipping"},
    {"{\"sampling\":{\"termination\":0},\"skipping\":{\"mode\":\"off\"}}", "table-2d"},
    {"{\"transferFunction\":{\"points\":[{\"value\":-2000,\"color\":[1,1,1],\"opacity\":0.02},{\"value\":3000,\"color\":[1,1,1],\"opacity\":0.2}]}}",
     "table-2d termination"},
    {"{\"transferFunction\":{\"points\":[{\"value\":-2000,\"color\":[1,1,1],\"opacity\":0.02},{\"value\":3000,\"color\":[1,1,1],\"opacity\":0.2}]},\"sampling\":{\"termination\":0}}",
     "table-2d"},
    {"{\"classification\":\"approximate\"}", "table-1d skipping termination"},
    {"{\"classification\":\"post\"}", "table-1d skipping termination"},
    {"{\"classification\":\"linearized\"}", "table-1d skipping termination"},
    {"{\"classification\":\"preintegrated2\"}", "table-2d skipping termination"},
    {"{\"order\":\"back-to-front\"}", "table-2d skipping"},
    {"{\"order\":\"back-to-front\",\"classification\":\"approximate\"}", "table-1d skipping"},
    {"{\"filter\":\"nearest\"}", "table-2d skipping termination"},
    {"{\"filter\":\"cubic\"}", "table-2d skipping termination"},
    {"{\"filter\":\"cubic\",\"sampling\":{\"prefilter\":true}}", "coefficients table-2d skipping termination"},
    {"{\"sampling\":{\"raysPerPixel\":4}}", "table-2d skipping rays-per-pixel termination"},
    {"{\"sampling\":{\"raysPerPixel\":4,\"coherence\":true}}",
     "table-2d skipping rays-per-pixel coherence termination"},
    {"{\"sampling\":{\"jitter\":true}}", "table-2d skipping jitter termination"},
    {"{\"clip\":{\"planes\":[[1,0,0,0]]}}", "table-2d skipping clipping termination"},
    {"{\"clip\":{\"box\":[[-50,-50,-50],[50,50,50]]}}", "table-2d skipping clipping termination"},
    {"{\"image\":{\"background\":\"transparent\",\"format\":\"png\"}}", "table-2d skipping termination alpha"},
    {"{\"image\":{\"linearLight\":true}}", "table-2d skipping termination linear-light"},
    {"{\"mode\":\"mip\"}", "skipping"},
    {"{\"mode\":\"minip\"}", "skipping"},
    {"{\"mode\":\"average\"}", ""},
    {"{\"mode\":\"mip\",\"skipping\":{\"mode\":\"off\"}}", ""},
    {"{\"mode\":\"mip\",\"sampling\":{\"raysPerPixel\":2}}", "skipping rays-per-pixel"},
    {"{\"mode\":\"isosurface\"}", "skipping"},
    {"{\"mode\":\"isosurface\",\"shading\":{\"model\":\"lambert\"}}", "gradient skipping"},
    {"{\"mode\":\"mpr\"}", ""},
    {"{\"mode\":\"mpr\",\"mpr\":{\"thickness\":10}}", ""},
    {"{\"mode\":\"mpr\",\"clip\":{\"planes\":[[1,0,0,0]]}}", "clipping"},
    {"{\"labels\":{\"opacity\":1}}", "table-2d skipping termination"},
    {"{\"shading\":{\"model\":\"lambert\"},\"sampling\":{\"raysPerPixel\":2,\"jitter\":true},\"clip\":{\"planes\":[[0,1,0,0]]}}",
     "table-2d gradient skipping clipping rays-per-pixel jitter termination"},
};

typedef struct bench {
  tc_volume *volume;
  tc_renderer *renderer;
  tc_scene start;
  tc_frame frame;
} bench;

static int set_up(void **state) {
  static bench b;
  tc_renderer_options o = {.backend = TC_BACKEND_CPU, .threads = 2};
  b = (bench){.volume = tc_volume_demo("head", NULL), .renderer = tc_renderer_new(&o, NULL)};
  tc_scene_init(&b.start);
  tc_scene_fit(&b.start, b.volume);
  b.start.image.width = b.start.image.height = 40;
  *state = &b;
  return b.volume && b.renderer ? 0 : -1;
}

static int tear_down(void **state) {
  bench *b = *state;
  tc_frame_finish(&b->frame);
  tc_scene_clear(&b->start);
  tc_renderer_free(b->renderer);
  tc_volume_unref(b->volume);
  return 0;
}

static void draw(bench *b, const char *patch, tc_explanation *plan) {
  GError *error = NULL;
  g_auto(tc_scene) scene;
  tc_scene_copy(&scene, &b->start);
  g_autoptr(cJSON) document = cJSON_Parse(patch);
  const tc_volume_stats *range = tc_volume_statistics(b->volume);
  tcp_scene_context context = {.value_min = range->min, .value_max = range->max};
  if (!document) fail_msg("no JSON: %s", patch);
  if (!tcp_scene_patch(&scene, document, &b->start, &context, &error)) fail_msg("%s: %s", patch, error->message);
  if (!tc_render(b->renderer, b->volume, &scene, &(tc_render_request){.explanation = plan}, &b->frame, &error))
    fail_msg("%s: %s", patch, error->message);
}

static void list(const tc_explanation *plan, char *text, size_t size) {
  size_t n = 0;
  text[0] = 0;
  for (int s = 0; s < TC_STAGE_COUNT; s++) {
    assert_true(plan->stages[s].reason[0]); /* in or out, with a reason */
    if (!plan->stages[s].included || s == TC_STAGE_RESOLVE || s == TC_STAGE_ENCODE) continue;
    n += (size_t)snprintf(text + n, size - n, "%s%s", n ? " " : "", tc_stage_name((tc_stage)s));
  }
}

TEST_WITH(stages_are_what_the_scene_needs, NULL, NULL) {
  bench *b = *state;
  int wrong = 0, count = (int)(sizeof scenes / sizeof *scenes);
  assert_true(count >= 30);
  for (int i = 0; i < count; i++) {
    tc_explanation plan;
    char in[300];
    draw(b, scenes[i].scene, &plan);
    list(&plan, in, sizeof in);
    assert_true((b->frame.stats.gradients > 0) == plan.stages[TC_STAGE_GRADIENT].included);
    if (!strcmp(in, scenes[i].in)) continue;
    printf("    {\"%s\", \"%s\"},\n      expected \"%s\"\n", scenes[i].scene, in, scenes[i].in);
    wrong++;
  }
  assert_int_equal(wrong, 0);
}

/* What is out costs nothing: no structure held, no time spent, nothing built again for a camera. */
TEST_WITH(out_means_out, NULL, NULL) {
  bench *b = *state;
  tc_explanation plan;
  draw(b, "{\"transferFunction\":{\"preset\":\"ct-bone\"}}", &plan);
  draw(b, "{\"transferFunction\":{\"preset\":\"ct-bone\"},\"camera\":{\"up\":[0.1,0,1]}}", &plan);
  assert_true(b->frame.stats.tables_ms == 0 && b->frame.stats.skip_ms == 0);
  draw(b, "{\"mode\":\"mip\",\"skipping\":{\"mode\":\"off\"}}", &plan);
  assert_true(b->frame.stats.tables_ms == 0 && b->frame.stats.skip_ms == 0 && b->frame.stats.leaps == 0);
  for (int s = 0; s < TC_STAGE_COUNT; s++)
    if (!plan.stages[s].included) assert_true(plan.stages[s].bytes == 0 && plan.stages[s].ms == 0);
}

TESTS(set_up, tear_down)
