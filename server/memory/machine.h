/* How much memory there is for this process: the machine's, or less where a control group says so. */
#ifndef TCS_MEMORY_MACHINE_H
#define TCS_MEMORY_MACHINE_H

#include <stdint.h>

/* Bytes: the least of MemTotal and of what the own control groups and those above them allow (version 2: memory.max and
 * memory.high; version 1: memory.limit_in_bytes). `root` stands before /proc and /sys: "" but for tests. 0: unknown. */
uint64_t tcs_machine_memory(const char *root);

#endif
