/* The ledger of memory, and how much there is on machines and in control groups. */
#include "tests/support/test.h"

#include <glib.h>
#include <glib/gstdio.h>

#include "server/config/config.h"
#include "server/memory/budget.h"
#include "server/memory/ledger.h"
#include "server/memory/machine.h"

#define MIB (UINT64_C(1) << 20)

TEST(what_is_taken_is_counted) {
  tcs_budget *budget = tcs_budget_new(100, 60);
  assert_true(tcs_budget_resize(budget, TCS_MEMORY_VOLUMES, 0, 40));
  assert_false(tcs_budget_resize(budget, TCS_MEMORY_LOADS, 0, 21)); /* of voxels 20 are left */
  assert_true(tcs_budget_resize(budget, TCS_MEMORY_LOADS, 0, 20));
  assert_int_equal(tcs_budget_left(budget), 40);
  assert_int_equal(tcs_budget_left_for_voxels(budget), 0);
  assert_false(tcs_budget_resize(budget, TCS_MEMORY_FRAMES, 0, 41));
  assert_true(tcs_budget_resize(budget, TCS_MEMORY_FRAMES, 0, 40));
  tcs_budget_count(budget, TCS_MEMORY_CACHES, 500); /* what is there is there */
  assert_int_equal(tcs_budget_left(budget), 0);
  tcs_budget_set(budget, TCS_MEMORY_CACHES, 0);
  tcs_budget_move(budget, TCS_MEMORY_VOLUMES, TCS_MEMORY_PINNED, 40);
  assert_int_equal(tcs_budget_used(budget, TCS_MEMORY_PINNED), 40);
  tcs_budget_give(budget, TCS_MEMORY_PINNED, 40);
  assert_true(tcs_budget_resize(budget, TCS_MEMORY_LOADS, 20, 60));
  assert_false(tcs_budget_resize(budget, TCS_MEMORY_LOADS, 60, 61));
  assert_true(tcs_budget_resize(budget, TCS_MEMORY_LOADS, 60, 5));
  assert_int_equal(tcs_budget_used(budget, TCS_MEMORY_LOADS), 5);
  tcs_budget_free(budget);
}

TEST(a_ledger_reserves_counts_and_gives_back) {
  tcs_budget *budget = tcs_budget_new(100, 60);
  tcs_ledger ledger;
  tcs_ledger_init(&ledger, budget, TCS_MEMORY_FRAMES);
  assert_true(tc_ledger_take(&ledger.ask, 30));
  tc_ledger_count(&ledger.ask, 50);
  assert_false(tc_ledger_take(&ledger.ask, 21));
  assert_int_equal(atomic_load(&ledger.refused), 21);
  assert_int_equal(atomic_load(&ledger.held_then), 80);
  tc_ledger_count(&ledger.ask, -10);
  assert_true(tc_ledger_take(&ledger.ask, 21));
  assert_int_equal(tcs_budget_used(budget, TCS_MEMORY_FRAMES), 91);
  tcs_ledger_begin(&ledger);
  assert_int_equal(atomic_load(&ledger.refused), 0);
  tcs_ledger_end(&ledger);
  assert_int_equal(tcs_budget_used(budget, TCS_MEMORY_FRAMES), 0);
  assert_true(tc_ledger_take(NULL, UINT64_MAX)); /* no bound */
  tcs_budget_free(budget);
}

TEST(a_refusal_says_what_is_used_by_what) {
  tcs_budget *budget = tcs_budget_new(200 * MIB, 150 * MIB);
  GError *error = NULL;
  tcs_budget_count(budget, TCS_MEMORY_VOLUMES, 120 * MIB);
  tcs_budget_count(budget, TCS_MEMORY_CACHES, 12 * MIB);
  tcs_budget_refuse(budget, TCS_MEMORY_DECODERS, 80 * MIB, &error);
  assert_int_equal(error->code, TC_ERROR_BUSY);
  assert_non_null(strstr(error->message, "decoders need 80.0 MiB more"));
  assert_non_null(strstr(error->message, "volumes 120.0"));
  assert_non_null(strstr(error->message, "caches 12.0 of 200.0 MiB"));
  assert_null(strstr(error->message, "loads"));
  g_error_free(error);
  tcs_budget_free(budget);
}

static bool give_back(void *user, uint64_t bytes, const void *spare) {
  *(uint64_t *)user = bytes;
  return spare != NULL;
}

TEST(who_can_give_back_is_asked_for_what_is_missing) {
  tcs_budget *budget = tcs_budget_new(100, 60);
  uint64_t asked = 0;
  assert_true(tcs_budget_ask(budget, 100, NULL)); /* it is there */
  assert_false(tcs_budget_ask(budget, 101, budget));
  tcs_budget_when_asked(budget, give_back, &asked);
  assert_true(tcs_budget_ask(budget, 101, budget));
  assert_int_equal(asked, 101);
  assert_false(tcs_budget_ask(budget, 102, NULL));
  tcs_budget_free(budget);
}

TEST(bytes_are_counted_until_nobody_has_them) {
  tcs_budget *budget = tcs_budget_new(100, 60);
  GBytes *bytes = tcs_budget_bytes(budget, TCS_MEMORY_PICTURES, g_malloc(70), 70);
  GBytes *second = g_bytes_ref(bytes);
  assert_int_equal(tcs_budget_left(budget), 30);
  g_bytes_unref(bytes);
  assert_int_equal(tcs_budget_used(budget, TCS_MEMORY_PICTURES), 70);
  g_bytes_unref(second);
  assert_int_equal(tcs_budget_left(budget), 100);
  tcs_budget_free(budget);
}

/* ---- control groups, as folders ---- */

static char *root;

static void put(const char *path, const char *text) {
  char *full = g_build_filename(root, path, NULL), *folder = g_path_get_dirname(full);
  assert_int_equal(g_mkdir_with_parents(folder, 0700), 0);
  assert_true(g_file_set_contents(full, text, -1, NULL));
  g_free(folder);
  g_free(full);
}

static void begin(const char *groups) {
  root = g_dir_make_tmp("tc-groups-XXXXXX", NULL);
  put("proc/meminfo", "MemTotal:       16000000 kB\nMemFree: 1 kB\n");
  put("proc/self/cgroup", groups);
}

static void end(uint64_t wanted) {
  const uint64_t found = tcs_machine_memory(root);
  char *command[] = {"rm", "-r", root, NULL};
  g_spawn_sync(NULL, command, NULL, G_SPAWN_SEARCH_PATH, NULL, NULL, NULL, NULL, NULL, NULL);
  g_clear_pointer(&root, g_free);
  assert_int_equal(found, wanted);
}

TEST(the_machine_alone) {
  begin("0::/\n");
  end(UINT64_C(16000000) * 1024);
}

TEST(the_second_version_with_its_ancestors) {
  begin("0::/a/b\n");
  put("sys/fs/cgroup/a/b/memory.max", "max\n");
  put("sys/fs/cgroup/a/b/memory.high", "900000000\n");
  put("sys/fs/cgroup/a/memory.max", "800000000\n");
  put("sys/fs/cgroup/a/memory.high", "max\n");
  end(800000000);
  begin("0::/a/b\n");
  put("sys/fs/cgroup/a/b/memory.high", "700000000\n");
  put("sys/fs/cgroup/a/memory.max", "800000000\n");
  end(700000000);
}

/* In a container the own group is at the top, whatever /proc calls it. */
TEST(a_group_shown_at_the_top) {
  begin("0::/system.slice/x.scope\n");
  put("sys/fs/cgroup/memory.max", "600000000\n");
  end(600000000);
}

TEST(the_first_version) {
  begin("12:cpu,cpuacct:/x\n4:memory:/docker/y\n1:name=systemd:/z\n0::/z\n");
  put("sys/fs/cgroup/memory/docker/y/memory.limit_in_bytes", "9223372036854771712\n");
  put("sys/fs/cgroup/memory/docker/memory.limit_in_bytes", "500000000\n");
  put("sys/fs/cgroup/cpu/x/memory.limit_in_bytes", "1000\n");
  end(500000000);
}

TEST(nothing_known) {
  root = g_dir_make_tmp("tc-groups-XXXXXX", NULL);
  end(0);
}

TEST(parts_follow_from_the_whole) {
  tcs_config config;
  tcs_config_init(&config);
  config.limits.memory_bytes = 800 * (int64_t)MIB;
  tcs_config_settle(&config);
  assert_int_equal(config.limits.volume_bytes, 600 * MIB);
  assert_int_equal(config.limits.cache_bytes, 100 * MIB);
  tcs_config_clear(&config);
  tcs_config_init(&config);
  config.limits.volume_bytes = 5;
  tcs_config_settle(&config);
  assert_int_equal(config.limits.volume_bytes, 5);
  assert_in_range(config.limits.memory_bytes, 1, tcs_machine_memory("") / 4 * 3);
  tcs_config_clear(&config);
}

TESTS(NULL, NULL)
