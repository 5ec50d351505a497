#include "renderer/import/helper/dicom_series.h"

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <tuple>

#include "renderer/import/helper/stack.h"
#include "renderer/import/helper/zipped.h"

namespace dicom {

void progress(const Run &run, double fraction) {
  GError *error = nullptr;
  if (!run.order.goes_on(run.order.user, std::min(fraction, 1.0), &error)) fail_with(error);
}

// Reads one source's header into the run. A bad file among many is counted; a single bad file is the error.
static void scan_one(Run &run, size_t i) {
  tc_dicom_blob blob{};
  GError *error = nullptr;
  Picture *p = new Picture();
  try {
    if (!tc_dicom_sources_get(&run.sources, i, &blob, &error)) {
      if (error) fail_with(error);
    } else if (read_picture(blob, i, run.request.patient, *p)) {
      run.pictures.push_back(p);
      p = nullptr;
    }
  } catch (const Failure &) {
    run.unreadable++;
    if (run.sources.count == 1) throw;
  } catch (const std::exception &) {
    run.unreadable++;
    if (run.sources.count == 1) fail(TC_ERROR_FORMAT, "the DICOM header is damaged");
  }
  set_allocation_cap(SIZE_MAX);
  tc_dicom_blob_finish(&blob);
  delete p;
}

void scan(Run &run, int input) {
  GError *error = nullptr;
  uint64_t frames = 0;
  if (!tc_dicom_sources_open(&run.sources, input, &error)) fail_with(error);
  for (size_t i = 0; i < run.sources.count; i++) {
    size_t before = run.pictures.size();
    scan_one(run, i);
    if (run.pictures.size() > before) frames += run.pictures.back()->frames;
    if (frames > FRAMES_MAX) fail(TC_ERROR_LIMIT, "more than %llu pictures", (unsigned long long)FRAMES_MAX);
    progress(run, 0.2 * double(i + 1) / double(run.sources.count));
  }
  if (!run.pictures.empty() || tc_stack_is(&run.sources) || tc_zipped_is(&run.sources)) return;
  if (run.sources.count == 1)
    fail(TC_ERROR_FORMAT, "no picture in this DICOM file; of a plan open the folder of the pictures");
  fail(TC_ERROR_FORMAT, "no DICOM pictures among %zu files (%zu unreadable)", run.sources.count, run.unreadable);
}

std::vector<Series> series_of(const Run &run) {
  std::map<std::tuple<int, std::string, size_t>, Series> sorted; // each structure set is a series
  std::map<std::string, int> numbers;                            // the number of a series is that of its first picture
  for (const Picture *p : run.pictures) {
    int number = numbers.emplace(p->series, p->series_number).first->second;
    Series &s = sorted[std::make_tuple(number, p->series, p->contours.empty() ? 0 : p->source + 1)];
    s.pictures.push_back(p);
    s.frames += p->frames;
  }
  std::vector<Series> out;
  for (auto &entry : sorted)
    out.push_back(entry.second);
  return out;
}

const Series &choose_series(const std::vector<Series> &all, const std::string &wanted) {
  if (wanted.empty()) {
    size_t best = 0;
    for (size_t i = 1; i < all.size(); i++)
      if (all[i].frames > all[best].frames) best = i;
    return all[best];
  }
  if (wanted.size() <= 6 && wanted.find_first_not_of("0123456789") == std::string::npos) {
    size_t number = strtoul(wanted.c_str(), nullptr, 10);
    if (number >= 1 && number <= all.size()) return all[number - 1];
  }
  for (const Series &s : all)
    if (s.pictures[0]->series == wanted) return s;
  fail(TC_ERROR_NOT_FOUND, "no such series; there %s %zu, choose by number (#1 ...) or UID",
       all.size() == 1 ? "is" : "are", all.size());
}

std::vector<tc_dicom_slice> slices_of(const Series &series) {
  std::vector<tc_dicom_slice> slices;
  for (const Picture *p : series.pictures)
    slices.insert(slices.end(), p->slices.begin(), p->slices.end());
  order_text_keys(slices);
  return slices;
}

void list(const Run &run) {
  size_t sent = 0;
  int number = 0;
  for (const Series &s : series_of(run)) {
    tc_series line{};
    const Picture &p = *s.pictures[0];
    snprintf(line.uid, sizeof line.uid, "%s", p.series.c_str());
    snprintf(line.modality, sizeof line.modality, "%s", p.modality.c_str());
    snprintf(line.label, sizeof line.label, "series %d", p.series_number);
    put_words(line.description, p.description);
    snprintf(line.time, sizeof line.time, "%s%s%s", p.day.c_str(), p.day.empty() ? "" : " ", p.time.c_str());
    put_words(line.patient, p.patient);
    line.number = ++number;
    line.files = static_cast<int>(s.pictures.size());
    line.frames = static_cast<int>(s.frames);
    line.rows = p.samples.rows;
    line.columns = p.samples.columns;
    line.volume = 1;
    if (s.frames == 0) { // a structure set
      snprintf(line.what, sizeof line.what, "%zu regions", p.segments.size());
      if (sent++ < TC_WIRE_SERIES_MAX && !tc_wire_send_series(TC_HELPER_SOCKET_FD, &line)) _exit(1);
      continue;
    }
    Volumes volumes(slices_of(s));
    for (size_t v = 0; v < volumes.count && sent < TC_WIRE_SERIES_MAX; v++, sent++) {
      line.volume = static_cast<int>(v + 1);
      line.slices = static_cast<int>(volumes.list[v].places);
      memcpy(line.what, volumes.list[v].what, sizeof line.what);
      if (!tc_wire_send_series(TC_HELPER_SOCKET_FD, &line)) _exit(1);
    }
  }
}

Choice read_choice(const std::string &text) {
  static const char mark[] = "volume=";
  Choice choice;
  size_t at = text.rfind(mark);
  if (at == std::string::npos || (at > 0 && text[at - 1] != '#')) {
    choice.series = text;
    return choice;
  }
  std::string number = text.substr(at + sizeof mark - 1);
  if (number.empty() || number.size() > 6 || number.find_first_not_of("0123456789") != std::string::npos ||
      number == "0")
    fail(TC_ERROR_INVALID, "#volume= wants the number of a volume, from 1");
  choice.volume = static_cast<unsigned>(strtoul(number.c_str(), nullptr, 10));
  choice.series = at > 0 ? text.substr(0, at - 1) : "";
  return choice;
}

} // namespace dicom
