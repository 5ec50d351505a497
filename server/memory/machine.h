/* Memory available to this process: the machine's, or less within a control group. */
#ifndef TCS_MEMORY_MACHINE_H
#define TCS_MEMORY_MACHINE_H

#include <stdint.h>

/* Bytes: the least of MemTotal and the limits of the process's control groups and their parents (version 2: memory.max
 * and memory.high; version 1: memory.limit_in_bytes). `root` is prefixed to /proc and /sys: "" except in tests. 0:
 * unknown. */
uint64_t tcs_machine_memory(const char *root);

#endif
