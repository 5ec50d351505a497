/* The helper program for every format but DICOM and MINC. */
#include <unistd.h>

#include "renderer/import/helper/format.h"

bool tc_helper_decode(int fd, const tc_helper_request *request, const tc_order *order, GError **error) {
  tc_input input;
  if (!tc_input_adopt(&input, dup(fd), request->name, error)) return false;
  if (!request->self_contained) input.open = order->open; /* the daemon would refuse to open it; here the reason is known earlier */
  input.open_user = order->user;
  bool ok = tc_formats_read(&input, request->choice, order, error);
  tc_input_close(&input);
  return ok;
}
