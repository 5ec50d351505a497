/* The helper programs: tomocast-import reads every format but DICOM and MINC, tomocast-dicom reads DICOM with GDCM,
 * whose libraries take longer to load than most files to read. A helper reads its request, locks itself in, decodes
 * and answers. */
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include "renderer/import/helper/confine.h"
#include "renderer/import/helper/output.h"

static bool decode(const tc_helper_request *request, GError **error) {
  tc_output output;
  tc_order order;
  if (!tc_output_init(&output, &order, error) || !tc_confine(TC_HELPER_INPUT_FD, request, error)) return false;
  order.volume = request->volume;
  order.mesh = request->mesh;
  order.max_voxel_bytes = request->max_voxel_bytes;
  return tc_helper_decode(TC_HELPER_INPUT_FD, request, &order, error);
}

int main(void) {
  tc_helper_request request;
  GError *error = NULL;
  if (recv(TC_HELPER_SOCKET_FD, &request, sizeof request, MSG_WAITALL) != sizeof request) {
    fprintf(stderr, "this decodes files for tomocast; it is started by it and not by hand\n");
    return 2;
  }
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  const bool ok = decode(&request, &error);
  if (ok)
    tc_wire_send_end(TC_HELPER_SOCKET_FD);
  else
    tc_wire_send_fail(TC_HELPER_SOCKET_FD, error->code, error->message);
  _exit(ok ? 0 : 1); /* no cleanup is needed, and exit handlers must not run on decoder state */
}
