/* What a caller may do; each role may do what those before it may. */
#ifndef TCS_ACCESS_ROLE_H
#define TCS_ACCESS_ROLE_H

typedef enum tcs_role {
  TCS_ROLE_NONE,  /* a stranger: the page's files, health */
  TCS_ROLE_VIEW,  /* look */
  TCS_ROLE_EDIT,  /* sessions, scenes, pictures and volumes of one's own */
  TCS_ROLE_ADMIN, /* those of everybody */
  TCS_ROLE_COUNT
} tcs_role;

#endif
