/* Recognises DICOM, pictures and HDF5 by their first bytes. The daemon uses this to choose a helper, the helper to
 * choose files of a folder. */
#include <fcntl.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "renderer/import/helper.h"

static unsigned u16(const uint8_t *at, bool big) { return big ? at[0] << 8 | at[1] : at[1] << 8 | at[0]; }

static bool is_vr(const uint8_t *at) {
  static const char known[] =
      "AE AS AT CS DA DS DT FD FL IS LO LT OB OD OF OL OV OW PN SH SL SQ SS ST SV TM UC UI UL UN UR US "
      "UT UV ";
  if (at[0] < 'A' || at[0] > 'Z' || at[1] < 'A' || at[1] > 'Z') return false;
  for (const char *vr = known; *vr; vr += 3)
    if (vr[0] == (char)at[0] && vr[1] == (char)at[1]) return true;
  return false;
}

/* A data set without preamble begins with group 2 or 8, a low element and a VR or a small length. */
static bool bare_data_set(const uint8_t *head, size_t size) {
  if (size < 16) return false;
  for (int big = 0; big < 2; big++) {
    unsigned group = u16(head, big), element = u16(head + 2, big);
    if ((group != 0x0002 && group != 0x0008) || element > 0x0100) continue;
    if (is_vr(head + 4)) return true;
    if (!big && (head[4] | head[5]) != 0 && head[6] == 0 && head[7] == 0 && head[4] <= 128 && head[5] == 0) return true;
  }
  return false;
}

bool tc_dicom_looks(const uint8_t *head, size_t size) {
  return (size >= 132 && memcmp(head + 128, "DICM", 4) == 0) || bare_data_set(head, size);
}

bool tc_picture_looks(const uint8_t *head, size_t size) {
  static const char *const magic[] = {"\x89PNG", "II*\0", "II+\0", "MM\0*", "MM\0+"};
  for (int i = 0; i < 5 && size >= 4; i++)
    if (memcmp(head, magic[i], 4) == 0) return true;
  return false;
}

bool tc_hdf5_looks(const uint8_t *head, size_t size) { return size >= 8 && memcmp(head, "\x89HDF\r\n\x1a\n", 8) == 0; }

tc_helper tc_helper_of(const uint8_t *head, size_t size) {
  if (tc_hdf5_looks(head, size)) return TC_HELPER_MINC;
  const bool zip = size >= 4 && (memcmp(head, "PK\3\4", 4) == 0 || memcmp(head, "PK\5\6", 4) == 0);
  return zip || tc_dicom_looks(head, size) || tc_picture_looks(head, size) ? TC_HELPER_DICOM : TC_HELPER_FORMATS;
}

tc_helper tc_helper_for(const char *path) {
  struct stat st;
  uint8_t head[TC_DICOM_HEAD_BYTES_NEEDED];
  int fd = open(path, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0) return TC_HELPER_FORMATS;
  const ssize_t n = fstat(fd, &st) == 0 && S_ISREG(st.st_mode) ? pread(fd, head, sizeof head, 0) : 0;
  close(fd);
  return n < 4 ? TC_HELPER_FORMATS : tc_helper_of(head, (size_t)n);
}
