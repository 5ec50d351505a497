// Reads DICOM with GDCM, which is C++, as are this reader's files. Input files are hostile, and in the worst case
// this process is, too: the daemon validates every message (wire.h). Two passes: the headers of all files give the
// list of series (dicom_picture.h, dicom_series.h) and the geometry of the chosen series (dicom_volume.h); then the
// pictures are decoded in order (dicom_decoder.h).
#include <new>

#include <gdcmTrace.h>

#include "renderer/import/helper/dicom_volume.h"
#include "renderer/import/helper/stack.h"
#include "renderer/import/helper/zipped.h"

namespace dicom {

static void load(const Run &run, const std::string &wanted, bool bridge_nothing) {
  std::vector<Series> all = series_of(run);
  const Choice choice = read_choice(wanted);
  const Series &series = choose_series(all, choice.series);
  Job job;
  if (series.frames == 0) return load_structures(run, all, *series.pictures[0], job);
  make_stack(series, choice, bridge_nothing, job);
  if (all.size() > 1 && choice.series.empty()) tc_dicom_note(job.desc.note, "the largest of %zu series", all.size());
  apply_suv(job);
  choose_type(job, run);
  describe(job, run);
  begin(run, job);
  send_segments(run, job, job.first());
  send_layers(run, job);
}

static Failure decode(int input, const tc_helper_request &request, const tc_order &order) {
  try {
    Run run(order, request);
    GError *error = nullptr;
    scan(run, input);
    if (run.pictures.empty()) { // PNG or TIFF, or a volume of another format in a zip
      const auto read = tc_stack_is(&run.sources) ? tc_stack_read : tc_zipped_read;
      if (!request.list && !read(&run.sources, request.choice, &order, &error)) fail_with(error);
    } else if (request.list)
      list(run);
    else
      load(run, request.choice, request.bridge_nothing);
    return Failure{TC_ERROR_CODE_COUNT, ""};
  } catch (const Failure &f) {
    return f;
  } catch (const std::bad_alloc &) {
    return Failure{TC_ERROR_FORMAT, "the DICOM file announces more data than it can hold, or is too large to decode"};
  } catch (...) { // an exception of GDCM; its text may quote the file
    return Failure{TC_ERROR_FORMAT, "the DICOM file is damaged"};
  }
}

} // namespace dicom

bool tc_helper_decode(int input, const tc_helper_request *request, const tc_order *order, GError **error) {
  gdcm::Trace::DebugOff();
  gdcm::Trace::WarningOff();
  gdcm::Trace::ErrorOff();
  const dicom::Failure failure = dicom::decode(input, *request, *order);
  if (!failure.text[0]) return true;
  g_set_error_literal(error, TC_ERROR, failure.code, failure.text);
  return false;
}
