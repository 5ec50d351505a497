/* Any bytes as a DICOM file through the helper's own decoder, in this process: GDCM and all that stands before and behind
 * it. Either a sound volume comes out or one clear error. */
#include <sys/mman.h>

#include "import_fuzz.h"

/* A file that trips one of GDCM's assertions leaks what GDCM held (dicom.cc says why). */
int __lsan_is_turned_off(void);
int __lsan_is_turned_off(void) { return 1; }

extern bool fuzz_opened;
bool fuzz_opened;

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
  static const tc_import_options options = {.max_voxel_bytes = 8 << 20};
  static const tc_helper_request request = {.name = "f"};
  read_here here = {.options = &options, .folder = -1};
  const tc_order order = {.max_voxel_bytes = options.max_voxel_bytes, .user = &here, .want = here_want, .begin = here_begin, .segment = here_segment,
                          .room = here_room, .filled = here_filled, .goes_on = here_goes_on, .open = here_open};
  GError *error = NULL;
  const int file = memfd_create("input", MFD_CLOEXEC);
  if (file < 0 || write(file, bytes, size) != (ssize_t)size) abort();
  fuzz_opened = tc_helper_decode(file, &request, &order, &error);
  if (fuzz_opened) {
    if (error || here.done != here.total || (here.colors && !tc_colors_end(here.colors))) abort();
    tc_volume_seal(here.volume);
    check_volume(here.volume);
    /* Cut before the end mark of its pixels a file opens, and says so. */
    fuzz_opened = !strstr(tc_volume_describe(here.volume)->note, "lack the mark");
  } else if (!error || error->domain != TC_ERROR || strpbrk(error->message, "\r\n")) {
    abort();
  }
  tc_colors_free(here.colors);
  close(file);
  g_clear_error(&error);
  tc_volume_unref(here.volume);
  return 0;
}
