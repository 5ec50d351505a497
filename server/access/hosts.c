#include "server/access/hosts.h"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netdb.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>

#define NAME_SIZE 256
#define HTTP_PORT 80
#define HTTPS_PORT 443

typedef struct authority {
  char name[NAME_SIZE]; /* lower case; an IPv6 address with its brackets */
  int port;             /* 0: none given */
} authority;

struct tcs_hosts {
  GArray *names;      /* authority */
  GPtrArray *origins; /* char *, lower case */
};

tcs_hosts *tcs_hosts_new(void) {
  tcs_hosts *hosts = g_new0(tcs_hosts, 1);
  hosts->names = g_array_new(FALSE, FALSE, sizeof(authority));
  hosts->origins = g_ptr_array_new_with_free_func(g_free);
  return hosts;
}

void tcs_hosts_free(tcs_hosts *hosts) {
  if (!hosts) return;
  g_array_unref(hosts->names);
  g_ptr_array_unref(hosts->origins);
  g_free(hosts);
}

/* Length of the name at the start of `text`; 0: there is none. */
static size_t name_length(const char *text) {
  if (*text != '[') return strspn(text, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.-_");
  const size_t inside = strspn(text + 1, "0123456789abcdefABCDEF:.");
  return inside > 1 && text[1 + inside] == ']' ? inside + 2 : 0;
}

static bool split(const char *text, authority *out) {
  const size_t length = name_length(text);
  if (length == 0 || length >= NAME_SIZE) return false;
  for (size_t i = 0; i < length; i++) out->name[i] = g_ascii_tolower(text[i]);
  out->name[length] = 0;
  out->port = 0;
  if (text[length] == 0) return true;
  const char *digits = text + length + 1;
  const size_t count = strspn(digits, "0123456789");
  if (text[length] != ':' || count < 1 || count > 5 || digits[count] || digits[0] == '0') return false;
  out->port = atoi(digits);
  return out->port <= 65535;
}

static void add(tcs_hosts *hosts, const char *name, int port) {
  authority entry = {.port = port};
  g_strlcpy(entry.name, name, sizeof entry.name);
  g_array_append_val(hosts->names, entry);
}

bool tcs_hosts_add(tcs_hosts *hosts, const char *text, GError **error) {
  authority entry;
  if (split(text, &entry)) {
    add(hosts, entry.name, entry.port);
    return true;
  }
  tc_set_error(error, TC_ERROR_INVALID, NULL, "host %s: give NAME or NAME:PORT, as in viewer.example", text);
  return false;
}

/* The text after "http://" or "https://", and the scheme's default port; NULL: another scheme. */
static const char *after_scheme(const char *origin, int *port) {
  static const struct {
    const char *text;
    int port;
  } schemes[] = {{"http://", HTTP_PORT}, {"https://", HTTPS_PORT}};
  for (size_t i = 0; i < G_N_ELEMENTS(schemes); i++) {
    const size_t length = strlen(schemes[i].text);
    if (g_ascii_strncasecmp(origin, schemes[i].text, length) != 0) continue;
    *port = schemes[i].port;
    return origin + length;
  }
  return NULL;
}

static bool split_origin(const char *origin, authority *out, int *unsaid) {
  const char *rest = after_scheme(origin, unsaid);
  return rest && split(rest, out);
}

bool tcs_hosts_add_origin(tcs_hosts *hosts, const char *text, GError **error) {
  authority entry;
  int unsaid;
  if (split_origin(text, &entry, &unsaid)) {
    g_ptr_array_add(hosts->origins, g_ascii_strdown(text, -1));
    return true;
  }
  tc_set_error(error, TC_ERROR_INVALID, NULL, "origin %s: give SCHEME://NAME or SCHEME://NAME:PORT without a path",
               text);
  return false;
}

static bool is_wildcard(const char *name) { return strcmp(name, "0.0.0.0") == 0 || strcmp(name, "[::]") == 0; }
static bool is_loopback(const char *name) { return g_str_has_prefix(name, "127.") || strcmp(name, "[::1]") == 0; }

static void add_localhost(tcs_hosts *hosts, int port) {
  add(hosts, "localhost", port);
  add(hosts, "127.0.0.1", port);
  add(hosts, "[::1]", port);
}

static void add_address(tcs_hosts *hosts, const struct sockaddr *address, int port) {
  char text[INET6_ADDRSTRLEN], name[INET6_ADDRSTRLEN + 2];
  if (address && address->sa_family == AF_INET) {
    inet_ntop(AF_INET, &((const struct sockaddr_in *)(const void *)address)->sin_addr, text, sizeof text);
    add(hosts, text, port);
  } else if (address && address->sa_family == AF_INET6) {
    inet_ntop(AF_INET6, &((const struct sockaddr_in6 *)(const void *)address)->sin6_addr, text, sizeof text);
    g_snprintf(name, sizeof name, "[%s]", text);
    add(hosts, name, port);
  }
}

void tcs_hosts_listen(tcs_hosts *hosts, const char *address) {
  authority own;
  if (!split(address, &own)) return;
  add(hosts, own.name, own.port);
  if (is_loopback(own.name) || is_wildcard(own.name)) add_localhost(hosts, own.port);
  struct ifaddrs *all = NULL;
  if (!is_wildcard(own.name) || getifaddrs(&all) != 0) return;
  for (const struct ifaddrs *one = all; one; one = one->ifa_next) add_address(hosts, one->ifa_addr, own.port);
  freeifaddrs(all);
}

/* A missing port means 80, or 443 if a proxy in front ends TLS. */
static bool fits(const authority *entry, const authority *said) {
  if (strcmp(entry->name, said->name) != 0) return false;
  if (entry->port == 0 || entry->port == said->port) return true;
  return said->port == 0 && (entry->port == HTTP_PORT || entry->port == HTTPS_PORT);
}

bool tcs_host_allowed(const tcs_hosts *hosts, const char *host) {
  authority said;
  if (!host || !split(host, &said)) return false;
  for (guint i = 0; i < hosts->names->len; i++)
    if (fits(&g_array_index(hosts->names, authority, i), &said)) return true;
  return false;
}

bool tcs_origin_allowed(const tcs_hosts *hosts, const char *origin, const char *host) {
  for (guint i = 0; i < hosts->origins->len; i++)
    if (g_ascii_strcasecmp(origin, g_ptr_array_index(hosts->origins, i)) == 0) return true;
  authority from, here;
  int unsaid;
  if (!split_origin(origin, &from, &unsaid)) return false;
  if (from.port == 0) from.port = unsaid;
  if (host && split(host, &here) && strcmp(here.name, from.name) == 0 && from.port == (here.port ? here.port : unsaid))
    return true;
  /* Entries for every port do not count: another server on another port of that host may serve pages. */
  for (guint i = 0; i < hosts->names->len; i++) {
    const authority *entry = &g_array_index(hosts->names, authority, i);
    if (entry->port && entry->port == from.port && strcmp(entry->name, from.name) == 0) return true;
  }
  return false;
}

bool tcs_address_is_loopback(const char *address) {
  const struct addrinfo hints = {.ai_flags = AI_PASSIVE, .ai_socktype = SOCK_STREAM};
  struct addrinfo *found = NULL;
  if (getaddrinfo(address, NULL, &hints, &found) != 0) return true; /* listening fails and says why */
  const struct sockaddr_in *v4 = (const void *)found->ai_addr;
  const struct sockaddr_in6 *v6 = (const void *)found->ai_addr;
  const bool loopback = found->ai_family == AF_INET    ? ntohl(v4->sin_addr.s_addr) >> 24 == 127
                        : found->ai_family == AF_INET6 ? IN6_IS_ADDR_LOOPBACK(&v6->sin6_addr)
                                                       : false;
  freeaddrinfo(found);
  return loopback;
}
