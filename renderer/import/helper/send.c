/* The helper's side of the message stream. Depends on the C library only. */
#include <errno.h>
#include <string.h>
#include <unistd.h>

#include "renderer/import/wire.h"

static bool write_all(int fd, const void *bytes, size_t size) {
  const char *at = bytes;
  while (size > 0) {
    ssize_t n = write(fd, at, size);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    at += n;
    size -= (size_t)n;
  }
  return true;
}

static void put_u32(uint8_t **at, uint32_t value) {
  for (int i = 0; i < 4; i++) *(*at)++ = (uint8_t)(value >> (8 * i));
}

static void put_f64(uint8_t **at, double value) {
  uint64_t bits;
  memcpy(&bits, &value, 8);
  for (int i = 0; i < 8; i++) *(*at)++ = (uint8_t)(bits >> (8 * i));
}

/* Writes a fixed-size text field: cut to fit, zero-filled, always terminated. */
static void put_text(uint8_t **at, const char *text, size_t field) {
  size_t n = strnlen(text, field - 1);
  memset(*at, 0, field);
  memcpy(*at, text, n);
  *at += field;
}

static bool send_message(int fd, uint32_t kind, const void *bytes, size_t size) {
  uint8_t whole[TC_WIRE_HEADER_BYTES + 4 + TC_WIRE_NAME], *at = whole;
  put_u32(&at, kind);
  put_u32(&at, (uint32_t)size);
  memcpy(at, bytes, size);
  return write_all(fd, whole, TC_WIRE_HEADER_BYTES + size);
}

bool tc_wire_send_progress(int fd, double fraction) {
  uint8_t body[8], *at = body;
  put_f64(&at, fraction);
  return send_message(fd, TC_WIRE_PROGRESS, body, sizeof body);
}

bool tc_wire_send_series(int fd, const tc_series *series) {
  uint8_t body[TC_WIRE_SERIES_BYTES], *at = body;
  put_text(&at, series->uid, 72);
  put_text(&at, series->modality, 16);
  put_text(&at, series->label, 64);
  put_u32(&at, (uint32_t)series->files);
  put_u32(&at, (uint32_t)series->frames);
  put_u32(&at, (uint32_t)series->rows);
  put_u32(&at, (uint32_t)series->columns);
  put_u32(&at, (uint32_t)series->number);
  put_u32(&at, (uint32_t)series->volume);
  put_u32(&at, (uint32_t)series->slices);
  put_text(&at, series->what, 48);
  put_text(&at, series->description, 64);
  put_text(&at, series->time, 32);
  put_text(&at, series->patient, 128);
  return send_message(fd, TC_WIRE_SERIES, body, sizeof body);
}

bool tc_wire_send_head(int fd, const tc_volume_desc *desc, const tc_provenance *from) {
  uint8_t body[TC_WIRE_HEAD_BYTES], *at = body;
  for (int i = 0; i < 3; i++) put_u32(&at, (uint32_t)desc->dims[i]);
  put_u32(&at, (uint32_t)desc->type);
  put_u32(&at, (uint32_t)desc->frames);
  put_u32(&at, (uint32_t)from->volume);
  put_u32(&at, (uint32_t)from->slices_used);
  put_u32(&at, (uint32_t)from->slices_found);
  put_u32(&at, (uint32_t)from->bridged);
  put_u32(&at, from->resampled);
  put_u32(&at, from->colors);
  for (int i = 0; i < 3; i++) put_f64(&at, desc->spacing[i]);
  for (int i = 0; i < 3; i++) put_f64(&at, desc->origin[i]);
  for (int i = 0; i < 9; i++) put_f64(&at, desc->direction[i]);
  put_f64(&at, desc->slope);
  put_f64(&at, desc->intercept);
  put_f64(&at, desc->window_center);
  put_f64(&at, desc->window_width);
  put_text(&at, desc->modality, 16);
  put_text(&at, desc->unit, 16);
  put_text(&at, desc->note, 256);
  put_text(&at, desc->format, 16);
  put_text(&at, from->description, 64);
  put_text(&at, from->time, 16);
  return send_message(fd, TC_WIRE_HEAD, body, sizeof body);
}

bool tc_wire_send_segment(int fd, const tc_segment *segment) {
  uint8_t body[TC_WIRE_SEGMENT_BYTES], *at = body;
  put_u32(&at, segment->label);
  put_u32(&at, segment->of[0]);
  put_u32(&at, segment->of[1]);
  *at++ = segment->has_color;
  for (int i = 0; i < 3; i++) *at++ = (uint8_t)(segment->color[i] * 255 + 0.5f);
  put_text(&at, segment->name, sizeof segment->name);
  return send_message(fd, TC_WIRE_SEGMENT, body, sizeof body);
}

bool tc_wire_send_mesh(int fd, const tc_mesh_head *head) {
  uint8_t body[TC_WIRE_MESH_BYTES], *at = body;
  for (int i = 0; i < 3; i++) put_f64(&at, head->origin[i]);
  put_f64(&at, (double)head->n_vertices);
  put_f64(&at, (double)head->n_triangles);
  put_f64(&at, (double)head->degenerate);
  put_u32(&at, head->normals);
  put_u32(&at, head->colors);
  put_text(&at, head->format, sizeof head->format);
  return send_message(fd, TC_WIRE_MESH, body, sizeof body);
}

bool tc_wire_send_voxels(int fd, unsigned slot, size_t bytes) {
  uint8_t body[8], *at = body;
  put_u32(&at, slot);
  put_u32(&at, (uint32_t)bytes);
  return send_message(fd, TC_WIRE_VOXELS, body, sizeof body);
}

bool tc_wire_send_want(int fd, uint64_t bytes) {
  uint8_t body[8], *at = body;
  put_u32(&at, (uint32_t)bytes);
  put_u32(&at, (uint32_t)(bytes >> 32));
  return send_message(fd, TC_WIRE_WANT, body, sizeof body);
}

bool tc_wire_send_model(int fd, uint64_t bytes) {
  uint8_t body[8], *at = body;
  put_u32(&at, (uint32_t)bytes);
  put_u32(&at, (uint32_t)(bytes >> 32));
  return send_message(fd, TC_WIRE_MODEL, body, sizeof body);
}

bool tc_wire_send_open(int fd, const char *name, bool optional) {
  uint8_t body[4 + TC_WIRE_NAME], *at = body;
  put_u32(&at, optional);
  put_text(&at, name, TC_WIRE_NAME);
  return send_message(fd, TC_WIRE_OPEN, body, sizeof body);
}

bool tc_wire_send_fail(int fd, int code, const char *text) {
  uint8_t body[4 + TC_WIRE_FAIL_TEXT], *at = body;
  put_u32(&at, (uint32_t)code);
  put_text(&at, text, TC_WIRE_FAIL_TEXT);
  return send_message(fd, TC_WIRE_FAIL, body, sizeof body);
}

bool tc_wire_send_end(int fd) { return send_message(fd, TC_WIRE_END, "", 0); }
