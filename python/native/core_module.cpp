// isobrick._core: pyramids, queries, and building from arrays.
#include <isobrick/isobrick.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "array_source.h"
#include "build_binding.h"
#include "error_translation.h"
#include "interruptible_call.h"
#include "pyramid_binding.h"
#include "query_binding.h"

namespace nb = nanobind;

namespace isobrick::python {
namespace {

// A `_ArrayDescription` of Python (isobrick/_arrays.py), but for the voxels.
VolumeInfo readInfo(const nb::object& from) {
  VolumeInfo info;
  const auto voxels = nb::cast<std::array<std::int64_t, 3>>(from.attr("voxels"));
  const auto spacing = nb::cast<std::array<double, 3>>(from.attr("spacing"));
  const auto origin = nb::cast<std::array<double, 3>>(from.attr("origin"));
  const auto direction = nb::cast<std::array<double, 9>>(from.attr("direction"));
  for (int axis = 0; axis < 3; ++axis) {
    const auto i = static_cast<std::size_t>(axis);
    info.voxels[axis] = voxels[i];
    info.geometry.spacing[axis] = spacing[i];
    info.geometry.origin[axis] = origin[i];
    for (int row = 0; row < 3; ++row)  // rows of numpy; the library has columns
      info.geometry.direction[axis][row] = direction[static_cast<std::size_t>(3 * row + axis)];
  }
  if (nb::cast<bool>(from.attr("is_millimetres"))) info.geometry.unit = LengthUnit::kMillimetre;
  info.source = nb::cast<std::string>(from.attr("source"));
  info.format = nb::cast<std::string>(from.attr("format"));
  info.notes = nb::cast<std::vector<std::string>>(from.attr("notes"));
  return info;
}

nb::object buildStrided(const nb::object& description, std::uintptr_t address,
                        const std::array<std::int64_t, 3>& strides, bool is_swapped,
                        const nb::object& settings) {
  const VolumeInfo info = readInfo(description);
  const auto type = nb::cast<std::string>(description.attr("type"));
  const auto identity = nb::cast<std::string>(description.attr("identity"));
  const StridedArray array{address, {strides[0], strides[1], strides[2]}, type, is_swapped};
  return buildFrom([&](CallState&) { return makeStridedSource(info, array, identity); },
                   readBuildRequest(settings));
}

nb::object buildRead(const nb::object& description, const nb::object& read,
                     std::uint64_t buffer_bytes, const nb::object& settings) {
  VolumeInfo info = readInfo(description);
  info.voxel_type = deliveredType(nb::cast<std::string>(description.attr("type")));
  const auto identity = nb::cast<std::string>(description.attr("identity"));
  return buildFrom([&](CallState&) { return makeReaderSource(info, read, buffer_bytes, identity); },
                   readBuildRequest(settings));
}

nb::list arraySuperBricks(const nb::object& description, const nb::object& settings) {
  VolumeInfo info = readInfo(description);
  info.voxel_type = deliveredType(nb::cast<std::string>(description.attr("type")));
  return superBricks(info, readBuildRequest(settings));
}

}  // namespace
}  // namespace isobrick::python

NB_MODULE(_core, m) {
  using namespace isobrick::python;
  nb::set_leak_warnings(false);  // at exit, meshes may still be held
  translateErrors();
  nb::class_<CancelRequest>(m, "Cancel",
                            "Ends calls that were given it as `cancel`, from any thread.")
      .def(nb::init<>())
      .def(
          "request", [](CancelRequest& c) { c.flag.request(); },
          "Asks for a stop, for good: the calls raise Cancelled.")
      .def_prop_ro(
          "requested", [](const CancelRequest& c) { return c.flag.requested(); },
          "Whether a stop was asked for.");
  bindPyramid(m);
  bindQueries(m);
  m.def(
      "delivered_type",
      [](const std::string& type) {
        return std::string(isobrick::voxelTypeName(deliveredType(type)));
      },
      nb::arg("type"));
  m.def(
      "is_remote_path", [](const std::string& path) { return isobrick::isRemotePath(path); },
      nb::arg("path"));
  bindJoin(m);
  m.def("super_bricks", &arraySuperBricks, nb::arg("description"), nb::arg("settings"),
        nb::sig("def super_bricks(description: object, settings: object) -> list[tuple[str, "
                "tuple[int, int, int], tuple[int, int, int]]]"));
  m.def("build_strided", &buildStrided, nb::arg("description"), nb::arg("address"),
        nb::arg("strides"), nb::arg("is_swapped"), nb::arg("settings"),
        nb::sig("def build_strided(description: object, address: int, strides: tuple[int, int, "
                "int], is_swapped: bool, settings: object) -> dict[str, typing.Any]"));
  m.def("build_read", &buildRead, nb::arg("description"), nb::arg("read"), nb::arg("buffer_bytes"),
        nb::arg("settings"),
        nb::sig("def build_read(description: object, read: typing.Any, buffer_bytes: int, "
                "settings: object) -> dict[str, typing.Any]"));
}
