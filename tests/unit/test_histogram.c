/* The histogram of a volume's values. */
#include "tests/support/test.h"

#include "renderer/volume/histogram.h"
#include "tests/support/scoped.h"

/* Negative ones too, in every type, with a slope that turns them over. */
TEST(histograms_count_every_voxel) {
  static const int values[][4] = {{0, 100, 200, 255}, {-128, -1, 1, 127}, {0, 1000, 40000, 65535}, {-32768, -1, 1000, 32767}, {-7, 0, 9, 30}};
  for (int type = TC_U8; type < TC_VOXEL_TYPE_COUNT; type++) {
    const tc_volume_desc d = {.dims = {4, 1, 1}, .type = (tc_voxel_type)type, .spacing = {1, 1, 1},
                              .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .slope = -2};
    g_autoptr(tc_volume) v = tc_volume_new(&d, NULL);
    const tc_voxel_type t = (tc_voxel_type)type;
    for (int i = 0; i < 4; i++) {
      const int value = values[type][i];
      void *at = (char *)tc_volume_voxels(v) + (size_t)i * tc_voxel_size(t);
      const float f = (float)value;
      memcpy(at, t == TC_F32 ? (const void *)&f : &value, tc_voxel_size(t)); /* little-endian: the low bytes */
    }
    tc_volume_seal(v);
    uint64_t counts[64], wanted[64] = {0};
    double edges[65];
    tc_volume_histogram(v, 64, counts, edges);
    for (int i = 0; i < 4; i++) {
      const double at = (-2.0 * values[type][i] - edges[0]) * (64 / (edges[64] - edges[0]));
      wanted[at < 64 ? (int)at : 63]++;
    }
    assert_memory_equal(counts, wanted, sizeof counts);
  }
}

TESTS(NULL, NULL)
