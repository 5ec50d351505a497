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

static bool read_proxies(tcs_access *access, const tcs_config *config, GError **error) {
  for (guint i = 0; i < config->proxies->len; i++)
    if (!tcs_proxies_add(access->proxies, g_ptr_array_index(config->proxies, i), error)) return false;
  return true;
}

/* A server that others can reach needs tokens, or an explicit --insecure-no-auth. */
static bool read_tokens(tcs_access *access, const tcs_config *config, GError **error) {
  if (config->token_file && config->insecure_no_auth) {
    tc_set_error(error, TC_ERROR_INVALID, NULL, "--token-file and --insecure-no-auth: give one of them");
    return false;
  }
  if (config->token_file) return (access->tokens = tcs_tokens_read(config->token_file, error)) != NULL;
  if (config->insecure_no_auth || tcs_address_is_loopback(config->listen.address)) return true;
  tc_set_error(error, TC_ERROR_INVALID, NULL,
               "--listen %s: others on the network can reach it; give --token-file FILE (lines of NAME ROLE TOKEN), "
               "or --insecure-no-auth to let everybody in",
               config->listen.address);
  return false;
}

static bool make_secrets(tcs_access *access, GError **error) {
  if (tcs_random(access->share_key, sizeof access->share_key) && tcs_random(access->salt, sizeof access->salt))
    return true;
  tc_set_error(error, TC_ERROR_IO, NULL, "the system provides no random numbers");
  return false;
}

tcs_access *tcs_access_new(const tcs_config *config, GError **error) {
  tcs_access *access = g_new0(tcs_access, 1);
  access->hosts = tcs_hosts_new();
  access->proxies = tcs_proxies_new();
  access->tickets = tcs_tickets_new();
  access->lockout = tcs_lockout_new();
  access->generation = 1;
  if (read_hosts(access, config, error) && read_proxies(access, config, error) && read_tokens(access, config, error) &&
      make_secrets(access, error))
    return access;
  tcs_access_free(access);
  return NULL;
}

void tcs_access_free(tcs_access *access) {
  if (!access) return;
  tcs_hosts_free(access->hosts);
  tcs_proxies_free(access->proxies);
  tcs_tokens_free(access->tokens);
  tcs_tickets_free(access->tickets);
  tcs_lockout_free(access->lockout);
  g_free(access);
}

/* The token of an "Authorization: Bearer" header; NULL: another scheme. */
static const char *bearer_of(const char *authorization) {
  if (!authorization || g_ascii_strncasecmp(authorization, "Bearer ", 7) != 0) return NULL;
  return authorization + 7 + strspn(authorization + 7, " ");
}

static uint64_t key_of(const tcs_access *access, const char *peer, const char *bearer) {
  uint8_t mac[TCS_HASH_SIZE];
  uint64_t key;
  char *text = g_strconcat(peer, "\n", bearer, NULL);
  tcs_sign(access->salt, sizeof access->salt, text, mac);
  memcpy(&key, mac, sizeof key);
  g_free(text);
  return key;
}

/* The lockout covers tokens only: links and tickets are too long to guess. */
static bool identify_bearer(tcs_access *access, const char *peer, const char *bearer, tcs_caller *caller, int *wait_s) {
  if (tcs_share_check(access->share_key, bearer, g_get_real_time() / 1000000, caller)) return true;
  if (!access->tokens) return false;
  const uint64_t peer_key = key_of(access, peer, NULL), token_key = key_of(access, peer, bearer);
  const int64_t now_us = g_get_monotonic_time();
  *wait_s = tcs_lockout_wait(access->lockout, peer_key, token_key, now_us);
  if (*wait_s) return false;
  const tcs_token *token = tcs_tokens_find(access->tokens, bearer, NULL);
  if (!token) {
    tcs_lockout_fail(access->lockout, peer_key, token_key, now_us);
    return false;
  }
  tcs_lockout_pass(access->lockout, token_key);
  *caller = (tcs_caller){.role = token->role, .generation = access->generation};
  g_strlcpy(caller->name, token->name, sizeof caller->name);
  memcpy(caller->token, token->hash, sizeof caller->token);
  return true;
}

static bool identify_ticket(tcs_access *access, const char *ticket, tcs_caller *caller) {
  return tcs_tickets_take(access->tickets, ticket, g_get_monotonic_time(), caller) && tcs_access_lasts(access, caller);
}

bool tcs_access_identify(tcs_access *access, const tcs_shown *shown, tcs_caller *caller, int *wait_s) {
  const tcs_caller anybody = {.role = access->tokens ? TCS_ROLE_NONE : TCS_ROLE_ADMIN};
  const char *bearer = bearer_of(shown->authorization);
  *wait_s = 0;
  if (shown->ticket && identify_ticket(access, shown->ticket, caller)) return true;
  if (!shown->ticket && bearer && identify_bearer(access, shown->peer, bearer, caller, wait_s)) return true;
  *caller = anybody;
  /* On a server without tokens the header may be meant for a proxy in front. */
  return !access->tokens || (!shown->ticket && !shown->authorization);
}

void tcs_access_renew(tcs_access *access, tcs_tokens *tokens) {
  tcs_tokens_free(access->tokens);
  access->tokens = tokens;
  access->generation++;
}

bool tcs_access_lasts(const tcs_access *access, tcs_caller *caller) {
  if (caller->until_s && g_get_real_time() / 1000000 >= caller->until_s) return false;
  if (!caller->generation || caller->generation == access->generation) return true;
  if (!tcs_tokens_have(access->tokens, caller)) return false;
  caller->generation = access->generation;
  return true;
}
