/* Compiling and caching programs. See program.h. */
#include "renderer/gl/program.h"

#include <assert.h>
#include <epoxy/gl.h>
#include <string.h>

/* Cuts a driver's log to its first line, for a one-line message. */
static void first_line(char *log) {
  g_strchug(log);
  log[strcspn(log, "\r\n")] = 0;
}

static void say(const char *label, const char *what, char *log, GError **error) {
  first_line(log);
  tc_set_error(error, TC_ERROR_INTERNAL, NULL, "gl: shader %s does not %s: %s", label, what, log);
}

static unsigned link_program(const unsigned *shaders, int n, const char *label, GError **error) {
  unsigned program = glCreateProgram();
  for (int i = 0; i < n; i++) glAttachShader(program, shaders[i]);
  glLinkProgram(program);
  GLint linked = 0;
  glGetProgramiv(program, GL_LINK_STATUS, &linked);
  for (int i = 0; i < n; i++) glDetachShader(program, shaders[i]);
  if (linked) {
    glObjectLabel(GL_PROGRAM, program, -1, label);
    return program;
  }
  char log[1024] = "";
  glGetProgramInfoLog(program, sizeof log, NULL, log);
  glDeleteProgram(program);
  say(label, "link", log, error);
  return 0;
}

static unsigned compile(unsigned kind, const char *const *pieces, size_t count, const char *label, GError **error) {
  unsigned shader = glCreateShader(kind);
  if (!shader) {
    tc_set_error(error, TC_ERROR_INTERNAL, NULL, "gl: the driver cannot create a shader for %s; use --backend cpu", label);
    return 0;
  }
  glShaderSource(shader, (GLsizei)count, pieces, NULL);
  glCompileShader(shader);
  GLint compiled = 0;
  glGetShaderiv(shader, GL_COMPILE_STATUS, &compiled);
  if (compiled) return shader;
  char log[1024] = "";
  glGetShaderInfoLog(shader, sizeof log, NULL, log);
  glDeleteShader(shader);
  say(label, "compile", log, error);
  return 0;
}

unsigned tc_gl_program_compile(const char *const *pieces, size_t count, const char *label, GError **error) {
  const unsigned shader = compile(GL_COMPUTE_SHADER, pieces, count, label, error);
  const unsigned program = shader ? link_program(&shader, 1, label, error) : 0;
  glDeleteShader(shader);
  return program;
}

unsigned tc_gl_program_draws(const char *const *vertex, const char *const *fragment, size_t count, const char *label,
                             GError **error) {
  const unsigned first = compile(GL_VERTEX_SHADER, vertex, count, label, error);
  const unsigned shaders[2] = {first, first ? compile(GL_FRAGMENT_SHADER, fragment, count, label, error) : 0};
  const unsigned program = shaders[1] ? link_program(shaders, 2, label, error) : 0;
  for (int i = 0; i < 2; i++) glDeleteShader(shaders[i]);
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
