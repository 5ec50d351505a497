/* The program that knows MINC alone: libhdf5 and what it links take longer to start than most files to read. */
#include <unistd.h>

#include "renderer/import/helper/format.h"

bool tc_helper_decode(int fd, const tc_helper_request *request, const tc_order *order, GError **error) {
  tc_input input;
  tc_order own = *order;
  if (!tc_input_adopt(&input, dup(fd), request->name, error)) return false;
  const bool ok = tc_choice_volume(request->choice, tc_format_minc.name, &own.volume, error) &&
                  tc_format_minc.read(&input, &own, error);
  tc_input_close(&input);
  return ok;
}
