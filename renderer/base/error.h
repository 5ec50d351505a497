/* Errors of the whole product: a GError of one domain, whose message grows a prefix in each caller.
 *
 * Every call that can fail takes a GError ** as its last argument (GLib's conventions: NULL ignores,
 * the callee sets it once). The message is one line: what is wrong, where, and how to fix it. Callers add
 * a clause in front with g_prefix_error(), so a full message reads like
 *   "open study.nrrd: header line 7: sizes: 3 values expected, got 2".
 * Messages never hold patient data or server-side absolute paths beyond what the caller passed in. */
#ifndef TC_RENDERER_ERROR_H
#define TC_RENDERER_ERROR_H

#include <glib.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum tc_error_code {
  TC_ERROR_INVALID,      /* a value out of its range or not meaningful (HTTP 422) */
  TC_ERROR_SYNTAX,       /* bytes that cannot be parsed at all (HTTP 400) */
  TC_ERROR_NOT_FOUND,    /* a named thing does not exist (HTTP 404) */
  TC_ERROR_CONFLICT,     /* the thing is in use, or another version (HTTP 409/412) */
  TC_ERROR_UNSUPPORTED,  /* understood, not built (HTTP 501) */
  TC_ERROR_LIMIT,        /* over a configured limit (HTTP 413) */
  TC_ERROR_FORMAT,       /* a file that is damaged, inconsistent or of an unknown kind (HTTP 415/422) */
  TC_ERROR_IO,           /* the system refused: open, read, write, spawn (HTTP 500) */
  TC_ERROR_MEMORY,       /* an allocation failed or would pass the budget (HTTP 507) */
  TC_ERROR_CANCELLED,    /* the caller asked to stop */
  TC_ERROR_PAUSED,       /* the caller asked for a pause: the frame is to be resumed, never shown (HTTP 503) */
  TC_ERROR_BUSY,         /* try again later (HTTP 503) */
  TC_ERROR_INTERNAL,     /* a fault of the program itself (HTTP 500) */
  TC_ERROR_CODE_COUNT
} tc_error_code;

#define TC_ERROR (tc_error_quark())
GQuark tc_error_quark(void);

/* Sets *error like g_set_error() and stores which member of a JSON document is at fault:
 * `pointer` is an RFC 6901 JSON pointer such as "/camera/up" (copied), or NULL. */
void tc_set_error(GError **error, tc_error_code code, const char *pointer, const char *format, ...)
    G_GNUC_PRINTF(4, 5);

/* The JSON pointer stored with an error of TC_ERROR; NULL if none was stored. Owned by the error. */
const char *tc_error_pointer(const GError *error);

#ifdef __cplusplus
}
#endif

#endif
