/* Uploading and keeping volumes and lookups. See textures.h. */
#include "renderer/raycast/gl/textures.h"

#include <epoxy/gl.h>
#include <string.h>
#include <sys/mman.h>

#include "renderer/base/clock.h"

/* Uploads are split into pieces of this size, so that a driver's staging copy stays small. */
#define UPLOAD_BYTES ((size_t)32 << 20)
#define POLL_BYTES ((size_t)1 << 20)   /* of lookups, uploaded between two polls of the halt */
#define PINNED_BYTES ((size_t)4 << 20) /* larger lookups are backed by our own memory with software OpenGL */

typedef struct texel_format {
  GLenum internal, layout, type;
} texel_format;

/* The voxels' own type: a gather returns them unchanged. (Signed normalised formats would map -32768 to -32767.) */
static const texel_format formats[TC_VOXEL_TYPE_COUNT] = {[TC_U8] = {GL_R8UI, GL_RED_INTEGER, GL_UNSIGNED_BYTE},
                                                          [TC_I8] = {GL_R8I, GL_RED_INTEGER, GL_BYTE},
                                                          [TC_U16] = {GL_R16UI, GL_RED_INTEGER, GL_UNSIGNED_SHORT},
                                                          [TC_I16] = {GL_R16I, GL_RED_INTEGER, GL_SHORT},
                                                          [TC_F32] = {GL_R32F, GL_RED, GL_FLOAT}};

/* ---- volumes ---- */

/* Uploads slab by slab; a slab ends where a layer of an atlas does. */
static void upload(const tc_gl_volume *copy, const tc_volume *volume, const texel_format *format) {
  const tc_volume_desc *desc = tc_volume_describe(volume);
  const uint8_t *voxels = tc_volume_data(volume);
  size_t slice = (size_t)desc->dims[0] * desc->dims[1] * tc_voxel_size(desc->type);
  int slab = slice < UPLOAD_BYTES ? (int)(UPLOAD_BYTES / slice) : 1;
  if (copy->slices_per_layer > 1) slab = 1;
  glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
  for (int z = 0; z < desc->dims[2]; z += slab) {
    int depth = MIN(slab, desc->dims[2] - z);
    const void *from = voxels + (size_t)z * slice;
    glTextureSubImage3D(copy->texture, 0, 0, z % copy->slices_per_layer * desc->dims[1], z / copy->slices_per_layer,
                        desc->dims[0], desc->dims[1], depth, format->layout, format->type, from);
  }
}

/* False: larger than the device's textures. */
static bool texture_size(const tc_volume_desc *desc, int size[3], int *slices_per_layer) {
  GLint side = 0, layers = 0;
  memcpy(size, desc->dims, 3 * sizeof *size);
  glGetIntegerv(GL_MAX_TEXTURE_SIZE, &side);
  glGetIntegerv(GL_MAX_ARRAY_TEXTURE_LAYERS, &layers);
  *slices_per_layer = (desc->dims[2] + layers - 1) / layers;
  size[2] = (desc->dims[2] + *slices_per_layer - 1) / *slices_per_layer;
  if (size[0] > side || (int64_t)size[1] * *slices_per_layer > side) return false;
  size[1] *= *slices_per_layer;
  return true;
}

static void set_sampling(unsigned texture) {
  glTextureParameteri(texture, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
  glTextureParameteri(texture, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
  glTextureParameteri(texture, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
  glTextureParameteri(texture, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
  glTextureParameteri(texture, GL_TEXTURE_WRAP_R, GL_CLAMP_TO_EDGE);
}

static void drop_volume(tc_gl_textures *textures, tc_gl_volume *copy) {
  glDeleteTextures(1, &copy->texture);
  memset(copy, 0, sizeof *copy);
}

/* Makes *copy; on failure it is empty, and *error holds the driver's error. */
static bool make_volume(tc_gl_volume *copy, const tc_volume *volume, const int size[3], GError **error) {
  const tc_volume_desc *desc = tc_volume_describe(volume);
  const texel_format *format = &formats[desc->type];
  for (int k = 0; k < 3; k++) copy->texel[k] = 1.0f / (float)size[k];
  copy->bytes = tc_volume_bytes(volume);
  tc_gl_forget_errors();
  glCreateTextures(GL_TEXTURE_2D_ARRAY, 1, &copy->texture);
  glTextureStorage3D(copy->texture, 1, format->internal, size[0], size[1], size[2]);
  bool good = tc_gl_check("volume texture", error);
  if (good) {
    set_sampling(copy->texture);
    upload(copy, volume, format);
    good = tc_gl_check("volume upload", error); /* some drivers allocate only when texels arrive */
  }
  if (!good) glDeleteTextures(1, &copy->texture);
  return good;
}

/* Frees least recently used volumes, except the current frame's, until `bytes` more fit the budget; returns a free
 * entry. */
static tc_gl_volume *make_room(tc_gl_textures *textures, size_t bytes) {
  for (;;) {
    tc_gl_volume *unused = NULL, *oldest = NULL;
    size_t held = 0;
    for (int i = 0; i < TC_GL_VOLUMES; i++) {
      tc_gl_volume *copy = &textures->volumes[i];
      held += copy->bytes;
      if (!copy->texture)
        unused = copy;
      else if (copy->used < textures->frame && (!oldest || copy->used < oldest->used))
        oldest = copy;
    }
    if (unused && (!oldest || (bytes <= textures->volume_budget && held <= textures->volume_budget - bytes)))
      return unused;
    drop_volume(textures, oldest);
  }
}

static bool is_memory_error(const GError *error) { return g_error_matches(error, TC_ERROR, TC_ERROR_MEMORY); }

/* Reports a volume that fits no texture of this device, and how to fix that. */
static void say_too_large(const tc_volume *volume, const char *why, GError **error) {
  const int *dims = tc_volume_describe(volume)->dims;
  tc_set_error(error, TC_ERROR_LIMIT, NULL,
               "gl: a volume of %dx%dx%d (%zu MiB) does not fit one texture of this device (%s); "
               "use --backend cpu",
               dims[0], dims[1], dims[2], tc_volume_bytes(volume) >> 20, why);
}

static const tc_gl_volume *upload_volume(tc_gl_textures *textures, const tc_volume *volume, GError **error) {
  const tc_volume_desc *desc = tc_volume_describe(volume);
  int size[3], slices_per_layer;
  if (!texture_size(desc, size, &slices_per_layer)) {
    say_too_large(volume, "sides", error);
    return NULL;
  }
  GError *failure = NULL;
  for (int attempt = 0; attempt < 2; attempt++) {
    if (attempt > 0) { /* second attempt, with nothing else resident */
      g_clear_error(&failure);
      for (int i = 0; i < TC_GL_VOLUMES; i++)
        if (textures->volumes[i].used < textures->frame) drop_volume(textures, &textures->volumes[i]);
      glFinish();
    }
    tc_gl_volume *place = make_room(textures, tc_volume_bytes(volume));
    tc_gl_volume copy = {
        .serial = tc_volume_serial(volume), .slices_per_layer = slices_per_layer, .used = textures->frame};
    if (make_volume(&copy, volume, size, &failure)) {
      *place = copy;
      return place;
    }
    if (!is_memory_error(failure)) break;
  }
  if (is_memory_error(failure)) {
    g_clear_error(&failure);
    say_too_large(volume, "memory", error);
  } else {
    g_propagate_error(error, failure);
  }
  return NULL;
}

void tc_gl_textures_begin(tc_gl_textures *textures) { textures->frame++; }

bool tc_gl_textures_want(const tc_gl_textures *textures, const tc_volume *volume) {
  int size[3], slices_per_layer;
  for (int i = 0; i < TC_GL_VOLUMES; i++)
    if (textures->volumes[i].texture && textures->volumes[i].serial == tc_volume_serial(volume)) return false;
  return texture_size(tc_volume_describe(volume), size, &slices_per_layer);
}

const tc_gl_volume *tc_gl_textures_volume(tc_gl_textures *textures, const tc_volume *volume, GError **error) {
  for (int i = 0; i < TC_GL_VOLUMES; i++) {
    tc_gl_volume *copy = &textures->volumes[i];
    if (!copy->texture || copy->serial != tc_volume_serial(volume)) continue;
    copy->used = textures->frame;
    return copy;
  }
  return upload_volume(textures, volume, error);
}

/* ---- lookups ---- */

static void drop_lookup(tc_gl_lookup *copy) {
  if (copy->memory) glFinish();
  glDeleteTextures(1, &copy->texture);
  glDeleteBuffers(1, &copy->buffer);
  if (copy->memory) munmap(copy->memory, copy->bytes);
  memset(copy, 0, sizeof *copy);
}

/* As make_room(), for lookups. A frame uses fewer lookups than there are entries. */
static tc_gl_lookup *make_lookup_room(tc_gl_textures *textures, size_t bytes) {
  for (;;) {
    tc_gl_lookup *unused = NULL, *oldest = NULL;
    size_t held = 0;
    for (int i = 0; i < TC_GL_LOOKUPS; i++) {
      tc_gl_lookup *copy = &textures->lookups[i];
      held += copy->bytes;
      if (!copy->buffer)
        unused = copy;
      else if (copy->used < textures->frame && (!oldest || copy->used < oldest->used))
        oldest = copy;
    }
    if (unused && (!oldest || (bytes <= textures->lookup_budget && held <= textures->lookup_budget - bytes)))
      return unused;
    drop_lookup(oldest);
  }
}

static tc_gl_lookup *find_lookup(tc_gl_textures *textures, const uint64_t key[5]) {
  for (int i = 0; i < TC_GL_LOOKUPS; i++) {
    tc_gl_lookup *copy = &textures->lookups[i];
    if (!copy->buffer || memcmp(copy->key, key, sizeof copy->key) != 0) continue;
    copy->used = textures->frame;
    return copy;
  }
  return NULL;
}

typedef struct lookup_source {
  const char *what;
  const void *entries; /* NULL: to be filled by the builder */
  size_t count, entry_bytes;
  GLenum format;
} lookup_source;

/* Creates the buffer. With software OpenGL, a large buffer is backed by our own memory. */
static void make_buffer(const tc_gl_textures *textures, tc_gl_lookup *copy) {
  const GLenum pinned = GL_EXTERNAL_VIRTUAL_MEMORY_BUFFER_AMD;
  glCreateBuffers(1, &copy->buffer);
  if (textures->pins && copy->bytes > PINNED_BYTES) {
    void *memory = mmap(NULL, copy->bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED) memory = NULL;
    glBindBuffer(pinned, copy->buffer);
    if (memory) glBufferData(pinned, (GLsizeiptr)copy->bytes, memory, GL_DYNAMIC_DRAW);
    glBindBuffer(pinned, 0);
    if (memory && glGetError() == GL_NO_ERROR) {
      copy->memory = memory;
      return;
    }
    if (memory) munmap(memory, copy->bytes);
  }
  glNamedBufferStorage(copy->buffer, (GLsizeiptr)copy->bytes, NULL, GL_DYNAMIC_STORAGE_BIT);
}

/* False: halted. */
static bool upload_entries(const tc_gl_lookup *copy, const uint8_t *entries, const tc_halt *halt) {
  for (size_t at = 0; at < copy->bytes; at += POLL_BYTES) {
    const size_t n = MIN(POLL_BYTES, copy->bytes - at);
    if (at > 0 && tc_halt_within(halt)) return false;
    if (copy->memory)
      memcpy((uint8_t *)copy->memory + at, entries + at, n);
    else
      glNamedBufferSubData(copy->buffer, (GLintptr)at, (GLsizeiptr)n, entries + at);
  }
  return true;
}

static tc_gl_lookup *lookup(tc_gl_textures *textures, const uint64_t key[5], const lookup_source *from,
                            const tc_halt *halt, GError **error) {
  tc_gl_lookup *copy = find_lookup(textures, key);
  if (copy) return copy;
  GLint most = 0;
  glGetIntegerv(GL_MAX_TEXTURE_BUFFER_SIZE, &most);
  if (from->count > (size_t)most) {
    tc_set_error(error, TC_ERROR_LIMIT, NULL,
                 "gl: %s of %zu entries does not fit a buffer texture of this device (%d); "
                 "use --backend cpu",
                 from->what, from->count, most);
    return NULL;
  }
  copy = make_lookup_room(textures, from->count * from->entry_bytes);
  copy->bytes = from->count * from->entry_bytes;
  tc_gl_forget_errors();
  make_buffer(textures, copy);
  const bool whole = !from->entries || upload_entries(copy, from->entries, halt);
  glCreateTextures(GL_TEXTURE_BUFFER, 1, &copy->texture);
  glTextureBuffer(copy->texture, from->format, copy->buffer);
  if (!(whole || tc_halt_say(halt, error)) || !tc_gl_check(from->what, error)) {
    drop_lookup(copy);
    return NULL;
  }
  memcpy(copy->key, key, sizeof copy->key);
  copy->used = textures->frame;
  return copy;
}

const tc_gl_lookup *tc_gl_textures_table(tc_gl_textures *textures, const tc_gl_builder *builder, const tc_table *table,
                                         double *ms, const tc_halt *halt, GError **error) {
  const uint64_t key[5] = {table->serial};
  const char *why;
  const bool own = tc_gl_builder_serves(builder, table->n, table->n_subtables, table->bits, &why);
  const lookup_source from = {.what = "pre-integration table",
                              .entries = own ? NULL : table->entries,
                              .entry_bytes = sizeof(float[4]),
                              .count = table->bytes / sizeof(float[4]),
                              .format = GL_RGBA32F};
  tc_gl_lookup *copy = find_lookup(textures, key);
  if (copy) return copy;
  const double start = tc_now_ms();
  copy = lookup(textures, key, &from, halt, error);
  if (!copy || !own) return copy;
  const bool built = tc_gl_builder_run(builder, table, copy->buffer, copy->texture, error);
  *ms += tc_now_ms() - start;
  if (built) return copy;
  drop_lookup(copy);
  return NULL;
}

const tc_gl_lookup *tc_gl_textures_integrals(tc_gl_textures *textures, const tc_integrals *integrals,
                                             const tc_halt *halt, GError **error) {
  const uint64_t key[5] = {0, 0, 0, 0, integrals->serial};
  const lookup_source from = {.what = "integrals",
                              .entries = integrals->entries,
                              .entry_bytes = sizeof(float[4]),
                              .count = integrals->count,
                              .format = GL_RGBA32F};
  return lookup(textures, key, &from, halt, error);
}

const tc_gl_lookup *tc_gl_textures_distance_map(tc_gl_textures *textures, const tc_volume *volume,
                                                const tc_distance_map *map, const tc_halt *halt, GError **error) {
  const uint64_t key[5] = {map->support, tc_volume_serial(volume), (uint64_t)map->block, (uint64_t)map->reach};
  const lookup_source from = {.what = "distance map",
                              .entries = map->distance,
                              .entry_bytes = 1,
                              .format = GL_R8UI,
                              .count = (size_t)map->blocks[0] * (size_t)map->blocks[1] * (size_t)map->blocks[2]};
  return lookup(textures, key, &from, halt, error);
}

const tc_gl_lookup *tc_gl_textures_bounds(tc_gl_textures *textures, const tc_volume *volume, const tc_bounds *bounds,
                                          const tc_halt *halt, GError **error) {
  const uint64_t key[5] = {0, tc_volume_serial(volume), (uint64_t)bounds->block, bounds->serial};
  const lookup_source from = {.what = "bounds of the blocks",
                              .entries = bounds->levels,
                              .entry_bytes = 1,
                              .format = GL_R8UI,
                              .count = bounds->bytes};
  return lookup(textures, key, &from, halt, error);
}

const tc_gl_lookup *tc_gl_textures_labels(tc_gl_textures *textures, const tc_volume *label_volume,
                                          const tc_labels *labels, const tc_halt *halt, GError **error) {
  const uint64_t key[5] = {0, tc_volume_serial(label_volume), 0, 0, labels->serial};
  const lookup_source from = {.what = "labels",
                              .entries = labels->entries,
                              .count = 2 * ((size_t)labels->n + 1),
                              .entry_bytes = sizeof(float[4]),
                              .format = GL_RGBA32F};
  return lookup(textures, key, &from, halt, error);
}

const tc_gl_lookup *tc_gl_textures_packed(tc_gl_textures *textures, const tc_gl_packing *packing, uint64_t serial,
                                          uint64_t volume_serial, const tc_halt *halt, GError **error) {
  const uint64_t key[5] = {0, volume_serial, UINT64_MAX, (uint64_t)(uintptr_t)packing->pack, serial};
  tc_gl_lookup *copy = find_lookup(textures, key);
  if (copy) return copy;
  const size_t bytes = packing->bytes(packing->thing);
  void *entries = g_try_malloc(bytes);
  const lookup_source from = {
      .what = packing->what, .entries = entries, .count = bytes / 16, .entry_bytes = 16, .format = GL_RGBA32UI};
  if (!entries)
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "gl: %s of %zu bytes: out of memory", packing->what, bytes);
  else if (!packing->pack(packing->thing, entries, halt))
    tc_halt_say(halt, error);
  else
    copy = lookup(textures, key, &from, halt, error);
  g_free(entries);
  return copy;
}

void tc_gl_textures_forget(tc_gl_textures *textures, uint64_t volume_serial) {
  for (int i = 0; i < TC_GL_VOLUMES; i++)
    if (textures->volumes[i].texture && textures->volumes[i].serial == volume_serial)
      drop_volume(textures, &textures->volumes[i]);
  for (int i = 0; i < TC_GL_LOOKUPS; i++)
    if (textures->lookups[i].buffer && textures->lookups[i].key[1] == volume_serial) drop_lookup(&textures->lookups[i]);
}

void tc_gl_textures_clear(tc_gl_textures *textures) {
  for (int i = 0; i < TC_GL_VOLUMES; i++) drop_volume(textures, &textures->volumes[i]);
  for (int i = 0; i < TC_GL_LOOKUPS; i++) drop_lookup(&textures->lookups[i]);
}
