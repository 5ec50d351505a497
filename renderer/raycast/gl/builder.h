/* Pre-integration tables built on the GPU, straight into the buffer that frames read: their pieces go over, O(n), and no
 * entry does. Entries agree with those of classify/table.c within 1e-6, whatever the extinction. Needs a current context.
 *
 * Per diagonal k a window of k segments is the rest of its first block, whole blocks and the beginning of its last;
 * blocks are about sqrt(n) wide, so that an entry takes a constant number of compositions, all by one invocation: no
 * barriers, no shared memory, any n. The cpu's blocks are k wide (van Herk, Gil-Werman), which leaves fewer compositions
 * and nothing to do side by side. */
#ifndef TC_RAYCAST_GL_BUILDER_H
#define TC_RAYCAST_GL_BUILDER_H

#include "renderer/classify/classify.h"
#include "renderer/gl/device.h"
#include "renderer/tomocast.h"

typedef struct tc_gl_builder {
  unsigned blocks, windows; /* programs; 0: not in use */
  int most_entries;         /* that a buffer texture holds */
  const char *why;          /* who builds tables, and the reason */
} tc_gl_builder;

/* Compiles the programs if tables are to be built here: where asked for, else on a GPU. Where that fails, the cpu builds
 * them, and why says so. */
void tc_gl_builder_make(tc_gl_builder *builder, tc_table_builder wanted, const tc_gl_report *report);
void tc_gl_builder_clear(tc_gl_builder *builder);

/* True: a table of these numbers is built here. *why: who builds it, and the reason; static. */
bool tc_gl_builder_serves(const tc_gl_builder *builder, int n, int n_zooms, int bits, const char **why);

/* Writes all entries of the table into a buffer of table->bytes and GL_DYNAMIC_STORAGE_BIT, through a buffer texture of
 * it as GL_RGBA32F, and waits until they are there. */
bool tc_gl_builder_run(const tc_gl_builder *builder, const tc_table *table, unsigned buffer, unsigned texture,
                       GError **error);

#endif
