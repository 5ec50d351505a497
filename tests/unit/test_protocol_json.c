/* Strictness of JSON and RFC 7396. */
#include "tests/support/test.h"

#include "protocol/protocol.h"
#include "tests/support/scoped.h"

static cJSON *parse(const char *text) { return tcp_json_parse(text, strlen(text), NULL); }

TEST(accepts_json) {
  /* clang-format off: packed */
  static const char *const good[] = {
      "0", "-0", "-1.5e-3", "1E+2", "1e-400", "\"\"", "\"\\u00e9\\n\\\"\"", "\"\\ud83d\\ude00\"", "null", " [ ] ", "{}",
      "[1,[2,[3]]]", "{\"a\":{\"a\":1},\"b\":[{\"a\":1},{\"a\":2}]}", "\t\r\n true \n", "{\"\":1}",
      "123456789012345678901234567890123456789012345678901234567890123",
  };
  /* clang-format on */
  for (size_t i = 0; i < G_N_ELEMENTS(good); i++) {
    g_autoptr(cJSON) value = parse(good[i]);
    if (!value) fail_msg("refused: %s", good[i]);
  }
}

TEST(refuses_what_is_not_json) {
  /* clang-format off: packed */
  static const char *const bad[] = {
      "", " ", "nul", "NaN", "Infinity", "-", "01", "1.", ".5", "1e", "+1", "0x10", "1e999", "-1e400", "[1,]", "[,1]",
      "{\"a\":1,}", "{a:1}", "{\"a\" 1}", "{\"a\":1 \"b\":2}", "[1 2]", "\"a", "\"\t\"", "\"\\x\"", "\"\\u12\"",
      "\"\\u0000\"", "\"\\ud800\"", "\"\\ud800x\"", "\"\\ud800\\u0041\"", "\"\\udc00\"", "1 2", "{} x", "// c\n1",
      "'a'", "\xef\xbb\xbf{}", "\"\xff\"", "\"\xc3\"", "\"\xed\xa0\x80\"", "{\"a\":1,\"a\":2}",
      "{\"a\":1,\"\\u0061\":2}", "{\"x\":{\"b\":1,\"c\":2,\"b\":3}}", "[", "{", "{\"a\":", "{\"a\"", "[[1}", "tru",
      "truE", "1234567890123456789012345678901234567890123456789012345678901234",
  };
  /* clang-format on */
  for (size_t i = 0; i < G_N_ELEMENTS(bad); i++) {
    g_autoptr(GError) error = NULL;
    cJSON *value = tcp_json_parse(bad[i], strlen(bad[i]), &error);
    if (value) fail_msg("accepted: %s", bad[i]);
    assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_SYNTAX));
    assert_non_null(strstr(error->message, "JSON line "));
  }
}

TEST(says_line_and_column) {
  static const struct {
    const char *text, *place;
  } cases[] = {{"{\n  \"a\": 1,\n  \"a\": 2\n}", "line 3 column 3"},
               {"[1,\n2,\n x]", "line 3 column 2"},
               {"1e999", "line 1 column 1"},
               {"[1] 2", "line 1 column 5"},
               {"", "line 1 column 1"}};
  for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
    g_autoptr(GError) error = NULL;
    assert_null(tcp_json_parse(cases[i].text, strlen(cases[i].text), &error));
    if (!strstr(error->message, cases[i].place)) fail_msg("%s: expected %s", error->message, cases[i].place);
  }
}

TEST(zero_byte_is_refused) {
  assert_null(tcp_json_parse("1\0002", 3, NULL));
  assert_null(tcp_json_parse("\"a\0b\"", 5, NULL));
  assert_null(tcp_json_parse("1\0", 2, NULL));
}

static char *nested(int depth) {
  GString *text = g_string_new(NULL);
  for (int i = 0; i < depth; i++)
    g_string_append(text, i % 2 ? "{\"a\":" : "[");
  g_string_append_c(text, '1');
  for (int i = depth - 1; i >= 0; i--)
    g_string_append_c(text, i % 2 ? '}' : ']');
  return g_string_free(text, FALSE);
}

TEST(depth_is_at_most_32) {
  char *good = nested(32), *bad = nested(33), *absurd = g_strnfill(1000000, '[');
  g_autoptr(cJSON) value = parse(good);
  assert_non_null(value);
  assert_null(parse(bad));
  assert_null(parse(absurd));
  g_free(good);
  g_free(bad);
  g_free(absurd);
}

/* Many names go through the hash table: every one distinct, then one again. */
TEST(many_names) {
  GString *text = g_string_new("{");
  for (int i = 0; i < 20000; i++)
    g_string_append_printf(text, "%s\"n%d\":%d", i ? "," : "", i, i);
  cJSON *value;
  g_string_append(text, "}");
  value = tcp_json_parse(text->str, text->len, NULL);
  assert_non_null(value);
  cJSON_Delete(value);
  g_string_truncate(text, text->len - 1);
  g_string_append(text, ",\"n\\u0037\":0}");
  assert_null(tcp_json_parse(text->str, text->len, NULL));
  g_string_free(text, TRUE);
}

TEST(every_truncation_is_refused) {
  static const char text[] = "{\"a\":[1,-2.5e3,true,null,\"x\\u00e9\\ud83d\\ude00\"],\"b\":{}}";
  for (size_t size = 0; size < sizeof text - 1; size++) {
    char *copy = g_memdup2(text, size); /* its own allocation: an over-read is seen by the sanitiser */
    cJSON *value = tcp_json_parse(copy ? copy : "", size, NULL);
    if (value) fail_msg("accepted the first %zu bytes", size);
    g_free(copy);
  }
}

/* The examples of RFC 7396, appendix A. */
TEST(merge_patch_examples) {
  static const char *const cases[][3] = {
      {"{\"a\":\"b\"}", "{\"a\":\"c\"}", "{\"a\":\"c\"}"},
      {"{\"a\":\"b\"}", "{\"b\":\"c\"}", "{\"a\":\"b\",\"b\":\"c\"}"},
      {"{\"a\":\"b\"}", "{\"a\":null}", "{}"},
      {"{\"a\":\"b\",\"b\":\"c\"}", "{\"a\":null}", "{\"b\":\"c\"}"},
      {"{\"a\":[\"b\"]}", "{\"a\":\"c\"}", "{\"a\":\"c\"}"},
      {"{\"a\":\"c\"}", "{\"a\":[\"b\"]}", "{\"a\":[\"b\"]}"},
      {"{\"a\":{\"b\":\"c\"}}", "{\"a\":{\"b\":\"d\",\"c\":null}}", "{\"a\":{\"b\":\"d\"}}"},
      {"{\"a\":[{\"b\":\"c\"}]}", "{\"a\":[1]}", "{\"a\":[1]}"},
      {"[\"a\",\"b\"]", "[\"c\",\"d\"]", "[\"c\",\"d\"]"},
      {"{\"a\":\"b\"}", "[\"c\"]", "[\"c\"]"},
      {"{\"a\":\"foo\"}", "null", "null"},
      {"{\"a\":\"foo\"}", "\"bar\"", "\"bar\""},
      {"{\"e\":null}", "{\"a\":1}", "{\"e\":null,\"a\":1}"},
      {"[1,2]", "{\"a\":\"b\",\"c\":null}", "{\"a\":\"b\"}"},
      {"{}", "{\"a\":{\"bb\":{\"ccc\":null}}}", "{\"a\":{\"bb\":{}}}"}};
  for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
    cJSON *target = parse(cases[i][0]), *patch = parse(cases[i][1]), *wanted = parse(cases[i][2]);
    tcp_merge_patch(&target, patch);
    if (!cJSON_Compare(target, wanted, true)) fail_msg("%s + %s", cases[i][0], cases[i][1]);
    cJSON_Delete(target);
    cJSON_Delete(patch);
    cJSON_Delete(wanted);
  }
}

TESTS(NULL, NULL)
