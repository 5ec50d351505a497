/* Callers and their roles. */
#ifndef TCS_ACCESS_ROLE_H
#define TCS_ACCESS_ROLE_H

#include <stdbool.h>
#include <stdint.h>

#include "server/access/secret.h"

/* Each role includes the rights of the roles before it. */
typedef enum tcs_role {
  TCS_ROLE_NONE,  /* stranger: the page's files, health */
  TCS_ROLE_VIEW,  /* read */
  TCS_ROLE_EDIT,  /* change one's own sessions, scenes, pictures and volumes */
  TCS_ROLE_ADMIN, /* and those of every owner */
  TCS_ROLE_COUNT
} tcs_role;

#define TCS_NAME_SIZE 65
#define TCS_SESSION_SIZE 33

/* An identified caller. All zero is a stranger. */
typedef struct tcs_caller {
  char name[TCS_NAME_SIZE]; /* of the token; "" on a server without tokens, where all callers are one owner */
  tcs_role role;
  char session[TCS_SESSION_SIZE]; /* the only session that a share link or a ticket opens; "" = every session */
  int64_t until_s;                /* wall clock; 0 = for ever */
  uint8_t token[TCS_HASH_SIZE];   /* hash of the caller's token */
  unsigned generation;            /* token file that last had the caller's token; 0 = the caller has no token */
} tcs_caller;

/* "view", "edit", "admin"; "none" for a stranger. Static. */
const char *tcs_role_name(tcs_role role);
/* False: unknown name; "none" is not accepted. */
bool tcs_role_parse(const char *name, tcs_role *role);

/* Whether the caller may see and change an object of `owner` as its owner may. owner NULL: only an admin may. */
bool tcs_caller_owns(const tcs_caller *caller, const char *owner);
/* Whether the caller may see that a session exists. */
bool tcs_caller_sees(const tcs_caller *caller, const char *session, const char *owner);

#endif
