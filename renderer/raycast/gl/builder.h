/* Pre-integration tables built on the GPU, directly in the buffer that frames read: only the pieces of the value axis
 * are uploaded, O(n). Entries agree with those of classify/preintegration.c within 1e-6, whatever the extinction. Needs
 * a current context.
 *
 * On diagonal k, a window of k segments consists of the end of its first block, whole blocks, and the beginning of its
 * last. Blocks are about sqrt(n) wide, so an entry takes a bounded number of compositions, all by one invocation,
 * without barriers or shared memory. The CPU's blocks are k wide (van Herk, Gil-Werman), which needs fewer compositions
 * but offers no parallelism within a diagonal. */
#ifndef TC_RAYCAST_GL_BUILDER_H
#define TC_RAYCAST_GL_BUILDER_H

#include "renderer/classify/preintegration.h"
#include "renderer/gl/device.h"
#include "renderer/tomocast.h"

typedef struct tc_gl_builder {
  unsigned blocks, windows; /* programs; 0: not in use */
  int most_entries;         /* capacity of a buffer texture */
  const char *why;          /* which processor builds tables, and the reason */
} tc_gl_builder;

/* Compiles the programs if tables are built on the GPU: on request, or by default on hardware. If compiling fails, the
 * CPU builds tables, and builder->why says so. */
void tc_gl_builder_make(tc_gl_builder *builder, tc_table_builder wanted, const tc_gl_report *report);
void tc_gl_builder_clear(tc_gl_builder *builder);

/* True if a table with these parameters is built on the GPU. *why: which processor builds it, and the reason;
 * static. */
bool tc_gl_builder_serves(const tc_gl_builder *builder, int n, int n_subtables, int bits, const char **why);

/* Writes all entries of the table into a buffer (table->bytes, GL_DYNAMIC_STORAGE_BIT) through its buffer texture
 * (GL_RGBA32F), and waits for the result. */
bool tc_gl_builder_run(const tc_gl_builder *builder, const tc_table *table, unsigned buffer, unsigned texture,
                       GError **error);

#endif
