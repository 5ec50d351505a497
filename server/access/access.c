#include "server/access/access.h"

#include "server/config/config.h"

static bool read_hosts(tcs_access *access, const tcs_config *config, GError **error) {
  for (guint i = 0; i < config->hosts->len; i++)
    if (!tcs_hosts_add(access->hosts, g_ptr_array_index(config->hosts, i), error)) return false;
  for (guint i = 0; i < config->origins->len; i++)
    if (!tcs_hosts_add_origin(access->hosts, g_ptr_array_index(config->origins, i), error)) return false;
  return true;
}

tcs_access *tcs_access_new(const tcs_config *config, GError **error) {
  tcs_access *access = g_new0(tcs_access, 1);
  access->hosts = tcs_hosts_new();
  if (read_hosts(access, config, error)) return access;
  tcs_access_free(access);
  return NULL;
}

void tcs_access_free(tcs_access *access) {
  if (!access) return;
  tcs_hosts_free(access->hosts);
  g_free(access);
}
