/* The helper's sandbox. */
#ifndef TC_IMPORT_CONFINE_H
#define TC_IMPORT_CONFINE_H

#include "renderer/import/wire.h"

/* Permanently gives up everything a decoder does not need: resource limits, capabilities, new privileges, files
 * (Landlock: only an input folder with its content and the targets of its link roots stay readable), and system calls
 * (seccomp allow-list: no connections, programs, processes, signals to other processes, or writing to files).
 * TC_ERROR_IO if the kernel has no seccomp, or no Landlock unless the request allows that; nothing may be decoded
 * then. */
bool tc_confine(int input_fd, const tc_helper_request *request, GError **error);

#endif
