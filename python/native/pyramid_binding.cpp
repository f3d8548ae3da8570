#include "pyramid_binding.h"

#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>
#include <tbb/parallel_for.h>

#include <array>
#include <cstring>
#include <tuple>
#include <type_traits>
#include <utility>

#include "interruptible_call.h"

namespace nb = nanobind;

namespace isobrick::python {
namespace {

using Triple = std::array<std::int64_t, 3>;

template <typename Vector>
auto tupleOf(const Vector& v) {
  return std::tuple(v.x, v.y, v.z);
}

// d(world)/d(index), its columns, and the origin, in the order of numpy: rows of a 4 x 4 matrix.
std::vector<double> affineOf(const GridGeometry& geometry) {
  const glm::dmat3 matrix = geometry.indexToWorldMatrix();
  std::vector<double> rows;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) rows.push_back(matrix[column][row]);
    rows.push_back(geometry.origin[row]);
  }
  rows.insert(rows.end(), {0, 0, 0, 1});
  return rows;
}

// Samples `box` of a level, which lies within the level, into `out`, x fastest. Every sample comes
// from the one brick that has it for its own.
void readBox(const Pyramid& pyramid, int level, const IndexBox& box, std::byte* out,
             const CancelFlag& cancel) {
  const BrickLayout& layout = pyramid.layout();
  const std::size_t sample_bytes = voxelBytes(pyramid.spec().voxel_type);
  const Index3 last = layout.bricks(level) - Index3(1);
  const Index3 first_brick = glm::min(box.first / layout.brickCells(), last);
  const Index3 last_brick = glm::min((box.end() - Index3(1)) / layout.brickCells(), last);
  const Index3 bricks = last_brick - first_brick + Index3(1);
  tbb::parallel_for(std::int64_t{0}, elementCount(bricks), [&](std::int64_t i) {
    cancel.check();
    const Index3 brick =
        first_brick + Index3(i % bricks.x, i / bricks.x % bricks.y, i / (bricks.x * bricks.y));
    const IndexBox own = layout.brickOwnSamples(level, brick);
    const Index3 first = glm::max(own.first, box.first), end = glm::min(own.end(), box.end());
    if (!(first.x < end.x && first.y < end.y && first.z < end.z)) return;
    const BrickSamples samples = pyramid.samples(level, brick, &cancel);
    for (std::int64_t z = first.z; z < end.z; ++z)
      for (std::int64_t y = first.y; y < end.y; ++y) {
        const Index3 at(first.x, y, z);
        std::memcpy(
            out + static_cast<std::size_t>(linearIndex(at - box.first, box.count)) * sample_bytes,
            samples.part.data() +
                static_cast<std::size_t>(linearIndex(at - samples.box.first, samples.box.count)) *
                    sample_bytes,
            static_cast<std::size_t>(end.x - first.x) * sample_bytes);
      }
    pyramid.throwIfReadsFailed(level, brick);
  });
}

// An array [z, y, x] of the pyramid's voxel type, which may be written to if the bytes may.
template <typename Byte>
nb::object arrayOf(VoxelType type, Byte* data, const Index3& count, nb::handle owner) {
  const std::size_t shape[] = {static_cast<std::size_t>(count.z), static_cast<std::size_t>(count.y),
                               static_cast<std::size_t>(count.x)};
  return visitVoxelType(type, [&](auto tag) {
    using Plain = typename decltype(tag)::Type;
    using T = std::conditional_t<std::is_const_v<Byte>, const Plain, Plain>;
    return nb::cast(
        nb::ndarray<nb::numpy, T, nb::ndim<3>>(reinterpret_cast<T*>(data), 3, shape, owner));
  });
}

// The samples of one brick, used in place if the file allows it, and the pyramid that has them.
struct HeldBrick {
  std::shared_ptr<const Pyramid> pyramid;
  BrickSamples samples;
};

nb::object brickArray(const PyramidHandle& handle, int level, const Triple& brick) {
  auto held = std::make_unique<HeldBrick>();
  held->pyramid = handle.pyramid();
  const Index3 at(brick[0], brick[1], brick[2]);
  {
    const nb::gil_scoped_release unlocked;
    held->samples = held->pyramid->samples(level, at);
  }
  const IndexBox box = held->samples.box;
  const VoxelType type = held->pyramid->spec().voxel_type;
  const std::byte* const data = held->samples.part.data();
  const nb::capsule owner(held.release(),
                          [](void* p) noexcept { delete static_cast<HeldBrick*>(p); });
  return nb::make_tuple(tupleOf(box.first), arrayOf(type, data, box.count, owner));
}

nb::object boxArray(const PyramidHandle& handle, int level, const Triple& first,
                    const Triple& count) {
  const std::shared_ptr<const Pyramid> pyramid = handle.pyramid();
  const IndexBox box{{first[0], first[1], first[2]}, {count[0], count[1], count[2]}};
  const VoxelType type = pyramid->spec().voxel_type;
  auto bytes =
      std::make_unique<std::byte[]>(static_cast<std::size_t>(box.size()) * voxelBytes(type));
  runInterruptibly(
      {}, [&](CallState& state) { readBox(*pyramid, level, box, bytes.get(), state.cancel()); });
  std::byte* const data = bytes.get();
  const nb::capsule owner(bytes.release(),
                          [](void* p) noexcept { delete[] static_cast<std::byte*>(p); });
  return arrayOf(type, data, box.count, owner);
}

nb::object histogram(const PyramidHandle& handle) {
  const VoxelHistogram all = handle.pyramid()->histogram();
  const ValueTransform& values = handle.pyramid()->spec().values;
  nb::list least, greatest, counts;
  for (std::size_t i = 0; i < all.bins(); ++i) {
    if (all.counts()[i] == 0) continue;
    const ValueRange bin = all.bin(i);
    least.append(values.real(static_cast<double>(bin.min)));
    greatest.append(values.real(static_cast<double>(bin.max)));
    counts.append(all.counts()[i]);
  }
  return nb::make_tuple(least, greatest, counts);
}

nb::object suggestions(const PyramidHandle& handle) {
  nb::list result;
  for (const IsovalueSuggestion& one : suggestIsovalues(*handle.pyramid()).values)
    result.append(nb::make_tuple(one.value, one.area, one.gradient));
  return result;
}

nb::object verify(const PyramidHandle& handle, int threads, const nb::object& progress,
                  const CancelRequest* cancel) {
  const std::shared_ptr<const Pyramid> pyramid = handle.pyramid();
  PyramidFaults faults;
  runInterruptibly({progress, threads, cancel}, [&](CallState& state) {
    faults = verifyPyramid(*pyramid, {.threads = threads,
                                      .progress = [&](double f) { state.report("verify", f); },
                                      .cancel = &state.cancel()});
  });
  nb::list result;
  for (const BrickDamage& damage : faults.bricks)
    result.append(nb::make_tuple(damage.level, tupleOf(damage.brick), damage.what));
  for (const std::string& what : faults.rest)
    result.append(nb::make_tuple(nb::none(), nb::none(), what));
  return result;
}

// The sources of indexes are opened by the module that loads ITK, OpenVDB and HDF5.
void readLevel0ByVolumes() {
  static bool is_set = false;  // under the GIL
  if (std::exchange(is_set, true)) return;
  const nb::object opener = nb::module_::import_("isobrick._volumes").attr("_source_opener");
  setSourceOpener(*static_cast<const SourceOpener*>(nb::cast<nb::capsule>(opener).data()));
}

}  // namespace

PyramidHandle::PyramidHandle(const std::string& path, std::uint64_t budget_bytes, bool is_mapped,
                             const std::string& cache_folder, std::uint64_t cache_bytes) {
  RemoteOptions remote;
  remote.cache_folder = cache_folder;
  remote.cache_bytes = cache_bytes;
  const auto open = [&](const CancelFlag* cancel) {
    remote.cancel = cancel;
    pyramid_ = std::make_shared<const Pyramid>(
        path, budget_bytes, is_mapped ? FileAccess::kMap : FileAccess::kRead, remote);
  };
  if (isRemotePath(path)) {
    runInterruptibly({}, [&](CallState& state) { open(&state.cancel()); });
  } else {
    const nb::gil_scoped_release unlocked;
    open(nullptr);
  }
  if (pyramid_->spec().level0 != Level0Place::kStored) readLevel0ByVolumes();
}

const std::shared_ptr<const Pyramid>& PyramidHandle::pyramid() const {
  if (!pyramid_) throw Error("the pyramid is closed; open it again with isobrick.open()");
  return pyramid_;
}

void PyramidHandle::abandon() {
  if (pyramid_) (void)new std::shared_ptr<const Pyramid>(std::move(pyramid_));
  pyramid_.reset();
}

void bindPyramid(nb::module_& module) {
  nb::class_<PyramidHandle> handle(module, "PyramidHandle");
  handle
      .def(nb::init<const std::string&, std::uint64_t, bool, const std::string&, std::uint64_t>(),
           nb::arg("path"), nb::arg("budget_bytes"), nb::arg("is_mapped"), nb::arg("cache_folder"),
           nb::arg("cache_bytes"))
      .def("close", &PyramidHandle::close)
      .def("abandon", &PyramidHandle::abandon)
      .def("histogram", &histogram,
           nb::sig("def histogram(self) -> tuple[list[float], list[float], list[int]]"))
      .def("suggestions", &suggestions,
           nb::sig("def suggestions(self) -> list[tuple[float, float, float]]"))
      .def("verify", &verify,
           nb::sig("def verify(self, threads: int, progress: object | None, cancel: Cancel | None) "
                   "-> list[tuple[int | None, tuple[int, int, int] | None, str]]"),
           nb::arg("threads"), nb::arg("progress").none(), nb::arg("cancel").none())
      .def(
          "samples",
          [](const PyramidHandle& h, int level) {
            return tupleOf(h.pyramid()->lattice().samples(level));
          },
          nb::arg("level"))
      .def(
          "bricks",
          [](const PyramidHandle& h, int level) {
            return tupleOf(h.pyramid()->layout().bricks(level));
          },
          nb::arg("level"))
      .def(
          "read_brick",
          [](const PyramidHandle& h, int level, std::int64_t x, std::int64_t y, std::int64_t z) {
            return brickArray(h, level, {x, y, z});
          },
          nb::arg("level"), nb::arg("x"), nb::arg("y"), nb::arg("z"),
          nb::sig("def read_brick(self, level: int, x: int, y: int, z: int) -> tuple[tuple[int, "
                  "int, int], numpy.typing.NDArray[typing.Any]]"))
      .def(
          "read_box",
          [](const PyramidHandle& h, int level, std::int64_t x, std::int64_t y, std::int64_t z,
             std::int64_t nx, std::int64_t ny, std::int64_t nz) {
            return boxArray(h, level, {x, y, z}, {nx, ny, nz});
          },
          nb::arg("level"), nb::arg("x"), nb::arg("y"), nb::arg("z"), nb::arg("nx"), nb::arg("ny"),
          nb::arg("nz"),
          nb::sig("def read_box(self, level: int, x: int, y: int, z: int, nx: int, ny: int, nz: "
                  "int) -> numpy.typing.NDArray[typing.Any]"));
  const auto fact = [&](const char* name, const auto& of) {
    handle.def(name, [of](const PyramidHandle& h) { return of(*h.pyramid()); });
  };
  fact("path", [](const Pyramid& p) { return p.path(); });
  fact("voxels", [](const Pyramid& p) { return tupleOf(p.spec().voxels); });
  fact("voxel_type",
       [](const Pyramid& p) { return std::string(voxelTypeName(p.spec().voxel_type)); });
  fact("spacing", [](const Pyramid& p) { return tupleOf(p.spec().geometry.spacing); });
  fact("origin", [](const Pyramid& p) { return tupleOf(p.spec().geometry.origin); });
  fact("affine", [](const Pyramid& p) { return affineOf(p.spec().geometry); });
  fact("unit",
       [](const Pyramid& p) { return std::string(lengthUnitName(p.spec().geometry.unit)); });
  fact("value_range",
       [](const Pyramid& p) { return std::tuple(p.realRange().min, p.realRange().max); });
  fact("stored_values",
       [](const Pyramid& p) { return std::tuple(p.spec().values.scale, p.spec().values.offset); });
  fact("has_curvature", [](const Pyramid& p) { return p.spec().has_curvature; });
  fact("brick_cells", [](const Pyramid& p) { return p.spec().brick_cells; });
  fact("levels", [](const Pyramid& p) { return p.lattice().levels(); });
  fact("noise", [](const Pyramid& p) { return p.spec().values.scale * p.noise(); });
  fact("provenance", [](const Pyramid& p) { return p.provenance(); });
  fact("file_bytes", [](const Pyramid& p) { return p.fileBytes(); });
  fact("remote_counters", [](const Pyramid& p) {
    const RemoteCounters counters = p.remoteCounters();
    return std::tuple(counters.requests, counters.repeated, counters.bytes, counters.cached_parts,
                      counters.cached_bytes);
  });
}

}  // namespace isobrick::python
