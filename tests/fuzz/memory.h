/* What a helper says, from memory: for a tc_wire_reader. */
#ifndef TC_FUZZ_MEMORY_H
#define TC_FUZZ_MEMORY_H

#include <string.h>

#include "renderer/import/wire.h"

typedef struct memory {
  const uint8_t *bytes;
  size_t size;
} memory;

static inline bool read_memory(void *user, void *bytes, size_t size, GError **error) {
  memory *m = user;
  if (size > m->size) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "end");
    return false;
  }
  memcpy(bytes, m->bytes, size);
  m->bytes += size;
  m->size -= size;
  return true;
}

static inline void no_reply(void *user, char what, int fd) {}

#endif
