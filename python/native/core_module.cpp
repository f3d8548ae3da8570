// isobrick._core: pyramids, queries, and building from arrays.
#include <isobrick/isobrick.h>
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <optional>
#include <tuple>

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

// All of it. The array's own memory is read, or `read` gives boxes of it.
struct ArrayInput {
  VolumeInfo info;
  std::string identity;
  Derivation derivation;
  std::optional<StridedArray> array;
  nb::object read;
  std::uint64_t buffer_bytes = 0;

  // From any thread.
  std::unique_ptr<VolumeSource> open() const {
    return array ? makeStridedSource(info, *array, identity, derivation)
                 : makeReaderSource(info, read, buffer_bytes, identity, derivation);
  }
};

ArrayInput readArray(const nb::object& from) {
  using Memory = std::tuple<std::uintptr_t, std::array<std::int64_t, 3>, bool>;
  const auto type = nb::cast<std::string>(from.attr("type"));
  ArrayInput input{readInfo(from),       nb::cast<std::string>(from.attr("identity")),
                   readDerivation(from), std::nullopt,
                   from.attr("read"),    nb::cast<std::uint64_t>(from.attr("buffer_bytes"))};
  input.info.voxel_type = deliveredType(type);
  if (const auto memory = nb::cast<std::optional<Memory>>(from.attr("memory"))) {
    const auto& [address, strides, is_swapped] = *memory;
    input.array = StridedArray{address, {strides[0], strides[1], strides[2]}, type, is_swapped};
  }
  return input;
}

nb::object buildArray(const nb::object& description, const nb::object& settings) {
  const ArrayInput input = readArray(description);
  return buildFrom([&](CallState&) { return input.open(); }, readBuildRequest(settings));
}

// The mesh of a source, which is read once.
using OpenSource = std::function<std::unique_ptr<VolumeSource>()>;
ExtractionReport streamInto(const OpenSource& open, std::uint64_t memory_bytes, const Query& query,
                            SurfaceMesh& mesh, CallState& state) {
  BrickStreamOptions options;
  options.open = open;
  options.memory_bytes = memory_bytes;
  options.cancel = &state.cancel();
  options.progress = [&](double fraction) { state.report("values", fraction); };
  BrickStream stream(std::move(options));
  if (!stream.fits())
    throw Error("a memory of " + std::to_string(memory_bytes) +
                " bytes is too small to go through the array a slab at a time; give more");
  OnePassSurface surface(stream.pyramid(), query, mesh);
  stream.run(finestBricksOf(stream.pyramid().layout(), query),
             [&](const IndexBox& bricks) { surface.mesh(bricks); });
  return surface.finish();
}

// Whether the library may take its rows for its own: a type of voxels, in order, aligned.
bool isVoxelArray(const StridedArray& array, VoxelType type) {
  const auto bytes = static_cast<std::int64_t>(voxelBytes(type));
  const bool is_same = array.type == "u1" || array.type == "i1" || array.type == "u2" ||
                       array.type == "i2" || array.type == "f4";
  return is_same && !array.is_swapped && array.strides.x == bytes && array.strides.y % bytes == 0 &&
         array.strides.z % bytes == 0 && array.address % static_cast<std::uintptr_t>(bytes) == 0;
}

nb::object isosurfaceOfArray(const nb::object& description, const nb::object& settings,
                             std::uint64_t memory_bytes) {
  ArrayInput input = readArray(description);
  input.identity = "array";
  return isosurfaceOf(
      input.info, settings, [&](const Query& query, SurfaceMesh& mesh, CallState& state) {
        const VoxelType type = input.info.voxel_type;
        if (!input.array || !isVoxelArray(*input.array, type) || !input.derivation.isNone())
          return streamInto([&] { return input.open(); }, memory_bytes, query, mesh, state);
        const auto bytes = static_cast<std::int64_t>(voxelBytes(type));
        const auto pyramid = pyramidOfArray(
            input.info, {reinterpret_cast<const void*>(input.array->address),
                         input.array->strides.y / bytes, input.array->strides.z / bytes});
        return Extractor(*pyramid).extract(query, mesh);
      });
}

void contrasts(std::uintptr_t address, const std::array<std::int64_t, 3>& strides,
               const std::array<std::int64_t, 3>& voxels, const std::string& type,
               const nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig>& points,
               const nb::ndarray<float, nb::shape<-1>, nb::c_contig>& out) {
  const StridedArray array{address, {strides[0], strides[1], strides[2]}, type, false};
  const nb::gil_scoped_release unlocked;
  cellContrasts(array, {voxels[0], voxels[1], voxels[2]}, {points.data(), points.size()},
                {out.data(), out.size()});
}

nb::list arraySuperBricks(const nb::object& description, const nb::object& settings) {
  return superBricks(readArray(description).info, readBuildRequest(settings));
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
  m.def("is_remote_volume", &isobrick::isRemoteVolume, nb::arg("path"));
  m.def("is_pyramid_file", &isobrick::isPyramidFile, nb::arg("path"));
  bindJoin(m);
  m.def("super_bricks", &arraySuperBricks, nb::arg("description"), nb::arg("settings"),
        nb::sig("def super_bricks(description: object, settings: object) -> list[tuple[str, "
                "tuple[int, int, int], tuple[int, int, int]]]"));
  m.def("isosurface", &isosurfaceOfArray, nb::arg("description"), nb::arg("settings"),
        nb::arg("memory_bytes"),
        nb::sig("def isosurface(description: object, settings: object, memory_bytes: int) -> "
                "MeshHandle"));
  m.def("build_array", &buildArray, nb::arg("description"), nb::arg("settings"),
        nb::sig("def build_array(description: object, settings: object) -> dict[str, "
                "typing.Any]"));
  m.def("cell_contrasts", &contrasts, nb::arg("address"), nb::arg("strides"), nb::arg("voxels"),
        nb::arg("type"), nb::arg("points"), nb::arg("out"),
        nb::sig("def cell_contrasts(address: int, strides: tuple[int, int, int], voxels: "
                "tuple[int, int, int], type: str, points: numpy.typing.NDArray[numpy.float64], "
                "out: numpy.typing.NDArray[numpy.float32]) -> None"));
}
