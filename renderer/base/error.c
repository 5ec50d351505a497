#include "renderer/base/error.h"

#include <stdarg.h>

typedef struct {
  char *pointer;
} TcErrorPrivate;

static void tc_error_private_init(TcErrorPrivate *priv) { priv->pointer = NULL; }

static void tc_error_private_copy(const TcErrorPrivate *src, TcErrorPrivate *dest) {
  dest->pointer = g_strdup(src->pointer);
}

static void tc_error_private_clear(TcErrorPrivate *priv) { g_free(priv->pointer); }

G_DEFINE_EXTENDED_ERROR(TcError, tc_error)

void tc_set_error(GError **error, tc_error_code code, const char *pointer, const char *format, ...) {
  if (!error) return;
  va_list args;
  va_start(args, format);
  *error = g_error_new_valist(TC_ERROR, (int)code, format, args);
  va_end(args);
  tc_error_get_private(*error)->pointer = g_strdup(pointer);
}

const char *tc_error_pointer(const GError *error) {
  return error && error->domain == TC_ERROR ? tc_error_get_private(error)->pointer : NULL;
}
