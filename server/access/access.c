#include "server/access/access.h"

#include <string.h>

#include "server/config/config.h"

static bool read_hosts(tcs_access *access, const tcs_config *config, GError **error) {
  for (guint i = 0; i < config->hosts->len; i++)
    if (!tcs_hosts_add(access->hosts, g_ptr_array_index(config->hosts, i), error)) return false;
  for (guint i = 0; i < config->origins->len; i++)
    if (!tcs_hosts_add_origin(access->hosts, g_ptr_array_index(config->origins, i), error)) return false;
  return true;
}

/* Nobody is let in from outside by oversight. */
static bool read_tokens(tcs_access *access, const tcs_config *config, GError **error) {
  if (config->token_file && config->insecure_no_auth) {
    tc_set_error(error, TC_ERROR_INVALID, NULL, "--token-file and --insecure-no-auth: give one of them");
    return false;
  }
  if (config->token_file) return (access->tokens = tcs_tokens_read(config->token_file, error)) != NULL;
  if (config->insecure_no_auth || tcs_address_is_loopback(config->address)) return true;
  tc_set_error(error, TC_ERROR_INVALID, NULL,
               "--listen %s: others on the network can reach it; give --token-file FILE (lines of NAME ROLE TOKEN), "
               "or --insecure-no-auth to let everybody in",
               config->address);
  return false;
}

static bool make_secrets(tcs_access *access, GError **error) {
  if (tcs_random(access->share_key, sizeof access->share_key) && tcs_random(access->salt, sizeof access->salt))
    return true;
  tc_set_error(error, TC_ERROR_IO, NULL, "no random numbers to be had");
  return false;
}

tcs_access *tcs_access_new(const tcs_config *config, GError **error) {
  tcs_access *access = g_new0(tcs_access, 1);
  access->hosts = tcs_hosts_new();
  access->tickets = tcs_tickets_new();
  if (read_hosts(access, config, error) && read_tokens(access, config, error) && make_secrets(access, error))
    return access;
  tcs_access_free(access);
  return NULL;
}

void tcs_access_free(tcs_access *access) {
  if (!access) return;
  tcs_hosts_free(access->hosts);
  tcs_tokens_free(access->tokens);
  tcs_tickets_free(access->tickets);
  g_free(access);
}

/* What follows "Bearer "; NULL: it is another scheme. */
static const char *bearer_of(const char *authorization) {
  if (!authorization || g_ascii_strncasecmp(authorization, "Bearer ", 7) != 0) return NULL;
  return authorization + 7 + strspn(authorization + 7, " ");
}

static bool identify_bearer(tcs_access *access, const char *bearer, tcs_caller *caller) {
  const tcs_token *token = access->tokens ? tcs_tokens_find(access->tokens, bearer, NULL) : NULL;
  if (!token) return tcs_share_check(access->share_key, bearer, g_get_real_time() / 1000000, caller);
  *caller = (tcs_caller){.role = token->role};
  g_strlcpy(caller->name, token->name, sizeof caller->name);
  return true;
}

bool tcs_access_identify(tcs_access *access, const char *authorization, const char *ticket, tcs_caller *caller) {
  *caller = (tcs_caller){.role = access->tokens ? TCS_ROLE_NONE : TCS_ROLE_ADMIN};
  const char *bearer = bearer_of(authorization);
  if (ticket && tcs_tickets_take(access->tickets, ticket, g_get_monotonic_time(), caller)) return true;
  if (!ticket && bearer && identify_bearer(access, bearer, caller)) return true;
  /* Without tokens of ours a header may be meant for a proxy in front. */
  return !access->tokens || (!ticket && !authorization);
}
