/* What strangers show and operators write: token files, links, tickets. Nothing but what this server signed or handed
 * out opens anything, and no error tells a token. The first byte chooses. */
#include <glib.h>
#include <string.h>

#include "server/access/share.h"
#include "server/access/tickets.h"
#include "server/access/tokens.h"

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

static const char session[] = "00112233445566778899aabbccddeeff";

/* What is read is read again to the same; a line's fault names no token of 16 characters and more. */
static void token_file(const char *text) {
  bool clear, again;
  GError *error = NULL;
  tcs_tokens *tokens = tcs_tokens_parse(text, &clear, &error);
  if ((tokens == NULL) != (error != NULL)) __builtin_trap();
  char **words = g_strsplit_set(text, " \t\r\n", -1);
  for (char **word = words; *word; word++) {
    if (error && strlen(*word) >= TCS_TOKEN_LEAST && strstr(error->message, *word)) __builtin_trap();
  }
  g_strfreev(words);
  tcs_tokens *twice = tokens ? tcs_tokens_parse(text, &again, NULL) : NULL;
  if (tokens && (!twice || again != clear || tcs_tokens_count(tokens) != tcs_tokens_count(twice))) __builtin_trap();
  g_clear_error(&error);
  tcs_tokens_free(tokens);
  tcs_tokens_free(twice);
}

static void link_token(const char *text) {
  const uint8_t key[TCS_SHARE_KEY_SIZE] = {1, 2, 3};
  char ours[TCS_SHARE_SIZE];
  tcs_caller caller = {0};
  tcs_share_sign(key, session, TCS_ROLE_VIEW, 1000, ours);
  if (tcs_share_check(key, text, 0, &caller) && g_ascii_strcasecmp(text, ours) != 0) __builtin_trap();
  if (!tcs_share_check(key, ours, 0, &caller) || tcs_share_check(key, ours, 1000, &caller)) __builtin_trap();
}

static void ticket(const char *text) {
  tcs_tickets *tickets = tcs_tickets_new();
  const tcs_caller anna = {.name = "anna", .role = TCS_ROLE_VIEW};
  tcs_caller caller = {0};
  char ours[TCS_TICKET_SIZE];
  if (!tcs_tickets_issue(tickets, &anna, 0, ours)) __builtin_trap();
  if (tcs_tickets_take(tickets, text, 1, &caller) || !tcs_tickets_take(tickets, ours, 1, &caller)) __builtin_trap();
  tcs_tickets_free(tickets);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
  static void (*const targets[])(const char *) = {token_file, link_token, ticket};
  if (size < 1 || size > 65536) return 0;
  char *text = g_strndup((const char *)bytes + 1, size - 1);
  targets[bytes[0] % G_N_ELEMENTS(targets)](text);
  g_free(text);
  return 0;
}
