/* Who is asking, and what they may do. */
#ifndef TCS_ACCESS_ROLE_H
#define TCS_ACCESS_ROLE_H

#include <stdbool.h>
#include <stdint.h>

#include "server/access/secret.h"

/* Each role may do what those before it may. */
typedef enum tcs_role {
  TCS_ROLE_NONE,  /* a stranger: the page's files, health */
  TCS_ROLE_VIEW,  /* look */
  TCS_ROLE_EDIT,  /* sessions, scenes, pictures and volumes of one's own */
  TCS_ROLE_ADMIN, /* those of everybody */
  TCS_ROLE_COUNT
} tcs_role;

#define TCS_NAME_SIZE 65
#define TCS_SESSION_SIZE 33

/* Who asks. All zero is a stranger. */
typedef struct tcs_caller {
  char name[TCS_NAME_SIZE]; /* of the token; "" where the server asks for none: all are one and the same */
  tcs_role role;
  char session[TCS_SESSION_SIZE]; /* the only one a share link or a ticket opens; "" = there is no such bound */
  int64_t until_s;                /* wall clock; 0 = for ever */
  uint8_t token[TCS_HASH_SIZE];   /* the hash of the token it came by */
  unsigned generation;            /* of the tokens, where that one was found last; 0 = it came by none */
} tcs_caller;

/* "view", "edit", "admin"; "none" for a stranger. */
const char *tcs_role_name(tcs_role role);
/* False: no such name; "none" is none. */
bool tcs_role_parse(const char *name, tcs_role *role);

/* Whether something of `owner` may be seen and changed by the caller as by its owner. NULL: nobody's but an admin's. */
bool tcs_caller_owns(const tcs_caller *caller, const char *owner);
/* Whether the caller may know of a session. */
bool tcs_caller_sees(const tcs_caller *caller, const char *session, const char *owner);

#endif
