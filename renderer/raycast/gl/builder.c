/* From outlines to entries on the GPU. See builder.h. */
#include "renderer/raycast/gl/builder.h"

#include <epoxy/gl.h>
#include <string.h>

#include "renderer/classify/outline.h"
#include "renderer/gl/program.h"
#include "renderer/raycast/gl/compose.h"

#define GROUP 64                         /* local_size_x of preintegration_head.glsl */
#define LARGEST_BLOCK ((int64_t)1 << 27) /* bytes of a buffer that OpenGL 4.5 promises a shader */

static unsigned compile(const char *main_piece) {
  const char *const texts[] = {tc_gl_piece("preintegration_head.glsl"), tc_gl_piece("preintegration_elementary.glsl"),
                               tc_gl_piece(main_piece)};
  return tc_gl_program_compile(texts, G_N_ELEMENTS(texts), main_piece, NULL);
}

void tc_gl_builder_make(tc_gl_builder *builder, tc_table_builder wanted, const tc_gl_report *report) {
  memset(builder, 0, sizeof *builder);
  if (wanted == TC_TABLES_CPU) {
    builder->why = "built by the cpu: asked for";
    return;
  }
  if (wanted == TC_TABLES_AUTO && !report->hardware) { /* measured on two cores: OpenGL takes ten times as long */
    builder->why = "built by the cpu: OpenGL runs in software here and would be slower";
    return;
  }
  builder->why = wanted == TC_TABLES_GL ? "built by opengl: asked for" : "built by opengl: nothing is uploaded to the GPU";
  builder->blocks = compile("preintegration_blocks.glsl");
  builder->windows = compile("preintegration_windows.glsl");
  glGetIntegerv(GL_MAX_TEXTURE_BUFFER_SIZE, &builder->most_entries);
  if (builder->blocks && builder->windows && report->max_ssbo_bytes >= LARGEST_BLOCK) return;
  tc_gl_builder_clear(builder);
  builder->why = "built by the cpu: the GPU's driver rejects the program";
}

void tc_gl_builder_clear(tc_gl_builder *builder) {
  if (builder->blocks) glDeleteProgram(builder->blocks);
  if (builder->windows) glDeleteProgram(builder->windows);
  builder->blocks = builder->windows = 0;
}

bool tc_gl_builder_serves(const tc_gl_builder *builder, int n, int n_subtables, int bits, const char **why) {
  *why = builder->why;
  if (!builder->windows) return false;
  if (bits) *why = "built by the cpu, which also rounds its entries";
  int64_t rows = 2 * (int64_t)n + 4, subtable = (2 * TC_SUBTABLE_NODES + 4) * (TC_SUBTABLE_NODES + 2);
  bool fits = rows * (n + 1) + n_subtables * subtable <= builder->most_entries;
  if (!fits) *why = "built by the cpu: the table exceeds this device's buffer textures";
  return fits && !bits;
}

/* About the square root of the number of intervals: a power of two. */
static int block_for(int intervals) {
  int block = 8;
  while (block * block < intervals) block *= 2;
  return block;
}

static unsigned bind_storage(int binding, size_t bytes, const void *data) {
  unsigned buffer;
  glCreateBuffers(1, &buffer);
  glNamedBufferStorage(buffer, (GLsizeiptr)bytes, data, 0);
  glBindBufferBase(GL_SHADER_STORAGE_BUFFER, (GLuint)binding, buffer);
  return buffer;
}

static void put_row(unsigned target, const tc_table_window *window, int k, const float *row) {
  const size_t entry = sizeof(float[4]), start = window->start + (size_t)k * (size_t)window->columns;
  glNamedBufferSubData(target, (GLintptr)(start * entry), (GLsizeiptr)((size_t)(window->intervals + 1) * entry), row);
}

static void build_window(const tc_gl_builder *b, const tc_table *table, int w, unsigned target) {
  const tc_table_window window = tc_table_window_of(table, w);
  const int n = window.intervals, block = block_for(n), blocks = n / block;
  float(*pieces)[8] = g_malloc(window.n_pieces * sizeof *pieces);
  tc_table_window_pieces(table, w, pieces);
  const unsigned buffers[] = {
      bind_storage(0, window.n_pieces * sizeof *pieces, pieces),
      bind_storage(1, ((size_t)n + 1) * sizeof *window.first, window.first),
      bind_storage(2, (size_t)MAX(blocks, 1) * (size_t)n * 2 * sizeof(float[4]), NULL)};
  g_free(pieces);
  put_row(target, &window, 0, window.diagonal);
  put_row(target, &window, n + 2, window.depths);
  const unsigned programs[] = {b->blocks, b->windows};
  const int places[] = {blocks, (n + block - 1) / block};
  for (int i = 0; i < 2; i++) {
    glProgramUniform4i(programs[i], 0, n, window.columns, (GLint)window.start, block);
    if (i == 1) glProgramUniform4f(programs[i], 1, window.peak[0], window.peak[1], window.peak[2], 1);
    glUseProgram(programs[i]);
    if (places[i]) glDispatchCompute((GLuint)(n + GROUP - 1) / GROUP, (GLuint)places[i], 1);
    glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT);
  }
  glDeleteBuffers(G_N_ELEMENTS(buffers), buffers); /* freed once the GPU has finished with them */
}

bool tc_gl_builder_run(const tc_gl_builder *builder, const tc_table *table, unsigned buffer, unsigned texture,
                       GError **error) {
  tc_gl_forget_errors();
  glClearNamedBufferData(buffer, GL_RGBA32F, GL_RGBA, GL_FLOAT, NULL); /* entries outside the table */
  glBindImageTexture(0, texture, 0, GL_FALSE, 0, GL_READ_WRITE, GL_RGBA32F);
  for (int w = 0; w <= table->n_subtables; w++) build_window(builder, table, w, buffer);
  glBindImageTexture(0, 0, 0, GL_FALSE, 0, GL_READ_ONLY, GL_RGBA32F);
  glMemoryBarrier(GL_TEXTURE_FETCH_BARRIER_BIT | GL_BUFFER_UPDATE_BARRIER_BIT);
  glFinish();
  return tc_gl_check("pre-integration table", error);
}
