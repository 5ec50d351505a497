#include "server/config/config.h"

#include <errno.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "server/memory/machine.h"

#define FIELD(member) #member
#define AT(member) offsetof(tcs_limits, member)
#define MIB (INT64_C(1) << 20)
#define GIB (INT64_C(1) << 30)

static const tcs_limit_field fields[] = {
    {FIELD(image_side), "imageSide", AT(image_side), TC_MAX_IMAGE_SIDE, 1, TC_MAX_IMAGE_SIDE},
    {FIELD(image_area), "imageArea", AT(image_area), TC_MAX_IMAGE_AREA, 1, TC_MAX_IMAGE_AREA},
    {FIELD(rays_per_pixel), "raysPerPixel", AT(rays_per_pixel), TC_MAX_RAYS_PER_PIXEL, 1, TC_MAX_RAYS_PER_PIXEL},
    {FIELD(knots), "knots", AT(knots), TC_MAX_KNOTS, 1, TC_MAX_KNOTS},
    {FIELD(body_bytes), "bodyBytes", AT(body_bytes), MIB, 1024, 64 * MIB},
    {FIELD(upload_bytes), "uploadBytes", AT(upload_bytes), 4 * GIB, 1024, 1024 * GIB},
    {FIELD(memory_bytes), "memoryBytes", AT(memory_bytes), 0, MIB, INT64_MAX},
    {FIELD(volume_bytes), "volumeBytes", AT(volume_bytes), 0, 1, INT64_MAX},
    {FIELD(cache_bytes), "cacheBytes", AT(cache_bytes), 0, MIB, 64 * GIB},
    {FIELD(loads), "loads", AT(loads), 64, 1, 4096},
    {FIELD(loads_per_client), "loadsPerClient", AT(loads_per_client), 16, 1, 4096},
    {FIELD(import_seconds), "importSeconds", AT(import_seconds), 600, 1, 24 * 3600},
    {FIELD(bridged_slices), "bridgedSlices", AT(bridged_slices), 1, 0, 1},
    {FIELD(patient_tags), "patientTags", AT(patient_tags), 0, 0, 1},
    {FIELD(failed_entries), "failedEntries", AT(failed_entries), 256, 1, 65536},
    {FIELD(failed_seconds), "failedSeconds", AT(failed_seconds), 300, 1, 24 * 3600},
    {FIELD(uploads), "uploads", AT(uploads), 32, 1, 4096},
    {FIELD(uploads_per_client), "uploadsPerClient", AT(uploads_per_client), 8, 1, 4096},
    {FIELD(upload_rate), "uploadRate", AT(upload_rate), 16384, 0, GIB},
    {FIELD(upload_grace_seconds), "uploadGraceSeconds", AT(upload_grace_seconds), 10, 1, 3600},
    {FIELD(spool_bytes), "spoolBytes", AT(spool_bytes), 16 * GIB, 1024, 1024 * GIB},
    {FIELD(sessions), "sessions", AT(sessions), 256, 1, 65536},
    {FIELD(clients), "clients", AT(clients), 1024, 1, 65536},
    {FIELD(queue), "queue", AT(queue), 256, 1, 65536},
    {FIELD(render_samples), "renderSamples", AT(render_samples), INT64_C(100000000000), 1000, INT64_C(1) << 53},
    {FIELD(ray_samples), "raySamples", AT(ray_samples), 1 << 18, 16, INT64_C(1) << 53},
    {FIELD(render_seconds), "renderSeconds", AT(render_seconds), 60, 1, 24 * 3600},
    {FIELD(window), "window", AT(window), 2, 1, 16},
    {FIELD(blocked_seconds), "blockedSeconds", AT(blocked_seconds), 10, 1, 3600},
    {FIELD(session_idle_seconds), "sessionIdleSeconds", AT(session_idle_seconds), 3600, 1, 30 * 24 * 3600},
};

const tcs_limit_field *tcs_limit_fields(size_t *count) {
  *count = G_N_ELEMENTS(fields);
  return fields;
}

static int64_t *limit_at(tcs_limits *limits, const tcs_limit_field *field) {
  return (int64_t *)(void *)((char *)limits + field->offset);
}

static void free_named_path(void *item) {
  tcs_named_path *named = item;
  g_free(named->id);
  g_free(named->path);
  g_free(named);
}

/* Three quarters of the memory: the rest is for the system and other programs. */
static int64_t default_memory_bytes(void) {
  const uint64_t machine = tcs_machine_memory("");
  return machine ? (int64_t)MIN(machine / 4 * 3, (uint64_t)INT64_MAX) : 4 * GIB;
}

void tcs_config_settle(tcs_config *config) {
  tcs_limits *limits = &config->limits;
  if (!limits->memory_bytes) limits->memory_bytes = default_memory_bytes();
  if (!limits->volume_bytes) limits->volume_bytes = limits->memory_bytes / 4 * 3;
  if (!limits->cache_bytes) limits->cache_bytes = CLAMP(limits->memory_bytes / 8, MIB, 256 * MIB);
}

void tcs_config_init(tcs_config *config) {
  memset(config, 0, sizeof *config);
  config->listen = (tcs_listen){g_strdup("127.0.0.1"), 8080};
  const char *spool = g_getenv("TMPDIR");
  config->spool = g_strdup(spool && *spool ? spool : "/var/tmp");
  config->volumes = g_ptr_array_new_with_free_func(free_named_path);
  config->hosts = g_ptr_array_new_with_free_func(g_free);
  config->origins = g_ptr_array_new_with_free_func(g_free);
  config->link_roots = g_ptr_array_new_with_free_func(g_free);
  config->proxies = g_ptr_array_new_with_free_func(g_free);
  config->log_level = TCS_LOG_INFO;
  for (size_t i = 0; i < G_N_ELEMENTS(fields); i++) *limit_at(&config->limits, &fields[i]) = fields[i].fallback;
}

void tcs_config_clear(tcs_config *config) {
  g_free(config->listen.address);
  g_free(config->metrics.address);
  g_free(config->data);
  g_free(config->spool);
  g_free(config->log);
  g_free(config->token_file);
  g_free(config->audit_file);
  if (config->volumes) g_ptr_array_unref(config->volumes);
  if (config->hosts) g_ptr_array_unref(config->hosts);
  if (config->origins) g_ptr_array_unref(config->origins);
  if (config->link_roots) g_ptr_array_unref(config->link_roots);
  if (config->proxies) g_ptr_array_unref(config->proxies);
  memset(config, 0, sizeof *config);
}

bool tcs_id_valid(const char *id) {
  const size_t length = strlen(id);
  if (length < 1 || length > 64 || strspn(id, ".") == length) return false;
  for (const char *c = id; *c; c++)
    if (!g_ascii_isalnum(*c) && !strchr("._-", *c)) return false;
  return true;
}

bool tcs_config_listen(tcs_listen *listen, const char *option, const char *text, GError **error) {
  const char *colon = strrchr(text, ':');
  char *end = NULL;
  const long port = colon ? strtol(colon + 1, &end, 10) : -1;
  if (!colon || end == colon + 1 || *end || port < 0 || port > 65535) {
    tc_set_error(error, TC_ERROR_INVALID, NULL, "%s %s: give ADDR:PORT, as in 127.0.0.1:8080", option, text);
    return false;
  }
  g_free(listen->address);
  if (text[0] == '[' && colon > text + 1 && colon[-1] == ']')
    listen->address = g_strndup(text + 1, (size_t)(colon - text) - 2);
  else if (colon == text)
    listen->address = g_strdup("0.0.0.0");
  else
    listen->address = g_strndup(text, (size_t)(colon - text));
  listen->port = (int)port;
  return true;
}

bool tcs_config_volume(tcs_config *config, const char *text, GError **error) {
  const char *equals = strchr(text, '=');
  char *id = g_strndup(text, equals ? (size_t)(equals - text) : 0);
  if (!equals || !tcs_id_valid(id) || !equals[1]) {
    tc_set_error(error, TC_ERROR_INVALID, NULL,
                 "--volume %s: give ID=PATH; an ID is 1 to 64 of letters, digits, '.', '_', '-', not dots alone", text);
    g_free(id);
    return false;
  }
  for (guint i = 0; i < config->volumes->len; i++) {
    const tcs_named_path *other = g_ptr_array_index(config->volumes, i);
    if (strcmp(other->id, id) == 0) {
      tc_set_error(error, TC_ERROR_CONFLICT, NULL, "--volume %s: the id is given twice", text);
      g_free(id);
      return false;
    }
  }
  tcs_named_path *named = g_new0(tcs_named_path, 1);
  named->id = id;
  named->path = g_strdup(equals + 1);
  g_ptr_array_add(config->volumes, named);
  return true;
}

bool tcs_config_data(tcs_config *config, const char *path, GError **error) {
  char *canonical = realpath(path, NULL);
  if (!canonical || !g_file_test(canonical, G_FILE_TEST_IS_DIR)) {
    tc_set_error(error, TC_ERROR_IO, NULL, "--data %s: %s", path, canonical ? "not a folder" : g_strerror(errno));
    free(canonical);
    return false;
  }
  g_free(config->data);
  config->data = g_strdup(canonical);
  free(canonical);
  return true;
}

bool tcs_config_backend(tcs_config *config, const char *text, GError **error) {
  static const char *const names[TC_BACKEND_COUNT] = {"auto", "cpu", "gl"};
  for (int i = 0; i < TC_BACKEND_COUNT; i++) {
    if (strcmp(text, names[i]) == 0) {
      config->backend = (tc_backend)i;
      return true;
    }
  }
  tc_set_error(error, TC_ERROR_INVALID, NULL, "--backend %s: give auto, cpu or gl", text);
  return false;
}

static bool read_limit(tcs_config *config, GKeyFile *file, const char *key, GError **error) {
  for (size_t i = 0; i < G_N_ELEMENTS(fields); i++) {
    if (strcmp(fields[i].name, key) != 0) continue;
    GError *cause = NULL;
    const int64_t value = g_key_file_get_int64(file, "limits", key, &cause);
    if (cause || value < fields[i].least || value > fields[i].most) {
      tc_set_error(error, TC_ERROR_INVALID, NULL, "[limits] %s: give a whole number from %" PRId64 " to %" PRId64, key,
                   fields[i].least, fields[i].most);
      g_clear_error(&cause);
      return false;
    }
    *limit_at(&config->limits, &fields[i]) = value;
    return true;
  }
  tc_set_error(error, TC_ERROR_INVALID, NULL, "[limits] %s: no such limit", key);
  return false;
}

static bool read_number(const char *key, const char *value, int64_t most, int64_t *out, GError **error) {
  char *end = NULL;
  const long long number = strtoll(value, &end, 10);
  if (end == value || *end || number < 0 || number > most) {
    tc_set_error(error, TC_ERROR_INVALID, NULL, "[server] %s: give a whole number from 0 to %" PRId64, key, most);
    return false;
  }
  *out = number;
  return true;
}

static void read_list(const char *value, GPtrArray *list) {
  char **items = g_strsplit_set(value, "; ,", -1);
  for (char **item = items; *item; item++)
    if (**item) g_ptr_array_add(list, g_strdup(*item));
  g_strfreev(items);
}

static bool read_server(tcs_config *config, GKeyFile *file, const char *key, GError **error) {
  char *value = g_key_file_get_string(file, "server", key, error);
  if (!value) return false;
  bool ok = true;
  int64_t number = 0;
  if (strcmp(key, "listen") == 0)
    ok = tcs_config_listen(&config->listen, "[server] listen", value, error);
  else if (strcmp(key, "metrics_listen") == 0)
    ok = tcs_config_listen(&config->metrics, "[server] metrics_listen", value, error);
  else if (strcmp(key, "data") == 0)
    ok = tcs_config_data(config, value, error);
  else if (strcmp(key, "backend") == 0)
    ok = tcs_config_backend(config, value, error);
  else if (strcmp(key, "drain_seconds") == 0)
    ok = read_number(key, value, 3600, &config->drain_seconds, error);
  else if (strcmp(key, "threads") == 0) {
    ok = read_number(key, value, 1024, &number, error);
    config->threads = (int)number;
  } else if (strcmp(key, "spool") == 0) {
    g_free(config->spool);
    config->spool = g_strdup(value);
  } else if (strcmp(key, "log") == 0) {
    g_free(config->log);
    config->log = g_strdup(value);
  } else if (strcmp(key, "hosts") == 0) {
    read_list(value, config->hosts);
  } else if (strcmp(key, "link_roots") == 0) {
    read_list(value, config->link_roots);
  } else if (strcmp(key, "trusted_proxies") == 0) {
    read_list(value, config->proxies);
  } else if (strcmp(key, "audit_file") == 0) {
    g_free(config->audit_file);
    config->audit_file = g_strdup(value);
  } else if (strcmp(key, "token_file") == 0) {
    g_free(config->token_file);
    config->token_file = g_strdup(value);
  } else if (strcmp(key, "origins") == 0) {
    read_list(value, config->origins);
  } else if (strcmp(key, "log_level") == 0) {
    ok = tcs_log_level_parse(value, &config->log_level);
    if (!ok) tc_set_error(error, TC_ERROR_INVALID, NULL, "[server] log_level: give debug, info, warn or error");
  } else {
    tc_set_error(error, TC_ERROR_INVALID, NULL, "[server] %s: no such key", key);
    ok = false;
  }
  g_free(value);
  return ok;
}

bool tcs_config_read(tcs_config *config, const char *path, GError **error) {
  GKeyFile *file = g_key_file_new();
  bool ok = g_key_file_load_from_file(file, path, G_KEY_FILE_NONE, error);
  char **groups = ok ? g_key_file_get_groups(file, NULL) : NULL;
  for (char **group = groups; ok && *group; group++) {
    const bool limits = strcmp(*group, "limits") == 0;
    if (!limits && strcmp(*group, "server") != 0) {
      tc_set_error(error, TC_ERROR_INVALID, NULL, "[%s]: no such group; there are [server] and [limits]", *group);
      ok = false;
      break;
    }
    char **keys = g_key_file_get_keys(file, *group, NULL, NULL);
    for (char **key = keys; ok && key && *key; key++)
      ok = limits ? read_limit(config, file, *key, error) : read_server(config, file, *key, error);
    g_strfreev(keys);
  }
  g_strfreev(groups);
  g_key_file_free(file);
  if (!ok) g_prefix_error(error, "read %s: ", path);
  return ok;
}
