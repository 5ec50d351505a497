/* Compiling and caching compute programs. See program.h. */
#include "renderer/gl/program.h"

#include <assert.h>
#include <epoxy/gl.h>
#include <string.h>

/* Cuts a driver's log to its first line, for a one-line message. */
static void first_line(char *log) {
  g_strchug(log);
  log[strcspn(log, "\r\n")] = 0;
}

static unsigned link_program(unsigned shader, const char *label, GError **error) {
  unsigned program = glCreateProgram();
  glAttachShader(program, shader);
  glLinkProgram(program);
  GLint linked = 0;
  glGetProgramiv(program, GL_LINK_STATUS, &linked);
  glDetachShader(program, shader);
  if (linked) {
    glObjectLabel(GL_PROGRAM, program, -1, label);
    return program;
  }
  char log[1024] = "";
  glGetProgramInfoLog(program, sizeof log, NULL, log);
  first_line(log);
  glDeleteProgram(program);
  tc_set_error(error, TC_ERROR_INTERNAL, NULL, "gl: shader %s does not link: %s", label, log);
  return 0;
}

unsigned tc_gl_program_compile(const char *const *pieces, size_t count, const char *label, GError **error) {
  unsigned shader = glCreateShader(GL_COMPUTE_SHADER);
  if (!shader) {
    tc_set_error(error, TC_ERROR_INTERNAL, NULL, "gl: the driver makes no compute shader; use --backend cpu");
    return 0;
  }
  glShaderSource(shader, (GLsizei)count, pieces, NULL);
  glCompileShader(shader);
  GLint compiled = 0;
  glGetShaderiv(shader, GL_COMPILE_STATUS, &compiled);
  unsigned program = 0;
  if (compiled) {
    program = link_program(shader, label, error);
  } else {
    char log[1024] = "";
    glGetShaderInfoLog(shader, sizeof log, NULL, log);
    first_line(log);
    tc_set_error(error, TC_ERROR_INTERNAL, NULL, "gl: shader %s does not compile: %s", label, log);
  }
  glDeleteShader(shader);
  return program;
}

static void pad_key(uint8_t padded[TC_GL_PROGRAM_KEY], const void *key, size_t size) {
  assert(size <= TC_GL_PROGRAM_KEY);
  memset(padded, 0, TC_GL_PROGRAM_KEY);
  memcpy(padded, key, size);
}

unsigned tc_gl_program_find(tc_gl_program_cache *cache, const void *key, size_t size) {
  uint8_t padded[TC_GL_PROGRAM_KEY];
  pad_key(padded, key, size);
  cache->clock++;
  for (int i = 0; i < TC_GL_PROGRAMS; i++) {
    if (!cache->entries[i].program || memcmp(cache->entries[i].key, padded, sizeof padded) != 0) continue;
    cache->entries[i].used = cache->clock;
    return cache->entries[i].program;
  }
  return 0;
}

void tc_gl_program_put(tc_gl_program_cache *cache, const void *key, size_t size, unsigned program) {
  int victim = 0; /* free entries have clock 0 */
  for (int i = 1; i < TC_GL_PROGRAMS; i++)
    if (cache->entries[i].used < cache->entries[victim].used) victim = i;
  if (cache->entries[victim].program) glDeleteProgram(cache->entries[victim].program);
  pad_key(cache->entries[victim].key, key, size);
  cache->entries[victim].program = program;
  cache->entries[victim].used = ++cache->clock;
  cache->n_compiled++;
}

void tc_gl_program_clear(tc_gl_program_cache *cache) {
  for (int i = 0; i < TC_GL_PROGRAMS; i++)
    if (cache->entries[i].program) glDeleteProgram(cache->entries[i].program);
  memset(cache, 0, sizeof *cache);
}
