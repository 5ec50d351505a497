/* EGL: finds a device with headless OpenGL 4.5 core, and creates contexts on it.
 *
 * Hardware first (EGL device platform), else Mesa's surfaceless platform, which uses llvmpipe if there is no GPU.
 * A context is used by one thread at a time: by its creator, until released for another. Any thread may probe. */
#ifndef TC_GL_DEVICE_H
#define TC_GL_DEVICE_H

#include <stdbool.h>
#include <stdint.h>

#include "renderer/base/error.h"

/* Properties of the device; strings as the driver reports them, truncated. */
typedef struct tc_gl_report {
  bool hardware;     /* false: a software rasteriser (llvmpipe, softpipe, swrast) */
  char platform[16]; /* "device" or "surfaceless" */
  char vendor[64], renderer[128], version[96];
  int max_3d_side; /* texels along one side of a 3-D texture, at least */
  int64_t max_ssbo_bytes;
  int timestamp_bits; /* 0: no GPU clock */
} tc_gl_report;

typedef struct tc_gl_context tc_gl_context;

/* Makes a context, reads the report and frees the context; the calling thread keeps its own current context.
 * TC_ERROR_UNSUPPORTED says what was tried. */
bool tc_gl_report_read(tc_gl_report *report, GError **error);

/* Number of EGL devices that do not report to be software; -1 if EGL cannot list devices. Loads no driver, because
 * initialising llvmpipe alone costs some 55 MB for the lifetime of the process. */
int tc_gl_count_hardware(void);

/* A new context, current on the calling thread. */
tc_gl_context *tc_gl_context_new(GError **error);
void tc_gl_context_free(tc_gl_context *context); /* same thread; NULL is fine */

/* Makes the context current on the calling thread unless it already is (several may share a thread). */
bool tc_gl_context_use(tc_gl_context *context, GError **error);

/* Releases the calling thread's current context, so that another thread may use it. */
void tc_gl_context_release(void);

const tc_gl_report *tc_gl_context_about(const tc_gl_context *context);

/* Turns pending GL errors or a GPU reset into a GError "gl: WHAT: ..."; true when there is none. Out of memory is
 * TC_ERROR_MEMORY, all else TC_ERROR_INTERNAL. Needs a current context. */
bool tc_gl_check(const char *what, GError **error);

/* Discards pending GL errors, so that the next tc_gl_check() reports only its own. */
void tc_gl_forget_errors(void);

#endif
