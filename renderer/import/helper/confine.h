/* How the helper locks itself in. */
#ifndef TC_IMPORT_CONFINE_H
#define TC_IMPORT_CONFINE_H

#include "renderer/import/wire.h"

/* Gives up everything a decoder does not need, for good: limits, capabilities, new privileges, files (Landlock: of a
 * folder, what is beneath it and what the links of an annex above it lead to; else none), and system calls (seccomp: an
 * allow-list without connections, programs, processes, signals to others, or writing to files). TC_ERROR_IO when the
 * system has no seccomp, or no Landlock unless the request allows that: then nothing may be decoded. */
bool tc_confine(int input_fd, const tc_helper_request *request, GError **error);

#endif
