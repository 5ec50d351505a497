/* Files compiled into the program (shader pieces, the browser client); made by deploy/embed.cmake. */
#ifndef TC_EMBEDDED_H
#define TC_EMBEDDED_H

#include <stddef.h>
#include <string.h>

struct tc_embedded_file {
  const char *name;           /* file name without folder; NULL ends a table */
  const unsigned char *bytes; /* [size], followed by a 0 byte, so text may be used as a C string */
  size_t size;
};

/* The text of a file in a table; NULL: no such file. */
static inline const char *tc_embedded_text(const struct tc_embedded_file *file, const char *name) {
  while (file->name && strcmp(file->name, name) != 0) file++;
  return (const char *)file->bytes;
}

extern const struct tc_embedded_file tc_shader_files[];    /* renderer/.../gl/ *.glsl */
extern const struct tc_embedded_file tc_web_files[];       /* web/ as deploy/bundle.cmake made it, and NAME.gz of each */
extern const struct tc_embedded_file tcs_report_files[];   /* server/bench/: report's page */
extern const struct tc_embedded_file tcp_protocol_files[]; /* protocol/openapi.json */

#endif
