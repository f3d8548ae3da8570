// isobrick._volumes: building from files of all formats. Apart from _core, since it loads ITK,
// OpenVDB and HDF5.
#include <isobrick/isobrick.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <array>
#include <charconv>
#include <optional>

#include "build_binding.h"
#include "error_translation.h"

namespace nb = nanobind;

namespace isobrick::python {
namespace {

using Doubles3 = std::array<double, 3>;

std::optional<glm::dvec3> vectorOf(const std::optional<Doubles3>& v) {
  if (!v) return std::nullopt;
  return glm::dvec3((*v)[0], (*v)[1], (*v)[2]);
}

// A `RawLayout` of Python.
std::optional<RawLayout> readRaw(const nb::object& from) {
  if (from.is_none()) return std::nullopt;
  RawLayout raw;
  const auto shape = nb::cast<std::array<std::int64_t, 3>>(from.attr("shape"));
  raw.voxels = {shape[2], shape[1], shape[0]};
  raw.type = nb::cast<std::string>(from.attr("dtype"));
  raw.big_endian = nb::cast<bool>(from.attr("big_endian"));
  raw.offset_bytes = nb::cast<std::uint64_t>(from.attr("offset"));
  return raw;
}

OpenOptions readInput(const nb::object& input) {
  OpenOptions options;
  options.raw = readRaw(input.attr("raw"));
  options.spacing = vectorOf(nb::cast<std::optional<Doubles3>>(input.attr("spacing")));
  options.origin = vectorOf(nb::cast<std::optional<Doubles3>>(input.attr("origin")));
  options.unit = nb::cast<std::optional<std::string>>(input.attr("unit")).value_or("");
  options.series = nb::cast<std::string>(input.attr("series"));
  options.grid = nb::cast<std::string>(input.attr("grid"));
  options.time = nb::cast<std::optional<std::int64_t>>(input.attr("time"));
  options.channel = nb::cast<std::optional<std::int64_t>>(input.attr("channel"));
  options.image = nb::cast<std::optional<std::int64_t>>(input.attr("image"));
  if (const auto component = nb::cast<std::optional<std::int64_t>>(input.attr("component")))
    options.component = ComponentChoice{false, *component};
  options.derivation = readDerivation(input);
  if (!options.derivation.isNone()) options.pyramid_level = 0;
  return options;
}

std::unique_ptr<VolumeSource> openInput(const std::string& path, OpenOptions options,
                                        std::uint64_t memory_bytes, CallState& state) {
  options.memory_bytes = memory_bytes / 2;
  options.cancel = &state.cancel();
  options.progress = [&](std::string_view phase, double f) { state.report(phase, f); };
  if (const std::size_t colon = path.find("phantom:"); colon == 0) {
    const std::size_t size_at = path.find(':', 8);
    PhantomSpec spec{.name = path.substr(8, size_at - 8)};
    if (size_at != std::string::npos) {
      const char* const end = path.data() + path.size();
      const auto read = std::from_chars(path.data() + size_at + 1, end, spec.size);
      if (read.ec != std::errc() || read.ptr != end)
        throw Error("'" + path + "' is not phantom:NAME:SIZE, with a number of voxels");
    }
    return viewAsGiven(makePhantomSource(spec), options);
  }
  return openVolume(path, options);
}

nb::object buildFile(const std::string& path, const nb::object& input, const nb::object& settings) {
  const OpenOptions options = readInput(input);
  BuildRequest request = readBuildRequest(settings);
  return buildFrom(
      [&](CallState& state) {
        auto source = openInput(path, options, request.options.memory_bytes, state);
        if (request.index)
          request.options.source_record = sourceRecord(*source, options, request.out);
        return source;
      },
      request);
}

nb::list fileSuperBricks(const std::string& path, const nb::object& input,
                         const nb::object& settings) {
  const OpenOptions options = readInput(input);
  const BuildRequest request = readBuildRequest(settings);
  VolumeInfo info;
  runInterruptibly(request.call, [&](CallState& state) {
    info = openInput(path, options, request.options.memory_bytes, state)->info();
  });
  return superBricks(info, request);
}

}  // namespace
}  // namespace isobrick::python

NB_MODULE(_volumes, m) {
  using namespace isobrick::python;
  translateErrors();
  // For `_core`, which opens the sources of indexes by it.
  static const isobrick::SourceOpener opener = isobrick::volumeSourceOpener();
  m.attr("_source_opener") = nb::capsule(&opener);
  m.def("build_file", &buildFile, nb::arg("path"), nb::arg("input"), nb::arg("settings"),
        nb::sig(
            "def build_file(path: str, input: object, settings: object) -> dict[str, typing.Any]"));
  m.def("super_bricks", &fileSuperBricks, nb::arg("path"), nb::arg("input"), nb::arg("settings"),
        nb::sig("def super_bricks(path: str, input: object, settings: object) -> list[tuple[str, "
                "tuple[int, int, int], tuple[int, int, int]]]"));
  m.def(
      "readable_formats",
      [] {
        nb::list result;
        for (const isobrick::ReadableFormat& format : isobrick::readableFormats())
          if (format.is_built_in) result.append(nb::make_tuple(format.name, format.namedBy()));
        return result;
      },
      nb::sig("def readable_formats() -> list[tuple[str, str]]"));
}
