#include "server/access/role.h"

#include <stddef.h>
#include <string.h>

static const char *const names[TCS_ROLE_COUNT] = {"none", "view", "edit", "admin"};

const char *tcs_role_name(tcs_role role) { return names[role]; }

bool tcs_role_parse(const char *name, tcs_role *role) {
  for (int i = TCS_ROLE_VIEW; i < TCS_ROLE_COUNT; i++) {
    if (strcmp(name, names[i]) != 0) continue;
    *role = (tcs_role)i;
    return true;
  }
  return false;
}

bool tcs_caller_owns(const tcs_caller *caller, const char *owner) {
  if (caller->session[0] || caller->role == TCS_ROLE_NONE) return false;
  return caller->role == TCS_ROLE_ADMIN || (owner && strcmp(caller->name, owner) == 0);
}

bool tcs_caller_sees(const tcs_caller *caller, const char *session, const char *owner) {
  if (caller->session[0]) return strcmp(caller->session, session) == 0;
  return tcs_caller_owns(caller, owner);
}
