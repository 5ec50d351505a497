/* Inputs: random access to files and memory, and files next to them. */
#include "renderer/import/helper/decode.h"
#include "renderer/import/reader.h"

#include <errno.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "renderer/import/wire.h"

/* Bytes of a file that are searched for its first decoded bytes. */
#define HEAD_REACH (1u << 20)

#define HEADER_LIMIT (4u << 20)
#define PACKED_HEADER_LIMIT (256u << 10)

static tc_encoding packing_of(const tc_input *input) {
  uint8_t magic[10] = {0};
  if (!tc_input_read(input, 0, magic, (size_t)MIN(input->size, sizeof magic), NULL)) return TC_ENCODING_RAW;
  if (magic[0] == 0x1f && magic[1] == 0x8b) return TC_ENCODING_DEFLATE;
  const bool blocks = memcmp(magic + 4, "1AY&SY", 6) == 0 || memcmp(magic + 4, "\x17rE8P\x90", 6) == 0;
  return memcmp(magic, "BZh", 3) == 0 && blocks ? TC_ENCODING_BZIP2 : TC_ENCODING_RAW;
}

/* Accepts regular files only: a FIFO or a device could block or never end. */
bool tc_input_adopt(tc_input *input, int fd, const char *name, GError **error) {
  struct stat st;
  *input = (tc_input){.fd = fd, .name = g_strdup(name)};
  if (fstat(fd, &st) == 0 && S_ISREG(st.st_mode)) {
    input->size = (uint64_t)st.st_size;
    input->packing = packing_of(input);
    return true;
  }
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "not a regular file");
  tc_input_close(input);
  return false;
}

void tc_input_memory(tc_input *input, const void *bytes, size_t size, const char *name) {
  *input = (tc_input){.fd = -1, .bytes = bytes, .size = size, .name = g_strdup(name)};
  input->packing = packing_of(input);
}

void tc_input_close(tc_input *input) {
  if (input->fd > 0) close(input->fd); /* a zeroed input has fd 0, which an input never owns */
  g_free(input->name);
  g_free(input->owned);
  *input = (tc_input){.fd = -1};
}

bool tc_input_may_name(const tc_input *input, GError **error) {
  if (input->open || input->member) return true;
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "the header names another file; upload header and voxels as one");
  return false;
}

bool tc_input_open_sibling(const tc_input *input, const char *name, bool optional, tc_input *sibling, GError **error) {
  *sibling = (tc_input){.fd = -1};
  if (input->member) {
    if (input->member(input->open_user, name, sibling, error)) return true;
    if (!optional && !*error) tc_set_error(error, TC_ERROR_FORMAT, NULL, "%s is not in the zip", name);
    return false;
  }
  if (!input->open) return !optional && tc_input_may_name(input, error);
  if (strlen(name) >= TC_WIRE_NAME) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "the name of a data file is longer than any system has");
    return false;
  }
  const int fd = input->open(input->open_user, name, optional, error);
  return fd >= 0 && tc_input_adopt(sibling, fd, name, error);
}

bool tc_input_read(const tc_input *input, uint64_t offset, void *to, size_t n, GError **error) {
  if (n == 0) return true;
  if (offset > input->size || n > input->size - offset) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "file ends at byte %" G_GUINT64_FORMAT ", before its data do",
                 input->size);
    return false;
  }
  if (input->fd < 0) {
    memcpy(to, input->bytes + offset, n);
    return true;
  }
  for (size_t done = 0; done < n;) {
    ssize_t got = pread(input->fd, (char *)to + done, n - done, (off_t)(offset + done));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) {
      tc_set_error(error, TC_ERROR_IO, NULL, "reading failed: %s",
                   got < 0 ? g_strerror(errno) : "the file was cut short");
      return false;
    }
    done += (size_t)got;
  }
  return true;
}

bool tc_input_head(const tc_input *input, void *to, size_t n, size_t *got, GError **error) {
  *got = 0;
  /* concatenated empty gzip members could fill a whole file */
  tc_input start = *input;
  if (input->packing != TC_ENCODING_RAW) start.size = MIN(start.size, (uint64_t)HEAD_REACH);
  tc_decoder *decoder = tc_decoder_new(&start, 0, input->packing, TC_ELEMENT_U8, 0, error);
  if (!decoder) return false;
  bool ok = true;
  GError *trouble = NULL;
  for (size_t more = 1; *got < n && more > 0; *got += more)
    if (!tc_decoder_read(decoder, (char *)to + *got, n - *got, &more, &trouble)) {
      more = 0;
      ok = g_error_matches(trouble, TC_ERROR, TC_ERROR_FORMAT);
      break;
    }
  tc_decoder_free(decoder);
  if (ok)
    g_clear_error(&trouble);
  else
    g_propagate_error(error, trouble);
  return ok;
}

uint8_t *tc_input_header(const tc_input *input, size_t *size, GError **error) {
  const bool raw = input->packing == TC_ENCODING_RAW;
  const size_t most = raw ? (size_t)MIN(input->size, (uint64_t)HEADER_LIMIT) : PACKED_HEADER_LIMIT;
  uint8_t *bytes = g_try_malloc(most + 1);
  if (!bytes)
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "no memory for the header");
  else if (!tc_input_head(input, bytes, most, size, error))
    g_clear_pointer(&bytes, g_free);
  return bytes;
}
