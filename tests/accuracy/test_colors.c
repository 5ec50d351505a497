/* Volumes of colours (renderer/import/colors.h): slices show the colours that were put in, and more colours than labels
 * stay near theirs. */
#include "tests/support/test.h"

#include "renderer/import/colors.h"
#include "renderer/tomocast.h"
#include "tests/support/grid.h"
#include "tests/support/renderers.h"

/* Planes of one colour each, to bytes in uneven pieces. */
static tc_volume *colored(int side, const uint8_t (*planes)[3]) {
  tc_volume_desc d = {.dims = {side, side, side}, .type = TC_U8, .spacing = {1, 1, 1}, .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .slope = 1};
  tc_volume *v = tc_volume_new(&d, NULL);
  tc_colors *colors = tc_colors_new(v, NULL);
  g_autofree uint8_t *bytes = malloc(3 * (size_t)side * (size_t)side * (size_t)side);
  size_t n = 0;
  for (int i = 0; i < side * side * side; i++)
    for (int c = 0; c < 3; c++) bytes[n++] = planes[i / side / side][c];
  for (size_t at = 0; at < n; at += 1000) assert_true(tc_colors_put(colors, bytes + at, n - at < 1000 ? n - at : 1000));
  assert_false(tc_colors_put(colors, bytes, 1));
  assert_true(tc_colors_end(colors));
  tc_colors_free(colors);
  tc_volume_seal(v);
  return v;
}

TEST(volumes_of_colours_are_drawn_in_them) {
  static const uint8_t planes[5][3] = {{0, 0, 0}, {255, 0, 0}, {12, 200, 99}, {1, 2, 3}, {255, 255, 255}};
  g_autoptr(tc_volume) v = colored(5, planes);
  for (int slab = 0; slab < 2; slab++)
    for (int z = 0; z < 5; z++) {
      g_auto(tc_scene) scene;
      test_scene(&scene, 16, 16);
      scene.mode = TC_MODE_MPR;
      scene.mpr.has_center = true;
      for (int k = 0; k < 3; k++) scene.mpr.center[k] = k < 2 ? 2 : z;
      scene.mpr.zoom = 2; /* all pixels within */
      scene.mpr.thickness_mm = slab ? 0.5 : 0;
      scene.window.center = 127.5;
      scene.window.width = 255;
      EACH_RENDERER(i) {
        const float *image = test_draw(i, v, &scene, NULL, NULL)->linear;
        for (int k = 0; k < 3 && !slab; k++)
          if (fabs((double)image[4 * 136 + k] * 255 - planes[z][k]) > 0.01)
            fail_msg("%s: channel %d of plane %d is %g", test_names[i], k, z, (double)image[4 * 136 + k] * 255);
        if (slab) assert_true(image[4 * 136] == image[4 * 136 + 1] && image[4 * 136] == image[4 * 136 + 2]);
      }
    }
}

/* More colours than labels: none is farther off than five bits a channel leave it. */
TEST(many_colours_stay_near) {
  enum { SIDE = 36 };
  tc_volume_desc d = {.dims = {SIDE, SIDE, SIDE}, .type = TC_U8, .spacing = {1, 1, 1}, .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .slope = 1};
  g_autoptr(tc_volume) v = tc_volume_new(&d, NULL);
  tc_colors *colors = tc_colors_new(v, NULL);
  for (int i = 0; i < SIDE * SIDE * SIDE; i++)
    assert_true(tc_colors_put(colors, (const uint8_t[3]){(uint8_t)(i % SIDE * 7), (uint8_t)(i / SIDE % SIDE * 7), (uint8_t)(i / SIDE / SIDE * 7)}, 3));
  assert_true(tc_colors_end(colors));
  tc_colors_free(colors);
  int most = 0, exact = 0;
  for (int i = 0; i < SIDE * SIDE * SIDE; i++) {
    double label;
    assert_true(tc_volume_voxel(tc_volume_colors(v), (const int[3]){i % SIDE, i / SIDE % SIDE, i / SIDE / SIDE}, &label));
    const tc_segment *s = tc_volume_segment(tc_volume_colors(v), (uint32_t)label);
    const int want[3] = {i % SIDE * 7, i / SIDE % SIDE * 7, i / SIDE / SIDE * 7};
    int off = 0;
    for (int c = 0; c < 3; c++) off = MAX(off, abs((int)lrintf(s->color[c] * 255) - want[c]));
    most = MAX(most, off);
    exact += off == 0;
  }
  print_message("  %d of %d exact, at most %d of 255 off\n", exact, SIDE * SIDE * SIDE, most);
  assert_true(exact >= 32767 && most <= 7);
}

TESTS(test_renderers_open, test_renderers_close)
