/* Programs: compiled from text pieces, and a bounded cache of them. Needs a current context throughout. */
#ifndef TC_GL_PROGRAM_H
#define TC_GL_PROGRAM_H

#include <stddef.h>
#include <stdint.h>

#include "renderer/base/error.h"

/* Compiles and links one compute shader from `count` pieces, concatenated in order. `label` (ASCII) names it in errors
 * and in driver tools. Returns the GL name, which the caller deletes; 0 on failure: TC_ERROR_INTERNAL with the first
 * line of the driver's log. */
unsigned tc_gl_program_compile(const char *const *pieces, size_t count, const char *label, GError **error);
/* Compiles and links a vertex and a fragment shader of `count` pieces each. */
unsigned tc_gl_program_draws(const char *const *vertex, const char *const *fragment, size_t count, const char *label,
                             GError **error);

/* An LRU cache of TC_GL_PROGRAMS programs. Keys are compared by memcmp. */
#define TC_GL_PROGRAMS 32
#define TC_GL_PROGRAM_KEY 32 /* bytes of a key at most */

typedef struct tc_gl_program_cache {
  struct {
    uint8_t key[TC_GL_PROGRAM_KEY];
    unsigned program;
    uint64_t used;
  } entries[TC_GL_PROGRAMS];
  uint64_t clock;      /* counts look-ups */
  uint64_t n_compiled; /* number of calls of put(), for tests and reports */
} tc_gl_program_cache;

/* The cached program, or 0. A zeroed cache is empty. `size` <= TC_GL_PROGRAM_KEY. */
unsigned tc_gl_program_find(tc_gl_program_cache *cache, const void *key, size_t size);

/* Stores a program under a new key; the cache owns it from now on. */
void tc_gl_program_put(tc_gl_program_cache *cache, const void *key, size_t size, unsigned program);

/* Deletes every program; the cache is empty afterwards. */
void tc_gl_program_clear(tc_gl_program_cache *cache);

#endif
