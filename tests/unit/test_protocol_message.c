/* WebSocket messages, frame headers and problem documents. */
#include "tests/support/test.h"

#include "protocol/protocol.h"
#include "tests/support/scoped.h"

static bool parse(const char *text, tcp_message *message, GError **error) {
  return tcp_message_parse(text, strlen(text), message, error);
}

TEST(reads_every_type) {
  tcp_message m;
  assert_true(parse("{\"type\":\"patch\",\"seq\":9007199254740992,\"scene\":{\"mode\":\"mip\"}}", &m, NULL));
  assert_int_equal(m.type, TCP_PATCH);
  assert_true(m.seq == 9007199254740992u);
  assert_string_equal(cJSON_GetObjectItem(m.scene, "mode")->valuestring, "mip");
  tcp_message_clear(&m);
  assert_null(m.scene);
  assert_true(parse("{\"frame\":12,\"type\":\"ack\"}", &m, NULL));
  assert_int_equal(m.type, TCP_ACK);
  assert_int_equal(m.frame, 12);
  assert_true(parse("{\"type\":\"pointer\",\"phase\":\"start\"}", &m, NULL));
  assert_true(m.type == TCP_POINTER && m.pointer_down);
  assert_true(parse("{\"type\":\"size\",\"width\":640,\"height\":8192}", &m, NULL));
  assert_true(m.type == TCP_SIZE && m.width == 640 && m.height == 8192);
  assert_false(parse("{\"type\":\"size\",\"width\":0,\"height\":1}", &m, NULL));
  assert_false(parse("{\"type\":\"size\",\"width\":1,\"height\":8193}", &m, NULL));
  assert_true(parse("{\"type\":\"pointer\",\"phase\":\"end\"}", &m, NULL));
  assert_true(m.type == TCP_POINTER && !m.pointer_down);
  assert_true(parse("{\"type\":\"ping\",\"t\":1.5}", &m, NULL));
  assert_true(m.type == TCP_PING && m.t == 1.5);
}

TEST(refuses_messages) {
  static const struct {
    const char *text, *pointer;
  } cases[] = {{"[]", ""},
               {"{}", "/type"},
               {"{\"type\":1}", "/type"},
               {"{\"type\":\"pach\"}", "/type"},
               {"{\"type\":\"patch\",\"seq\":1}", "/scene"},
               {"{\"type\":\"patch\",\"scene\":{}}", "/seq"},
               {"{\"type\":\"patch\",\"seq\":-1,\"scene\":{}}", "/seq"},
               {"{\"type\":\"patch\",\"seq\":1.5,\"scene\":{}}", "/seq"},
               {"{\"type\":\"patch\",\"seq\":1e16,\"scene\":{}}", "/seq"},
               {"{\"type\":\"patch\",\"seq\":1,\"scene\":[]}", "/scene"},
               {"{\"type\":\"ack\"}", "/frame"},
               {"{\"type\":\"ack\",\"frame\":1,\"x/y\":2}", "/x~1y"},
               {"{\"type\":\"pointer\",\"phase\":\"up\"}", "/phase"},
               {"{\"type\":\"pointer\",\"phase\":1}", "/phase"},
               {"{\"type\":\"ping\",\"t\":\"1\"}", "/t"}};
  for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
    tcp_message m;
    g_autoptr(GError) error = NULL;
    if (parse(cases[i].text, &m, &error)) fail_msg("accepted: %s", cases[i].text);
    if (g_strcmp0(tc_error_pointer(error), cases[i].pointer) != 0)
      fail_msg("%s: pointer %s", cases[i].text, tc_error_pointer(error));
    assert_null(m.scene);
  }
}

TEST(keeps_the_seq_of_a_bad_patch) {
  tcp_message m;
  assert_false(parse("{\"type\":\"patch\",\"seq\":41,\"scene\":7}", &m, NULL));
  assert_int_equal(m.seq, 41);
  assert_false(parse("{\"type\":\"patch\",\"seq\":42,\"scene\":{},\"extra\":1}", &m, NULL));
  assert_int_equal(m.seq, 42);
  assert_false(parse("{\"type\":\"patch\",\"seq\":43,", &m, NULL));
  assert_int_equal(m.seq, 0);
}

TEST(frame_header) {
  tcp_frame_header h = {.frame = 7,
                        .seq = 300,
                        .width = 640,
                        .height = 480,
                        .format = "jpeg",
                        .quality = 85,
                        .final = true,
                        .queue_ms = 0.5,
                        .tables_ms = 1,
                        .render_ms = 12.3456789,
                        .encode_ms = 2};
  size_t size;
  uint8_t *bytes = tcp_frame_header_write(&h, &size);
  assert_int_equal(bytes[0] | bytes[1] << 8 | bytes[2] << 16 | bytes[3] << 24, size - 4);
  cJSON *json = tcp_json_parse((char *)bytes + 4, size - 4, NULL);
  const char wanted[] =
      "{\"frame\":7,\"seq\":300,\"width\":640,\"height\":480,\"format\":\"jpeg\",\"quality\":85,"
      "\"final\":true,\"timing\":{\"queueMs\":0.5,\"tablesMs\":1,\"renderMs\":12.346,\"encodeMs\":2}}";
  cJSON *other = tcp_json_parse(wanted, strlen(wanted), NULL);
  assert_true(cJSON_Compare(json, other, true));
  cJSON_Delete(json);
  cJSON_Delete(other);
  g_free(bytes);
  h.has_error = true;
  h.rms = 0.001;
  h.low = 0.0005;
  h.max = 0.01;
  h.pixels = 64;
  bytes = tcp_frame_header_write(&h, &size);
  json = tcp_json_parse((char *)bytes + 4, size - 4, NULL);
  cJSON *error = cJSON_GetObjectItem(json, "error");
  assert_float_equal(cJSON_GetObjectItem(error, "rms")->valuedouble, 0.001, 0);
  assert_float_equal(cJSON_GetObjectItem(error, "low")->valuedouble, 0.0005, 0);
  assert_int_equal(cJSON_GetObjectItem(error, "pixels")->valueint, 64);
  assert_null(cJSON_GetObjectItem(json, "unmeasured"));
  cJSON_Delete(json);
  g_free(bytes);
}

TEST(problems) {
  static const struct {
    tc_error_code code;
    int status;
    const char *type;
  } cases[] = {{TC_ERROR_INVALID, 422, "urn:tomocast:problem:invalid"},
               {TC_ERROR_SYNTAX, 400, "urn:tomocast:problem:syntax"},
               {TC_ERROR_NOT_FOUND, 404, "urn:tomocast:problem:not-found"},
               {TC_ERROR_CONFLICT, 409, "urn:tomocast:problem:conflict"},
               {TC_ERROR_UNSUPPORTED, 501, "urn:tomocast:problem:unsupported"},
               {TC_ERROR_LIMIT, 413, "urn:tomocast:problem:limit"},
               {TC_ERROR_FORMAT, 415, "urn:tomocast:problem:format"},
               {TC_ERROR_IO, 500, "urn:tomocast:problem:io"},
               {TC_ERROR_MEMORY, 507, "urn:tomocast:problem:memory"},
               {TC_ERROR_CANCELLED, 503, "urn:tomocast:problem:cancelled"},
               {TC_ERROR_PAUSED, 503, "urn:tomocast:problem:paused"},
               {TC_ERROR_BUSY, 503, "urn:tomocast:problem:busy"},
               {TC_ERROR_INTERNAL, 500, "urn:tomocast:problem:internal"}};
  assert_int_equal(G_N_ELEMENTS(cases), TC_ERROR_CODE_COUNT);
  for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
    g_autoptr(GError) error = NULL;
    tc_set_error(&error, cases[i].code, i ? NULL : "/camera/up", "camera.up: is %s", "wrong");
    g_autoptr(cJSON) p = tcp_problem(error);
    assert_int_equal(tcp_problem_status(error), cases[i].status);
    assert_int_equal(cJSON_GetObjectItem(p, "status")->valueint, cases[i].status);
    assert_string_equal(cJSON_GetObjectItem(p, "type")->valuestring, cases[i].type);
    assert_string_equal(cJSON_GetObjectItem(p, "detail")->valuestring, "camera.up: is wrong");
    assert_true(strlen(cJSON_GetObjectItem(p, "title")->valuestring) > 0);
    assert_int_equal(cJSON_HasObjectItem(p, "pointer"), i == 0);
  }
}

TEST(foreign_errors_are_internal) {
  GError *error = g_error_new(G_FILE_ERROR, G_FILE_ERROR_NOENT, "no \xff such file");
  g_autoptr(cJSON) p = tcp_problem(error);
  assert_int_equal(tcp_problem_status(error), 500);
  assert_true(g_utf8_validate(cJSON_GetObjectItem(p, "detail")->valuestring, -1, NULL));
  g_error_free(error);
}

TESTS(NULL, NULL)
