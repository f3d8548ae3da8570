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

void refuseReplacingInput(const VolumeSource& source, const std::string& out) {
  for (const std::string& file : source.files()) {
    std::error_code ignored;
    if (std::filesystem::equivalent(file, out, ignored))
      throw Error("'" + out + "' is the input; choose another output", {.path = out});
  }
}

// False if the file is there already. One of another build is replaced only by force.
bool buildMissingSuperBrick(VolumeSource& source, const BuildRequest& request,
                            const BuildOptions& options, BuildReport& report) {
  const std::vector<SuperBrickFile> files = superBrickFiles(source.info(), options);
  const std::size_t number = *request.super_brick;
  if (number >= files.size())
    throw Error("there is no super-brick " + std::to_string(number) + "; there are " +
                std::to_string(files.size()));
  const std::string path = (std::filesystem::path(request.out) / files[number].name).string();
  const DividedFileState state = stateOfDividedFile(path, buildIdentity(source, options));
  if (state == DividedFileState::kBuilt && !request.force) return false;
  if (!request.force && state == DividedFileState::kOfAnotherBuild)
    throw Error("'" + path +
                    "' exists and was built of another input, or with other options; "
                    "give force=True to replace it",
                {.path = path});
  report = buildSuperBrick(source, request.out, number, options);
  return true;
}

}  // namespace

BuildRequest readBuildRequest(const nb::object& settings) {
  BuildRequest request;
  request.out = nb::cast<std::string>(settings.attr("out"));
  request.force = nb::cast<bool>(settings.attr("force"));
  request.index = nb::cast<bool>(settings.attr("index"));
  BuildOptions& options = request.options;
  options.codec = codecNamed(nb::cast<std::string>(settings.attr("codec")));
  options.filter = filterNamed(nb::cast<std::string>(settings.attr("filter")));
  options.with_curvature = nb::cast<bool>(settings.attr("with_curvature"));
  options.brick_cells = nb::cast<std::int64_t>(settings.attr("brick_cells"));
  options.mask_nan = nb::cast<bool>(settings.attr("mask_nan"));
  options.nan_as = nb::cast<std::optional<float>>(settings.attr("nan_as"));
  options.memory_bytes = nb::cast<std::uint64_t>(settings.attr("memory_bytes"));
  options.tool_version = nb::cast<std::string>(settings.attr("tool_version"));
  options.super_cells = nb::cast<std::int64_t>(settings.attr("super_cells"));
  request.super_brick = nb::cast<std::optional<std::size_t>>(settings.attr("super_brick"));
  options.keep_unfinished = request.super_brick.has_value();
  request.call.progress = settings.attr("progress");
  request.call.threads = nb::cast<int>(settings.attr("threads"));
  request.call.cancel = nb::cast<const CancelRequest*>(settings.attr("cancel"));
  return request;
}

Derivation readDerivation(const nb::object& from) {
  Derivation derivation;
  derivation.label = nb::cast<std::optional<std::uint64_t>>(from.attr("label"));
  derivation.denoise = nb::cast<double>(from.attr("denoise"));
  return derivation;
}

void refuseReplacing(const std::string& out, bool force) {
  std::error_code ignored;
  if (!force && std::filesystem::exists(out, ignored))
    throw Error("'" + out + "' exists; give force=True to replace it", {.path = out});
}

nb::object buildFrom(const std::function<std::unique_ptr<VolumeSource>(CallState&)>& open,
                     const BuildRequest& request) {
  if (!request.super_brick) refuseReplacing(request.out, request.force);
  BuildReport report;
  bool was_built = false;
  std::vector<std::string> notes;
  VolumeInfo info;
  runInterruptibly(request.call, [&](CallState& state) {
    const std::unique_ptr<VolumeSource> source = open(state);
    BuildOptions options = request.options;  // of an index, which open() completes
    options.cancel = &state.cancel();
    options.progress = [&](std::string_view phase, double fraction) {
      state.report(phase, fraction);
    };
    refuseReplacingInput(*source, request.out);
    if (request.super_brick)
      was_built = buildMissingSuperBrick(*source, request, options, report);
    else
      report = buildPyramid(*source, request.out, options);
    info = source->info();
    notes = info.notes;
    if (options.with_curvature && !report.has_curvature && !request.super_brick)
      notes.push_back(noteOfNoCurvature());
    for (std::string& note : source->notesOfReading()) notes.push_back(std::move(note));
  });
  std::map<std::string, double> busy;
  for (const BuildPhase& phase : report.phases) busy[phase.name] = phase.busy_seconds;
  nb::dict result;
  result["was_built"] = was_built;
  result["seconds"] = report.seconds;
  result["busy_seconds"] = busy;
  result["file_bytes"] = report.file_bytes;
  result["bricks"] = report.bricks;
  result["replaced_voxels"] = report.replaced_voxels;
  result["missing_voxels"] = report.missing_voxels;
  result["notes"] = notes;
  return result;
}

nb::list superBricks(const VolumeInfo& info, const BuildRequest& request) {
  nb::list result;
  for (const SuperBrickFile& file : superBrickFiles(info, request.options)) {
    const auto& [first, count] = file.voxels;
    result.append(nb::make_tuple(file.name, nb::make_tuple(first.x, first.y, first.z),
                                 nb::make_tuple(count.x, count.y, count.z)));
  }
  return result;
}

void bindJoin(nb::module_& module) {
  module.def(
      "join",
      [](const std::string& folder, std::uint64_t memory_bytes, int threads,
         const nb::object& progress, const CancelRequest* cancel) {
        JoinReport report;
        runInterruptibly({progress, threads, cancel}, [&](CallState& state) {
          JoinOptions options;
          options.memory_bytes = memory_bytes;
          options.cancel = &state.cancel();
          options.progress = [&](std::string_view phase, double fraction) {
            state.report(phase, fraction);
          };
          report = joinPyramid(folder, options);
        });
        nb::dict result;
        result["super_bricks"] = report.super_bricks;
        result["bricks"] = report.bricks;
        result["index_bytes"] = report.index_bytes;
        result["file_bytes"] = report.file_bytes;
        result["seconds"] = report.seconds;
        return result;
      },
      nb::arg("folder"), nb::arg("memory_bytes"), nb::arg("threads"), nb::arg("progress").none(),
      nb::arg("cancel").none(),
      nb::sig("def join(folder: str, memory_bytes: int, threads: int, progress: object | None, "
              "cancel: Cancel | None) -> dict[str, typing.Any]"));
}

}  // namespace isobrick::python
