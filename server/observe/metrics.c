#include "server/observe/metrics.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "server/observe/log.h"

static const double bounds[TCS_HISTOGRAM_BUCKETS] = {0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025,
                                                     0.05,   0.1,   0.25,   0.5,   1.0,  2.5};
static const double error_bounds[TCS_HISTOGRAM_BUCKETS] = {1e-6, 1e-5, 1e-4, 2.5e-4, 5e-4, 1e-3,
                                                           2e-3, 4e-3, 8e-3, 1.6e-2, 6e-2, 0.25};

static const double lag_bounds[TCS_HISTOGRAM_BUCKETS] = {0.0001, 0.00025, 0.0005, 0.001, 0.002, 0.003,
                                                         0.005,  0.0075,  0.01,   0.02,  0.05,  0.1};

static const char *const class_names[TCS_METRICS_CLASSES] = {"interactive", "single", "refine"}; /* schedule/fair.h */

void tcs_metrics_init(tcs_metrics *metrics) {
  memset(metrics, 0, sizeof *metrics);
  metrics->requests = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, g_free);
}

void tcs_metrics_clear(tcs_metrics *metrics) {
  if (metrics->requests) g_hash_table_destroy(metrics->requests);
  memset(metrics, 0, sizeof *metrics);
}

static void add_to(tcs_histogram *histogram, const double *edges, double amount) {
  int bucket = 0;
  while (bucket < TCS_HISTOGRAM_BUCKETS && amount > edges[bucket]) bucket++;
  histogram->counts[bucket]++;
  histogram->sum += amount;
}

void tcs_histogram_add(tcs_histogram *histogram, double seconds) { add_to(histogram, bounds, seconds); }
void tcs_histogram_add_error(tcs_histogram *histogram, double rms) { add_to(histogram, error_bounds, rms); }

void tcs_metrics_turn(tcs_metrics *metrics, double seconds, double cpu_seconds) {
  add_to(&metrics->lag, lag_bounds, seconds);
  add_to(&metrics->turn_cpu, lag_bounds, cpu_seconds);
  metrics->lag_max = MAX(metrics->lag_max, seconds);
  metrics->turn_cpu_max = MAX(metrics->turn_cpu_max, cpu_seconds);
}

void tcs_metrics_request(tcs_metrics *metrics, const char *method, const char *route, int status, double seconds) {
  char key[160];
  snprintf(key, sizeof key, "method=\"%s\",route=\"%s\",code=\"%d\"", method, route, status);
  uint64_t *count = g_hash_table_lookup(metrics->requests, key);
  if (!count) {
    count = g_new0(uint64_t, 1);
    g_hash_table_insert(metrics->requests, g_strdup(key), count);
  }
  (*count)++;
  tcs_histogram_add(&metrics->request, seconds);
}

static void head(GString *out, const char *name, const char *type, const char *help) {
  g_string_append_printf(out, "# HELP tomocast_%s %s\n# TYPE tomocast_%s %s\n", name, help, name, type);
}

static void counter(GString *out, const char *name, const char *help, uint64_t value) {
  head(out, name, "counter", help);
  g_string_append_printf(out, "tomocast_%s %" G_GUINT64_FORMAT "\n", name, value);
}

static void gauge(GString *out, const char *name, const char *help, double value) {
  head(out, name, "gauge", help);
  g_string_append_printf(out, "tomocast_%s %.17g\n", name, value);
}

static void histogram_of(GString *out, const char *name, const char *help, const tcs_histogram *h,
                         const double *edges) {
  head(out, name, "histogram", help);
  uint64_t total = 0;
  for (int i = 0; i < TCS_HISTOGRAM_BUCKETS; i++) {
    total += h->counts[i];
    g_string_append_printf(out, "tomocast_%s_bucket{le=\"%g\"} %" G_GUINT64_FORMAT "\n", name, edges[i], total);
  }
  total += h->counts[TCS_HISTOGRAM_BUCKETS];
  g_string_append_printf(out, "tomocast_%s_bucket{le=\"+Inf\"} %" G_GUINT64_FORMAT "\n", name, total);
  g_string_append_printf(out, "tomocast_%s_sum %.9g\ntomocast_%s_count %" G_GUINT64_FORMAT "\n", name, h->sum, name,
                         total);
}

static void histogram(GString *out, const char *name, const char *help, const tcs_histogram *h) {
  histogram_of(out, name, help, h, bounds);
}

uint64_t tcs_metrics_resident_bytes(void) {
  unsigned long total = 0, resident = 0;
  FILE *file = fopen("/proc/self/statm", "re");
  if (!file) return 0;
  if (fscanf(file, "%lu %lu", &total, &resident) != 2) resident = 0;
  fclose(file);
  return (uint64_t)resident * (uint64_t)sysconf(_SC_PAGE_SIZE);
}

static void requests(GString *out, const tcs_metrics *metrics) {
  head(out, "http_requests_total", "counter", "Requests answered, by method, route and status.");
  GHashTableIter iterator;
  void *key, *value;
  g_hash_table_iter_init(&iterator, metrics->requests);
  while (g_hash_table_iter_next(&iterator, &key, &value))
    g_string_append_printf(out, "tomocast_http_requests_total{%s} %" G_GUINT64_FORMAT "\n", (const char *)key,
                           *(const uint64_t *)value);
}

/* Metrics of the event loop and of the log. */
static void loop_and_log(GString *out, tcs_metrics *m) {
  histogram_of(out, "loop_lag_seconds", "Turns of the I/O thread: from its wake-up to its return to waiting.", &m->lag,
               lag_bounds);
  histogram_of(out, "loop_turn_cpu_seconds", "Processor time of these turns.", &m->turn_cpu, lag_bounds);
  gauge(out, "loop_lag_max_seconds", "The longest turn since the last scrape.", m->lag_max);
  gauge(out, "loop_turn_cpu_max_seconds", "The most processor time of a turn since the last scrape.", m->turn_cpu_max);
  m->lag_max = m->turn_cpu_max = 0;
  counter(out, "log_dropped_total", "Log lines dropped because the buffer was full.", tcs_log_dropped());
}

static void class_counter(GString *out, const tcs_metrics *m, const char *name, const char *help, size_t offset) {
  head(out, name, "counter", help);
  for (int i = 0; i < TCS_METRICS_CLASSES; i++) {
    const uint64_t *value = (const uint64_t *)(const void *)((const char *)&m->classes[i] + offset);
    g_string_append_printf(out, "tomocast_%s{class=\"%s\"} %" G_GUINT64_FORMAT "\n", name, class_names[i], *value);
  }
}

static void class_queue(GString *out, const char *class, const tcs_histogram *h) {
  uint64_t total = 0;
  for (int i = 0; i <= TCS_HISTOGRAM_BUCKETS; i++) {
    char edge[16] = "+Inf";
    if (i < TCS_HISTOGRAM_BUCKETS) snprintf(edge, sizeof edge, "%g", bounds[i]);
    total += h->counts[i];
    g_string_append_printf(out, "tomocast_class_queue_seconds_bucket{class=\"%s\",le=\"%s\"} %" G_GUINT64_FORMAT "\n",
                           class, edge, total);
  }
  g_string_append_printf(out,
                         "tomocast_class_queue_seconds_sum{class=\"%s\"} %.9g\n"
                         "tomocast_class_queue_seconds_count{class=\"%s\"} %" G_GUINT64_FORMAT "\n",
                         class, h->sum, class, total);
}

static void classes(GString *out, const tcs_metrics *m) {
  head(out, "class_queue_seconds", "histogram", "How long a picture waited for its first slice, by class.");
  for (int i = 0; i < TCS_METRICS_CLASSES; i++) class_queue(out, class_names[i], &m->classes[i].queue);
  head(out, "class_render_seconds_total", "counter", "Time of the renderer, by class.");
  for (int i = 0; i < TCS_METRICS_CLASSES; i++)
    g_string_append_printf(out, "tomocast_class_render_seconds_total{class=\"%s\"} %.9g\n", class_names[i],
                           m->classes[i].seconds);
  class_counter(out, m, "slices_total", "Slices of render time.", offsetof(tcs_class_metrics, slices));
  class_counter(out, m, "pauses_total", "Slices that ended before their picture.", offsetof(tcs_class_metrics, pauses));
  class_counter(out, m, "preemptions_total", "Pauses in favour of a class of higher priority.",
                offsetof(tcs_class_metrics, preempted));
}

static void memory(GString *out, const tcs_gauges *gauges) {
  head(out, "memory_bytes", "gauge", "Memory in use, by kind.");
  for (size_t i = 0; i < G_N_ELEMENTS(gauges->memory) && gauges->memory[i].kind; i++)
    g_string_append_printf(out, "tomocast_memory_bytes{kind=\"%s\"} %" G_GUINT64_FORMAT "\n", gauges->memory[i].kind,
                           gauges->memory[i].bytes);
  gauge(out, "memory_budget_bytes", "Memory budget.", (double)gauges->memory_total);
}

char *tcs_metrics_write(tcs_metrics *m, const tcs_gauges *gauges, const char *backend) {
  GString *out = g_string_sized_new(8192);
  head(out, "build_info", "gauge", "Version and back end; always 1.");
  g_string_append_printf(out, "tomocast_build_info{version=\"%s\",backend=\"%s\"} 1\n", TC_VERSION, backend);
  requests(out, m);
  histogram(out, "http_request_seconds", "From the first byte of a request to its reply.", &m->request);
  histogram(out, "queue_seconds", "How long a picture waited for the renderer.", &m->queue);
  histogram(out, "tables_seconds", "Building of classification tables, per frame.", &m->tables);
  histogram(out, "skip_seconds", "Building of the skipping structure, per frame.", &m->skip);
  histogram(out, "render_seconds", "Rendering, per frame.", &m->render);
  histogram(out, "encode_seconds", "Encoding, per frame.", &m->encode);
  classes(out, m);
  histogram_of(out, "frame_error_rms", "Error of measured frames against the reference, colour 0..1.", &m->error,
               error_bounds);
  counter(out, "meter_pixels_total", "Pixels integrated by the error meter.", m->meter_pixels);
  counter(out, "meter_cancelled_total", "Measurements cancelled by a newer frame.", m->meter_cancelled);
  counter(out, "quality_measurements_total", "Views measured for models of the error.", m->quality_measurements);
  head(out, "meter_seconds_total", "counter", "Time that the error meter took, off the render path.");
  g_string_append_printf(out, "tomocast_meter_seconds_total %.9g\n", m->meter_seconds);
  counter(out, "frames_sent_total", "Frames sent to viewers.", m->frames_sent);
  head(out, "frames_dropped_total", "counter", "Scenes that were never shown, by reason.");
  g_string_append_printf(out,
                         "tomocast_frames_dropped_total{reason=\"superseded\"} %" G_GUINT64_FORMAT
                         "\ntomocast_frames_dropped_total{reason=\"cancelled\"} %" G_GUINT64_FORMAT "\n",
                         m->frames_superseded, m->frames_cancelled);
  counter(out, "render_failures_total", "Frames that could not be rendered or encoded.", m->render_failures);
  counter(out, "ws_connections_total", "WebSocket connections accepted.", m->ws_connections);
  counter(out, "ws_messages_total", "Messages received.", m->ws_messages);
  counter(out, "ws_errors_total", "Messages answered with an error.", m->ws_errors);
  counter(out, "ws_sent_bytes_total", "Payload bytes sent to WebSocket viewers.", m->ws_sent_bytes);
  counter(out, "patches_total", "Patches applied to scenes.", m->patches);
  counter(out, "scene_changes_total", "Changes of scenes, one for all patches of a turn.", m->scene_changes);
  counter(out, "uploads_total", "Volumes uploaded completely.", m->uploads);
  counter(out, "upload_bytes_total", "Bytes received in uploads.", m->upload_bytes);
  counter(out, "volume_loads_total", "Volumes loaded.", m->volume_loads);
  counter(out, "volume_failures_total", "Volumes that could not be loaded.", m->volume_failures);
  counter(out, "volume_drops_total", "Volumes dropped to make room for others.", m->volume_drops);
  gauge(out, "ws_clients", "WebSocket viewers connected.", gauges->ws_clients);
  gauge(out, "mjpeg_clients", "MJPEG viewers connected.", gauges->mjpeg_clients);
  gauge(out, "sessions", "Sessions open.", gauges->sessions);
  gauge(out, "volumes_resident", "Volumes in memory.", gauges->volumes_resident);
  gauge(out, "meshes_resident", "Meshes in memory.", gauges->meshes_resident);
  gauge(out, "volumes_loading", "Volumes being loaded.", gauges->volumes_loading);
  gauge(out, "volume_resident_bytes", "Voxel bytes in memory.", (double)gauges->volume_bytes);
  gauge(out, "render_queue_length", "Stateless renders waiting.", gauges->queued);
  head(out, "work_queue_length", "gauge", "Requests for rays and picks that wait for a worker.");
  g_string_append_printf(out,
                         "tomocast_work_queue_length{worker=\"probe\"} %d\ntomocast_work_queue_length{worker=\"walk\"} "
                         "%d\ntomocast_work_queue_length{worker=\"text\"} %d\n",
                         gauges->probes, gauges->walks, gauges->texts);
  counter(out, "work_dropped_total", "Requests for rays and picks dropped because their client left before they began.", m->works_dropped);
  loop_and_log(out, m);
  memory(out, gauges);
  gauge(out, "process_resident_memory_bytes", "Resident set size of the process.",
        (double)tcs_metrics_resident_bytes());
  return g_string_free(out, FALSE);
}
