#include "build_binding.h"

#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <filesystem>
#include <map>

namespace nb = nanobind;

namespace isobrick::python {
namespace {

format::Codec codecNamed(const std::string& name) {
  if (name == "none") return format::Codec::kStored;
  if (name == "lz4") return format::Codec::kLz4;
  if (name == "zstd") return format::Codec::kZstd;
  throw Error("the codec '" + name + "' is not known; choose 'none', 'lz4' or 'zstd'");
}

format::Filter filterNamed(const std::string& name) {
  if (name == "average") return format::Filter::kAverage;
  if (name == "subsample") return format::Filter::kSubsample;
  throw Error("the filter '" + name + "' is not known; choose 'average' or 'subsample'");
}

void refuseReplacing(const BuildRequest& request) {
  if (!request.force && std::filesystem::exists(request.out))
    throw Error("'" + request.out + "' exists; give force=True to replace it",
                {.path = request.out});
}

void refuseReplacingInput(const VolumeSource& source, const std::string& out) {
  for (const std::string& file : source.files()) {
    std::error_code ignored;
    if (std::filesystem::equivalent(file, out, ignored))
      throw Error("'" + out + "' is the input; choose another output", {.path = out});
  }
}

}  // namespace

BuildRequest readBuildRequest(const nb::object& settings) {
  BuildRequest request;
  request.out = nb::cast<std::string>(settings.attr("out"));
  request.force = nb::cast<bool>(settings.attr("force"));
  BuildOptions& options = request.options;
  options.codec = codecNamed(nb::cast<std::string>(settings.attr("codec")));
  options.filter = filterNamed(nb::cast<std::string>(settings.attr("filter")));
  options.with_curvature = nb::cast<bool>(settings.attr("with_curvature"));
  options.brick_cells = nb::cast<std::int64_t>(settings.attr("brick_cells"));
  options.nan_as = nb::cast<std::optional<float>>(settings.attr("nan_as"));
  options.memory_bytes = nb::cast<std::uint64_t>(settings.attr("memory_bytes"));
  options.tool_version = nb::cast<std::string>(settings.attr("tool_version"));
  options.keep_unfinished = false;
  request.call.progress = settings.attr("progress");
  request.call.threads = nb::cast<int>(settings.attr("threads"));
  request.call.cancel = nb::cast<const CancelRequest*>(settings.attr("cancel"));
  return request;
}

nb::object buildFrom(const std::function<std::unique_ptr<VolumeSource>(CallState&)>& open,
                     const BuildRequest& request) {
  refuseReplacing(request);
  BuildReport report;
  std::vector<std::string> notes;
  VolumeInfo info;
  runInterruptibly(request.call, [&](CallState& state) {
    BuildOptions options = request.options;
    options.cancel = &state.cancel();
    options.progress = [&](std::string_view phase, double fraction) {
      state.report(phase, fraction);
    };
    const std::unique_ptr<VolumeSource> source = open(state);
    refuseReplacingInput(*source, request.out);
    report = buildPyramid(*source, request.out, options);
    info = source->info();
    notes = info.notes;
    for (std::string& note : source->notesOfReading()) notes.push_back(std::move(note));
  });
  std::map<std::string, double> busy;
  for (const BuildPhase& phase : report.phases) busy[phase.name] = phase.busy_seconds;
  nb::dict result;
  result["seconds"] = report.seconds;
  result["busy_seconds"] = busy;
  result["file_bytes"] = report.file_bytes;
  result["bricks"] = report.bricks;
  result["replaced_voxels"] = report.replaced_voxels;
  result["notes"] = notes;
  return result;
}

}  // namespace isobrick::python
