#include "server/access/proxies.h"

#include <arpa/inet.h>
#include <stdlib.h>
#include <string.h>

/* IPv4 addresses are stored as ::ffff:a.b.c.d (IPv4-mapped), as a dual-stack socket reports them. */
typedef struct network {
  struct in6_addr address;
  int bits;
} network;

struct tcs_proxies {
  GArray *networks; /* network */
};

tcs_proxies *tcs_proxies_new(void) {
  tcs_proxies *proxies = g_new0(tcs_proxies, 1);
  proxies->networks = g_array_new(FALSE, FALSE, sizeof(network));
  return proxies;
}

void tcs_proxies_free(tcs_proxies *proxies) {
  if (!proxies) return;
  g_array_unref(proxies->networks);
  g_free(proxies);
}

/* ---- addresses ---- */

static void map(struct in6_addr *address, const void *v4) {
  memset(address, 0, sizeof *address);
  memset(address->s6_addr + 10, 0xff, 2);
  memcpy(address->s6_addr + 12, v4, 4);
}

static bool parse(const char *text, struct in6_addr *address) {
  struct in_addr v4;
  if (inet_pton(AF_INET, text, &v4) != 1) return inet_pton(AF_INET6, text, address) == 1;
  map(address, &v4);
  return true;
}

static bool address_of(const struct sockaddr *from, struct in6_addr *address) {
  struct sockaddr_in v4;
  struct sockaddr_in6 v6;
  if (from && from->sa_family == AF_INET) {
    memcpy(&v4, from, sizeof v4);
    map(address, &v4.sin_addr);
    return true;
  }
  if (!from || from->sa_family != AF_INET6) return false;
  memcpy(&v6, from, sizeof v6);
  *address = v6.sin6_addr;
  return true;
}

static void write_peer(const struct in6_addr *address, char peer[INET6_ADDRSTRLEN]) {
  struct in6_addr prefix = *address;
  memset(prefix.s6_addr + 8, 0, 8);
  if (IN6_IS_ADDR_V4MAPPED(address))
    inet_ntop(AF_INET, address->s6_addr + 12, peer, INET6_ADDRSTRLEN);
  else
    inet_ntop(AF_INET6, &prefix, peer, INET6_ADDRSTRLEN);
}

static bool contains(const network *n, const struct in6_addr *address) {
  const int bytes = n->bits / 8, rest = n->bits % 8;
  if (memcmp(n->address.s6_addr, address->s6_addr, (size_t)bytes) != 0) return false;
  return !rest || (n->address.s6_addr[bytes] ^ address->s6_addr[bytes]) >> (8 - rest) == 0;
}

static bool trusted(const tcs_proxies *proxies, const struct in6_addr *address) {
  for (guint i = 0; i < proxies->networks->len; i++)
    if (contains(&g_array_index(proxies->networks, network, i), address)) return true;
  return false;
}

bool tcs_proxies_trust(const tcs_proxies *proxies, const struct sockaddr *from) {
  struct in6_addr address;
  return address_of(from, &address) && trusted(proxies, &address);
}

bool tcs_proxies_add(tcs_proxies *proxies, const char *text, GError **error) {
  char **parts = g_strsplit(text, "/", 2);
  network n = {.bits = 128};
  guint64 bits = 0;
  bool good = parts[0] && parse(parts[0], &n.address);
  const int least = good && IN6_IS_ADDR_V4MAPPED(&n.address) && !strchr(parts[0], ':') ? 96 : 0;
  if (good && parts[1]) {
    good = g_ascii_string_to_unsigned(parts[1], 10, 0, (guint64)(128 - least), &bits, NULL);
    n.bits = least + (int)bits;
  }
  if (good)
    g_array_append_val(proxies->networks, n);
  else
    tc_set_error(error, TC_ERROR_INVALID, NULL, "trusted proxy %s: give ADDR or ADDR/BITS, as in 10.0.0.0/8", text);
  g_strfreev(parts);
  return good;
}

/* ---- headers ---- */

/* Parses a node as proxies write it: an address with or without a port, IPv6 with or without brackets. */
static bool parse_node(const char *text, struct in6_addr *address) {
  char inside[INET6_ADDRSTRLEN];
  if (parse(text, address)) return true;
  const bool bracket = *text == '[';
  const char *start = text + bracket, *end = strchr(start, bracket ? ']' : ':');
  if (!end || (size_t)(end - start) >= sizeof inside) return false;
  const char *port = end + bracket;
  if (*port && (*port != ':' || strspn(port + 1, "0123456789") != strlen(port + 1))) return false;
  g_strlcpy(inside, start, (gsize)(end - start) + 1);
  return bracket ? inet_pton(AF_INET6, inside, address) == 1 : parse(inside, address);
}

/* The "for" node of one Forwarded element, unquoted in place; "": no node. Addresses contain no comma or semicolon, so
 * that removing the quotes is enough. */
static const char *node_of_pairs(char *element) {
  for (char *pair = element, *next; pair; pair = next) {
    next = strchr(pair, ';');
    if (next) *next++ = 0;
    pair = g_strstrip(pair);
    if (g_ascii_strncasecmp(pair, "for=", 4) != 0) continue;
    char *node = pair + 4;
    const size_t length = strlen(node);
    if (length < 2 || node[0] != '"' || node[length - 1] != '"') return node;
    node[length - 1] = 0;
    return node + 1;
  }
  return "";
}

/* Follows the header from its right end for as long as each address is a trusted proxy's. */
static struct in6_addr follow(const tcs_proxies *proxies, struct in6_addr address, const char *header, bool pairs) {
  char **elements = g_strsplit(header, ",", -1);
  for (guint i = g_strv_length(elements); i-- > 0 && trusted(proxies, &address);) {
    char *element = g_strstrip(elements[i]);
    struct in6_addr next;
    if (!parse_node(pairs ? node_of_pairs(element) : element, &next)) break;
    address = next;
  }
  g_strfreev(elements);
  return address;
}

void tcs_proxies_peer(const tcs_proxies *proxies, const struct sockaddr *from, const char *forwarded,
                      const char *x_forwarded_for, char peer[INET6_ADDRSTRLEN]) {
  struct in6_addr own, one, other;
  *peer = 0;
  if (!address_of(from, &own)) return;
  one = forwarded ? follow(proxies, own, forwarded, true) : own;
  other = x_forwarded_for ? follow(proxies, own, x_forwarded_for, false) : own;
  if (!forwarded) one = other;
  if (!x_forwarded_for) other = one;
  write_peer(IN6_ARE_ADDR_EQUAL(&one, &other) ? &one : &own, peer);
}
