// Decodes layers of voxels on several threads and sends them in order.
#include <sched.h>

#include <algorithm>
#include <cstring>
#include <exception>
#include <functional>
#include <memory>
#include <system_error>
#include <thread>

#include "renderer/import/helper/dicom_volume.h"

namespace dicom {

void begin(const Run &run, const Job &job) {
  GError *error = nullptr;
  check_size(job, run.order.max_voxel_bytes);
  if (!run.order.begin(run.order.user, &job.desc, &job.from, &error)) fail_with(error);
}

void put_layer(const Run &run, const std::vector<uint8_t> &layer) {
  GError *error = nullptr;
  if (!tc_order_put(&run.order, layer.data(), layer.size(), &error)) fail_with(error);
}

// Fills one layer from the items [from, to) of the stack; layers without a frame (segmentations only) are empty.
static void make_layer(Job &job, Decoder &decoder, size_t from, size_t to, uint8_t *layer) {
  if (job.labels) {
    std::vector<uint16_t> labels;
    stamp_layer(job, decoder, from, to, labels);
    put_labels(job, labels, layer);
    return;
  }
  memset(layer, 0, layer_bytes(job));
  for (size_t item = from; item < to; item++) {
    const Member &m = job.at(item);
    tc_dicom_target target{};
    target.type = job.desc.type;
    target.rescale = job.rescale;
    target.slope = m.scale.slope;
    target.intercept = m.scale.intercept;
    Frame f = decoder.frame(*m.picture, m.frame);
    if (job.colors) {
      if (!tc_dicom_colors(&f, layer)) fail(TC_ERROR_FORMAT, "pixel data of a picture is cut");
      continue;
    }
    if (!tc_dicom_convert(&f, &target, layer))
      fail(TC_ERROR_FORMAT, "pixel data of slice %u of %d is cut", job.stack.items[item].layer + 1, job.desc.dims[2]);
    if (m.picture->label_map && m.picture->background) clear_background(job, m.picture->background, layer);
  }
}

namespace {
// State of one thread: a decoder, a layer, and an error.
struct Worker {
  explicit Worker(const Run &run, size_t bytes) : decoder(run.sources), layer(bytes) {}
  Decoder decoder;
  std::vector<uint8_t> layer;
  std::exception_ptr trouble;
  void run(Job &job, size_t from, size_t to) {
    trouble = nullptr;
    try {
      make_layer(job, decoder, from, to, layer.data());
    } catch (...) {
      trouble = std::current_exception();
    }
  }
};
} // namespace

// Several threads pay off for compressed slices in separate files; uncompressed slices are read faster than sent.
static size_t count_workers(const Job &job) {
  cpu_set_t cpus;
  if (job.labels || job.first().native || job.first().frames > 1 || sched_getaffinity(0, sizeof cpus, &cpus) != 0)
    return 1;
  return std::min({size_t(CPU_COUNT(&cpus)), size_t(8), size_t(job.desc.dims[2])});
}

// False if no thread could be created; the caller then does the work itself.
static bool start(std::vector<std::thread> &threads, Worker &worker, Job &job, size_t from, size_t to) {
  try {
    threads.emplace_back(&Worker::run, &worker, std::ref(job), from, to);
    return true;
  } catch (const std::system_error &) {
    return false;
  }
}

// Decodes one layer per worker at a time and sends them in order.
static void send_voxels(const Run &run, Job &job) {
  std::vector<std::unique_ptr<Worker>> workers;
  size_t layers = size_t(job.desc.dims[2]), count = count_workers(job), item = 0;
  for (size_t i = 0; i < count; i++)
    workers.emplace_back(new Worker(run, layer_bytes(job)));
  for (size_t z = 0; z < layers; z += count) {
    std::vector<std::thread> threads;
    size_t batch = std::min(count, layers - z);
    for (size_t i = 0; i < batch; i++) {
      size_t from = item;
      while (item < job.stack.count && job.stack.items[item].layer == z + i)
        item++;
      if (count == 1 || !start(threads, *workers[i], job, from, item)) workers[i]->run(job, from, item);
    }
    for (std::thread &t : threads)
      t.join();
    for (size_t i = 0; i < batch; i++) {
      if (workers[i]->trouble) std::rethrow_exception(workers[i]->trouble);
      put_layer(run, workers[i]->layer);
      progress(run, 0.2 + 0.8 * double(z + i + 1) / double(layers));
    }
  }
}

// Sends layers interpolated from the two nearest slices; each slice is decoded once, in order.
static void send_mixed(const Run &run, Job &job) {
  const size_t bytes = layer_bytes(job),
               count = size_t(job.desc.dims[0]) * size_t(job.desc.dims[1]) * (job.colors ? 3 : 1);
  Decoder decoder(run.sources);
  std::vector<uint8_t> below(bytes), above(bytes), out(bytes);
  size_t held = 0; // index of the slice in `below`; `above` holds the next
  make_layer(job, decoder, 0, 1, below.data());
  make_layer(job, decoder, 1, 2, above.data());
  for (int z = 0; z < job.desc.dims[2]; z++) {
    for (; held < job.stack.mix[z].item; held++) {
      below.swap(above);
      make_layer(job, decoder, held + 2, held + 3, above.data());
    }
    tc_dicom_mix_layers(job.desc.type, below.data(), above.data(), job.stack.mix[z].part, count, out.data());
    put_layer(run, out);
    progress(run, 0.2 + 0.8 * double(z + 1) / double(job.desc.dims[2]));
  }
}

void send_layers(const Run &run, Job &job) { job.stack.mix ? send_mixed(run, job) : send_voxels(run, job); }

} // namespace dicom
