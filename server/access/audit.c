#include "server/access/audit.h"

#include <string.h>

#include "server/observe/log.h"

#define REFUSALS_A_SECOND 10

/* 32 bits tell the volumes of one run apart, but are too few to recover an id by trying names. */
static void name_volume(const tcs_access *access, const char *id, char name[9]) {
  uint8_t mac[TCS_HASH_SIZE];
  tcs_sign(access->salt, sizeof access->salt, id, mac);
  tcs_hex(mac, 4, name);
}

void tcs_audit(tcs_access *access, const tcs_caller *caller, const char *event, const char *session,
               const char *volume) {
  char name[64], place[40] = "", what[24] = "", hash[9];
  if (session) g_snprintf(place, sizeof place, " session=%.8s", session);
  if (volume) {
    name_volume(access, volume, hash);
    g_snprintf(what, sizeof what, " volume=%s", hash);
  }
  g_snprintf(name, sizeof name, "audit.%s", event);
  tcs_log(TCS_LOG_INFO, name, "who=%s role=%s%s%s", caller->name[0] ? caller->name : "-", tcs_role_name(caller->role),
          place, what);
}

void tcs_audit_refused(tcs_access *access, const tcs_caller *caller, const char *why) {
  const int64_t second = g_get_monotonic_time() / 1000000;
  if (second != access->refused_second) {
    if (access->refused > REFUSALS_A_SECOND)
      tcs_log(TCS_LOG_WARN, "audit.refused", "more=%u", access->refused - REFUSALS_A_SECOND);
    access->refused_second = second;
    access->refused = 0;
  }
  if (++access->refused > REFUSALS_A_SECOND) return;
  tcs_log(TCS_LOG_WARN, "audit.refused", "who=%s role=%s why=%s", caller->name[0] ? caller->name : "-",
          tcs_role_name(caller->role), why);
}
