/* Memory for large arrays. */
#ifndef TC_RENDERER_RESERVE_H
#define TC_RENDERER_RESERVE_H

#include <stdlib.h>
#include <sys/mman.h>

/* Allocates n items of `size` bytes and one more, so that no array is empty; not cleared; in huge pages where the system has them,
 * because page faults of small pages take a tenth of a mesh's extraction. NULL: no memory. The caller frees with free(). Any
 * thread. */
static inline void *tc_reserve(size_t n, size_t size) {
  const size_t page = (size_t)2 << 20, bytes = (n + 1) * size;
  if (bytes < page) return malloc(bytes);
  void *p = aligned_alloc(page, (bytes + page - 1) & ~(page - 1));
  if (p) madvise(p, bytes & ~(page - 1), MADV_HUGEPAGE); /* failure only costs time */
  return p;
}

#endif
