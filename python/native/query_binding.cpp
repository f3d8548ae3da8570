#include "query_binding.h"

#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <filesystem>
#include <limits>
#include <memory>
#include <mutex>
#include <numbers>
#include <tuple>
#include <utility>
#include <vector>

#include "build_binding.h"
#include "interruptible_call.h"
#include "mesh_data.h"
#include "pyramid_binding.h"

namespace nb = nanobind;

namespace isobrick::python {
namespace {

using Doubles3 = std::array<double, 3>;

glm::dvec3 vectorOf(const Doubles3& v) { return {v[0], v[1], v[2]}; }

template <typename T>
std::optional<T> optionalOf(const nb::object& settings, const char* name) {
  return nb::cast<std::optional<T>>(settings.attr(name));
}

// A `View` of Python.
ViewPoint readView(const nb::object& from) {
  ViewPoint view;
  view.eye = vectorOf(nb::cast<Doubles3>(from.attr("eye")));
  view.pixels = nb::cast<double>(from.attr("pixels"));
  view.pixels_per_radian = nb::cast<double>(from.attr("pixels_per_radian"));
  view.pixels_per_unit = optionalOf<double>(from, "pixels_per_unit");
  if (const auto look_at = optionalOf<Doubles3>(from, "look_at")) {
    view.field = ViewPoint::Field{};
    view.field->direction = vectorOf(*look_at) - view.eye;
    view.field->half_angle = nb::cast<double>(from.attr("field_of_view")) * std::numbers::pi / 360;
    view.field->radius = optionalOf<double>(from, "field_radius").value_or(0);
  }
  return view;
}

// A `Detail` of Python.
DetailChoice readDetail(const nb::object& from, const GridGeometry& geometry) {
  DetailChoice choice;
  if (const auto focus = optionalOf<Doubles3>(from, "focus"))
    choice.focus = FocusSphere{geometry.worldToIndex(vectorOf(*focus))};
  if (const auto focus = optionalOf<Doubles3>(from, "focus_voxels"))
    choice.focus = FocusSphere{vectorOf(*focus)};
  if (choice.focus)
    choice.focus->radius =
        optionalOf<double>(from, "radius_voxels")
            .value_or(optionalOf<double>(from, "radius").value_or(0) / geometry.leastSpacing());
  choice.uniform_level = optionalOf<int>(from, "level");
  choice.curvature_tolerance = optionalOf<double>(from, "curvature");
  if (!from.attr("view").is_none()) choice.view = readView(from.attr("view"));
  return choice;
}

using MaskArray = nb::ndarray<const std::uint8_t, nb::ndim<3>, nb::c_contig, nb::device::cpu>;

// A copy of the array, [z, y, x], in a volume's own grid.
std::shared_ptr<const Pyramid> pyramidOfMask(const MaskArray& array, const GridGeometry& geometry,
                                             const Index3& voxels) {
  struct HeldMask {
    std::vector<std::uint8_t> voxels;
    std::unique_ptr<const Pyramid> pyramid;
  };
  const auto held = std::make_shared<HeldMask>();
  held->voxels.assign(array.data(), array.data() + array.size());
  VolumeInfo info;
  for (int axis = 0; axis < 3; ++axis)
    info.voxels[axis] = static_cast<std::int64_t>(array.shape(static_cast<std::size_t>(2 - axis)));
  if (info.voxels != voxels)
    throw Error(
        "a mask that is an array has the shape of the volume; give a pyramid of another one");
  info.geometry = geometry;
  info.source = "mask";
  held->pyramid =
      pyramidOfArray(info, {held->voxels.data(), info.voxels.x, info.voxels.x * info.voxels.y});
  return {held, held->pyramid.get()};
}

// A `_Region` of Python.
SurfaceRegion readRegion(const nb::object& from, const GridGeometry& geometry,
                         const Index3& voxels) {
  using Doubles4 = std::array<double, 4>;
  SurfaceRegion region;
  for (const nb::handle one : from.attr("masks")) {
    const auto [mask, value] = nb::cast<std::pair<nb::object, std::optional<double>>>(one);
    PyramidHandle* handle = nullptr;
    region.masks.push_back({nb::try_cast(mask, handle)
                                ? handle->pyramid()
                                : pyramidOfMask(nb::cast<MaskArray>(mask), geometry, voxels),
                            value});
  }
  const auto rows = [&](const char* name) {
    return nb::cast<std::vector<Doubles4>>(from.attr(name));
  };
  for (const auto& [x, y, z, d] : rows("planes"))
    region.half_spaces.push_back(halfSpaceInWorld(geometry, {x, y, z}, d));
  for (const auto& [x, y, z, d] : rows("planes_voxels"))
    region.half_spaces.push_back(HalfSpace{{x, y, z}, d});
  for (const auto& [x, y, z, radius] : rows("spheres"))
    region.balls.push_back(ballInWorld(geometry, {x, y, z}, radius));
  for (const auto& [x, y, z, radius] : rows("spheres_voxels"))
    region.balls.push_back(RegionBall{{x, y, z}, radius});
  return region;
}

// A `_QuerySettings` of Python (isobrick/_query.py), for a volume of so many voxels.
Query readQuery(const nb::object& from, const GridGeometry& geometry, const Index3& voxels) {
  Query query;
  query.isovalue = nb::cast<double>(from.attr("isovalue"));
  if (nb::cast<bool>(from.attr("is_below"))) query.inside = InsideOf::kBelow;
  static_cast<DetailChoice&>(query) = readDetail(from.attr("detail"), geometry);
  for (const nb::handle choice : from.attr("or_finer"))
    query.or_finer.push_back(readDetail(nb::borrow(choice), geometry));
  using Corners = std::array<Doubles3, 2>;
  if (const auto box = optionalOf<Corners>(from, "box"))
    query.box = indexBoxAround({vectorOf((*box)[0]), vectorOf((*box)[1])}, geometry);
  if (const auto box = optionalOf<Corners>(from, "box_voxels"))
    query.box = QueryBox{vectorOf((*box)[0]), vectorOf((*box)[1])};
  query.cap = nb::cast<bool>(from.attr("cap"));
  query.region = readRegion(from.attr("region"), geometry, voxels);
  if (const auto distance = optionalOf<double>(from, "simplify"))
    query.simplify = SimplifyOptions{*distance, true};
  if (const auto distance = optionalOf<double>(from, "simplify_voxels"))
    query.simplify = SimplifyOptions{*distance, false};
  if (nb::cast<bool>(from.attr("drop_small"))) {
    if (!query.simplify) query.simplify.emplace();  // `triangles` finds the distance
    query.simplify->drop_small = true;
  }
  return query;
}

// The names of space and unit, and the shift, of placement_of() of Python.
using PlacementTuple = std::tuple<std::string, std::string, Doubles3>;
MeshPlacement readPlacement(const PlacementTuple& from) {
  const auto& [space, unit, shift] = from;
  return {space == "RAS"     ? MeshSpace::kRas
          : space == "index" ? MeshSpace::kIndex
                             : MeshSpace::kLps,
          unit, vectorOf(shift)};
}

PieceChoice readPieces(const nb::object& from) {
  return {optionalOf<std::size_t>(from, "keep_largest"), optionalOf<double>(from, "drop_below")};
}

// (i, n), i from 1; nothing for the whole surface.
std::optional<ShareNumber> readPart(const nb::object& from) {
  const auto part = optionalOf<std::array<std::uint32_t, 2>>(from, "part");
  if (!part) return std::nullopt;
  return ShareNumber{(*part)[0], (*part)[1]};
}

// Writes the mesh of all shares, which are files, to `out`.
nb::object mergeShares(const std::vector<std::string>& paths, const std::string& out, bool zlib,
                       bool meshopt, const PlacementTuple& placement, bool force, int threads,
                       const CancelRequest* cancel) {
  refuseReplacing(out, force);
  MergeReport report;
  std::uint64_t vertices = 0;
  runInterruptibly({nb::none(), threads, cancel}, [&](CallState& state) {
    const auto sink = makeMeshFileSink(out, {.cancel = &state.cancel(),
                                             .placement = readPlacement(placement),
                                             .zlib = zlib,
                                             .meshopt = meshopt});
    report = mergeMeshShares(paths, *sink, &state.cancel());
    vertices = sink->vertices();
  });
  nb::dict result;
  result["shares"] = report.shares;
  result["triangles"] = report.triangles;
  result["vertices"] = vertices;
  return result;
}

MeshFrame frameOf(const GridGeometry& geometry, const Index3& voxels, bool has_missing,
                  const Query& query) {
  return {.geometry = geometry,
          .voxels = voxels,
          .has_missing = has_missing,
          .inside = query.inside,
          .has_caps = query.cap};
}

CallOptions readCall(const nb::object& from) {
  return {from.attr("progress"), nb::cast<int>(from.attr("threads")),
          nb::cast<const CancelRequest*>(from.attr("cancel"))};
}

// An attribute of Python (isobrick/_attributes.py), before what it needs is at hand.
struct FieldWish {
  std::string name, kind;
  std::shared_ptr<const Pyramid> pyramid;  // of "value" and "nearest"
  std::optional<double> number;            // the greatest thickness, or an isovalue
  std::string path;                        // of a mesh

  bool isOfSurface() const { return kind == "thickness" || (kind == "distance" && path.empty()); }
};

std::vector<FieldWish> readFields(const nb::object& from) {
  std::vector<FieldWish> wishes;
  for (const nb::handle one : from.attr("attributes")) {
    FieldWish wish;
    wish.name = nb::cast<std::string>(one.attr("name"));
    wish.kind = nb::cast<std::string>(one.attr("kind"));
    wish.number = optionalOf<double>(nb::borrow(one), "number");
    wish.path = nb::cast<std::string>(one.attr("path"));
    if (!one.attr("handle").is_none())
      wish.pyramid = nb::cast<const PyramidHandle&>(one.attr("handle")).pyramid();
    wishes.push_back(std::move(wish));
  }
  return wishes;
}

// The colours of vertices, a `Colors` of Python, by the fields of the mesh.
std::optional<VertexColors> readColors(const nb::object& from,
                                       const std::vector<MeshField>& fields) {
  if (from.is_none()) return std::nullopt;
  const auto name = nb::cast<std::string>(from.attr("attribute"));
  const auto found = std::ranges::find(fields, name, &MeshField::name);
  if (found == fields.end())
    throw Error("there is no attribute '" + name + "' for the colours; give it with the query");
  VertexColors colors;
  colors.attribute = static_cast<std::size_t>(found - fields.begin());
  if (const auto map = optionalOf<std::string>(from, "map")) {
    const auto named = std::ranges::find(kColorMapNames, *map);
    if (named == kColorMapNames.end()) throw Error("there is no map of colours '" + *map + "'");
    colors.map = static_cast<ColorMap>(named - kColorMapNames.begin());
    colors.low = nb::cast<double>(from.attr("low"));
    colors.high = nb::cast<double>(from.attr("high"));
  }
  return colors;
}

// A field of a pyramid, which holds on to that.
template <typename Field, typename... Arguments>
std::shared_ptr<const VertexValues> fieldOn(std::shared_ptr<const Pyramid> pyramid,
                                            Arguments... arguments) {
  struct Held {
    std::shared_ptr<const Pyramid> pyramid;
    Field field;
  };
  const Pyramid& of = *pyramid;
  const std::shared_ptr<Held> held(new Held{std::move(pyramid), Field(of, arguments...)});
  return {held, &held->field};
}

// `pyramid` and `extractor`: of the surface; null if there is none.
MeshField fieldOf(const FieldWish& wish, const Query& query,
                  const std::shared_ptr<const Pyramid>& pyramid, Extractor* extractor,
                  const CancelFlag& cancel) {
  if (wish.isOfSurface() && extractor == nullptr)
    throw Error("the attribute '" + wish.name +
                "' needs a pyramid of the volume; build one, and extract from it");
  MeshField field{wish.name, AttributeType::kFloat32, nullptr};
  if (wish.kind == "value") {
    field.values = fieldOn<PyramidValues>(wish.pyramid, Sampling::kTrilinear);
  } else if (wish.kind == "nearest") {
    field.values = fieldOn<PyramidValues>(wish.pyramid, Sampling::kNearest);
    field.type = labelTypeOf(*wish.pyramid);
  } else if (wish.kind == "thickness") {
    field.values = fieldOn<WallThickness>(
        pyramid, query.isovalue, wish.number.value_or(std::numeric_limits<double>::infinity()),
        query.inside);
  } else if (!wish.path.empty()) {
    field.values = std::make_shared<MeshDistance>(readMeshFile(wish.path));
  } else {
    Query other;
    other.isovalue = wish.number.value();
    other.cancel = &cancel;
    IndexedMeshSink sink;
    extractor->extract(other, sink);
    field.values = std::make_shared<MeshDistance>(sink.takeMesh());
  }
  return field;
}

std::vector<MeshField> fieldsOf(const std::vector<FieldWish>& wishes, const Query& query,
                                const std::shared_ptr<const Pyramid>& pyramid, Extractor* extractor,
                                const CancelFlag& cancel) {
  std::vector<MeshField> fields;
  for (const FieldWish& wish : wishes)
    fields.push_back(fieldOf(wish, query, pyramid, extractor, cancel));
  return fields;
}

// A share of a mesh; numpy arrays have one too.
struct MeshHandle {
  std::shared_ptr<MeshData> data;

  nb::capsule owner() const {
    return nb::capsule(new std::shared_ptr<MeshData>(data),
                       [](void* p) noexcept { delete static_cast<std::shared_ptr<MeshData>*>(p); });
  }
  template <typename T, std::size_t Columns>
  nb::object rows(const T* elements, std::uint64_t count) const {
    const std::size_t shape[] = {static_cast<std::size_t>(count), Columns};
    return nb::cast(nb::ndarray<nb::numpy, const T, nb::ndim<2>>(elements, 2, shape, owner()));
  }
  template <typename T>
  nb::object row(const T* elements, std::uint64_t count) const {
    const std::size_t shape[] = {static_cast<std::size_t>(count)};
    return nb::cast(nb::ndarray<nb::numpy, const T, nb::ndim<1>>(elements, 1, shape, owner()));
  }
  // Without the interpreter's lock, since it may take long.
  template <typename Make>
  auto made(const Make& make) const {
    const nb::gil_scoped_release unlocked;
    const std::lock_guard lock(mutex());
    return make(*data);
  }

 private:
  // Held while arrays are made late, for all objects that share the mesh.
  static std::mutex& mutex() {
    static auto* const mutex = new std::mutex;
    return *mutex;
  }
};

nb::object meshPoints(const MeshHandle& mesh) {
  const void* const points = mesh.made([](MeshData& data) { return data.points(); });
  const std::uint64_t count = mesh.data->vertices();
  return mesh.data->hasDoubles() ? mesh.rows<double, 3>(static_cast<const double*>(points), count)
                                 : mesh.rows<float, 3>(static_cast<const float*>(points), count);
}

nb::object meshIndexPoints(const MeshHandle& mesh) {
  const auto count = static_cast<std::size_t>(mesh.data->vertices());
  auto points = std::make_unique<double[]>(3 * count);
  {
    const nb::gil_scoped_release unlocked;
    mesh.data->indexPoints(points.get());
  }
  double* const data = points.get();
  const nb::capsule owner(points.release(),
                          [](void* p) noexcept { delete[] static_cast<double*>(p); });
  const std::size_t shape[] = {count, 3};
  return nb::cast(nb::ndarray<nb::numpy, double, nb::ndim<2>>(data, 2, shape, owner));
}

// Of some pieces of a surface levels are not counted: they are None.
nb::object reportOf(const ExtractionReport& report, bool is_of_pieces) {
  nb::list levels;
  for (const LevelCounts& counts : report.levels)
    levels.append(nb::make_tuple(counts.level, counts.cells, counts.triangles,
                                 counts.transition_cells, counts.cap_triangles));
  nb::dict result;
  result["is_complete"] = report.is_complete;
  result["triangles"] = report.triangles;
  result["levels"] = is_of_pieces ? nb::object(nb::none()) : nb::object(levels);
  result["bricks_active"] = report.bricks_active;
  result["bricks_read"] = report.bricks_read;
  result["bytes_active"] = report.bytes_active;
  result["bytes_read"] = report.bytes_read;
  return result;
}

void saveMesh(const MeshHandle& mesh, const std::string& path, const nb::object& colors, bool zlib,
              bool meshopt, const PlacementTuple& placement) {
  const auto read = readColors(colors, mesh.data->fields());
  runInterruptibly({}, [&](CallState& state) {
    mesh.data->save(path, {.cancel = &state.cancel(),
                           .colors = read,
                           .placement = readPlacement(placement),
                           .zlib = zlib,
                           .meshopt = meshopt});
  });
}

// A mesh in a file of several: its name, its label and its colour.
using ObjectTuple =
    std::tuple<MeshHandle, std::string, std::uint64_t, std::optional<std::array<float, 3>>>;

void saveTogether(const std::vector<ObjectTuple>& meshes, const std::string& path, bool are_labels,
                  bool zlib, bool meshopt, const PlacementTuple& placement) {
  runInterruptibly({}, [&](CallState& state) {
    const auto make = are_labels ? makeLabelCollection : makeMeshCollection;
    const auto file = make(path, {.cancel = &state.cancel(),
                                  .placement = readPlacement(placement),
                                  .zlib = zlib,
                                  .meshopt = meshopt});
    for (const auto& [mesh, name, label, color] : meshes) {
      MeshObject object{.name = name, .label = label};
      if (color) object.color = glm::vec3((*color)[0], (*color)[1], (*color)[2]);
      mesh.data->passTo(*file->add(object), &state.cancel());
    }
    file->finish();
  });
}

nb::object checkMesh(const MeshHandle& mesh) {
  MeshQuality quality;
  runInterruptibly({}, [&](CallState& state) { quality = mesh.data->check(&state.cancel()); });
  nb::dict result;
  result["is_solid"] = quality.isSolid();
  result["vertices"] = quality.vertices;
  result["edges"] = quality.edges;
  result["triangles"] = quality.triangles;
  result["open_edges"] = quality.open_edges;
  result["boundary_loops"] = quality.boundary_loops;
  result["nonmanifold_edges"] = quality.nonmanifold_edges;
  result["misoriented_edges"] = quality.misoriented_edges;
  result["zero_area_triangles"] = quality.zero_area;
  result["crossing_triangles"] = quality.crossing;
  result["euler_number"] = quality.euler;
  result["area"] = quality.area;
  result["volume"] = quality.isClosed() ? nb::cast(quality.volume) : nb::none();
  result["least_angle"] = quality.least_angle;
  result["mean_aspect"] = quality.mean_aspect;
  result["worst_aspect"] = quality.worst_aspect;
  return result;
}

// The list of pieces, and of every triangle its place in the list.
nb::object meshComponents(const MeshHandle& mesh) {
  auto numbers = std::make_unique<std::vector<std::uint32_t>>();
  SurfaceComponents components;
  runInterruptibly(
      {}, [&](CallState& state) { components = mesh.data->components(*numbers, &state.cancel()); });
  nb::list list;
  const auto tupleOf = [](const glm::dvec3& v) { return nb::make_tuple(v.x, v.y, v.z); };
  for (const SurfaceComponent& one : components.list())
    list.append(nb::make_tuple(one.triangles, one.area, one.volume, one.enclosed,
                               tupleOf(one.lower), tupleOf(one.upper), tupleOf(one.center)));
  const std::size_t shape[] = {numbers->size()};
  const std::uint32_t* const data = numbers->data();
  const nb::capsule owner(numbers.release(), [](void* p) noexcept {
    delete static_cast<std::vector<std::uint32_t>*>(p);
  });
  return nb::make_tuple(
      list, nb::ndarray<nb::numpy, const std::uint32_t, nb::ndim<1>>(data, 1, shape, owner));
}

// By their names.
nb::object meshAttributes(const MeshHandle& mesh) {
  nb::dict result;
  for (std::size_t i = 0; i < mesh.data->fields().size(); ++i) {
    const void* const values = mesh.made([i](MeshData& data) { return data.values(i); });
    const MeshField& field = mesh.data->fields()[i];
    const auto row = [&]<typename Number>(Number) {
      return mesh.row(static_cast<const Number*>(values), mesh.data->vertices());
    };
    switch (field.type) {
      case AttributeType::kFloat32:
        result[field.name.c_str()] = row(float{});
        break;
      case AttributeType::kFloat64:
        result[field.name.c_str()] = row(double{});
        break;
      case AttributeType::kInt32:
        result[field.name.c_str()] = row(std::int32_t{});
        break;
      case AttributeType::kUint32:
        result[field.name.c_str()] = row(std::uint32_t{});
        break;
    }
  }
  return result;
}

// Queries one after the other on a pyramid, into memory that no array holds any more.
class Session {
 public:
  explicit Session(const PyramidHandle& handle)
      : pyramid_(handle.pyramid()),
        extractor_(std::make_unique<Extractor>(*pyramid_)),
        mutex_(std::make_unique<std::mutex>()) {}

  MeshHandle extract(const nb::object& settings, bool is_progressive) {
    const auto part = readPart(settings);
    Query query = readQuery(settings, geometry(), pyramid_->spec().voxels);
    query.is_progressive = is_progressive;
    const CallOptions call = readCall(settings);
    const std::vector<FieldWish> wishes = readFields(settings);
    const auto most_triangles = optionalOf<std::uint64_t>(settings, "triangles");
    const PieceChoice pieces = readPieces(settings);
    if (part && pieces.isGiven())
      throw Error(
          "the largest pieces are those of the whole surface; leave out part, or write shares "
          "with extract_to");
    std::shared_ptr<MeshData> mesh;
    runInterruptibly(call, [&](CallState& state) {
      const std::lock_guard lock(mutex());
      query.cancel = &state.cancel();
      query.fraction_done = &state.fraction();
      std::vector<MeshField> fields =
          fieldsOf(wishes, query, pyramid_, &extractor(), state.cancel());
      if (most_triangles) query.simplify = findSimplification(extractor(), query, *most_triangles);
      mesh = idleMesh();
      const ExtractionReport report = part ? extractPart(query, *part, mesh->surface())
                                           : extractor().extract(query, mesh->surface());
      const auto& spec = pyramid_->spec();
      mesh->filled(frameOf(geometry(), spec.voxels, spec.has_missing, query), query, report,
                   std::move(fields));
      if (pieces.isGiven()) mesh->keepPieces(pieces, &state.cancel());
    });
    return {std::move(mesh)};
  }

  nb::object extractTo(const nb::object& settings, const std::string& path,
                       const nb::object& colors, bool zlib, bool meshopt,
                       const PlacementTuple& placement, bool force) {
    refuseReplacing(path, force);
    std::error_code ignored;
    if (std::filesystem::equivalent(path, pyramid_->path(), ignored))
      throw Error("'" + path + "' is the pyramid itself; choose another name", {.path = path});
    Query query = readQuery(settings, geometry(), pyramid_->spec().voxels);
    const auto part = readPart(settings);
    const bool is_share = std::filesystem::path(path).extension() == kMeshShareEnding;
    const std::vector<FieldWish> wishes = readFields(settings);
    const auto most_triangles = optionalOf<std::uint64_t>(settings, "triangles");
    const PieceChoice pieces = readPieces(settings);
    const MeshPlacement placed = readPlacement(placement);
    if (is_share && (!part || !wishes.empty() || zlib || meshopt || placed != MeshPlacement()))
      throw Error("'" + path +
                      "' is a share; give part=(i, n) with it, and neither values, packing, space, "
                      "unit nor shift",
                  {.path = path});
    std::vector<MeshField> named;
    for (const FieldWish& wish : wishes)
      named.push_back({wish.name, AttributeType::kFloat32, nullptr});
    const std::optional<VertexColors> read_colors = readColors(colors, named);
    ExtractionReport report;
    std::uint64_t vertices = 0;
    runInterruptibly(readCall(settings), [&](CallState& state) {
      const std::lock_guard lock(mutex());
      query.cancel = &state.cancel();
      query.fraction_done = &state.fraction();
      const std::vector<MeshField> fields =
          fieldsOf(wishes, query, pyramid_, &extractor(), state.cancel());
      if (most_triangles) query.simplify = findSimplification(extractor(), query, *most_triangles);
      std::optional<SurfaceComponents> components;
      if (pieces.isGiven()) {
        ComponentFinder finder(query);
        extractor().extract(query, finder);
        components = finder.take();
      }
      const ExtractionPlan plan = extractor().plan(query);
      const ShareNumber share = part.value_or(ShareNumber());
      const auto sink = is_share ? makeMeshShareSink(path, *pyramid_, plan, share, &state.cancel())
                                 : makeMeshFileSink(path, {.cancel = &state.cancel(),
                                                           .attributes = attributesOf(fields),
                                                           .colors = read_colors,
                                                           .placement = placed,
                                                           .zlib = zlib,
                                                           .meshopt = meshopt});
      const NumberRun run = bricksOf(plan, share);
      std::optional<ComponentFilter> filter;
      std::vector<std::uint8_t> is_kept;
      if (components) {
        is_kept = pieces.keptOf(*components);
        filter.emplace(*components, is_kept, *sink);
      }
      report = extractor().execute(plan, run.first, run.count,
                                   filter ? static_cast<TriangleSink&>(*filter) : *sink);
      if (components && !part) {
        report.triangles = 0;
        for (std::size_t i = 0; i < is_kept.size(); ++i)
          if (is_kept[i] != 0) report.triangles += components->list()[i].triangles;
      }
      vertices = sink->vertices();
    });
    const nb::object result = reportOf(report, pieces.isGiven());
    result["vertices"] = vertices;
    return result;
  }

  // See Extractor::waitForBricks().
  bool waitForBricks(double seconds) {
    bool has_more = false;
    runInterruptibly({}, [&](CallState& state) {
      const std::lock_guard lock(mutex());
      const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
      // Short waits, so that Ctrl-C is seen; one that ends early is one after which all is there.
      constexpr auto kWait = std::chrono::milliseconds(5);
      for (auto now = std::chrono::steady_clock::now(); now < end;) {
        has_more = extractor().waitForBricks(kWait);
        state.cancel().check();
        const auto before = std::exchange(now, std::chrono::steady_clock::now());
        if (!has_more || now - before < kWait) return;
      }
    });
    return has_more;
  }

  // How many meshes it keeps memory of, in use or not.
  std::size_t meshes() const { return meshes_.size(); }

  // See PyramidHandle::abandon().
  void abandon() {
    (void)extractor_.release();
    (void)mutex_.release();
    new std::shared_ptr<const Pyramid>(std::move(pyramid_));
    pyramid_.reset();
    meshes_.clear();
  }

 private:
  static constexpr std::size_t kMostIdle = 2;

  ExtractionReport extractPart(const Query& query, const ShareNumber& share, SurfaceMesh& mesh) {
    const ExtractionPlan plan = extractor().plan(query);
    const NumberRun run = bricksOf(plan, share);
    return extractor().execute(plan, run.first, run.count, mesh);
  }

  std::mutex& mutex() {
    if (!mutex_) throw Error("the session is of the process that forked; make another one");
    return *mutex_;
  }
  Extractor& extractor() { return *extractor_; }
  const GridGeometry& geometry() const {
    if (!pyramid_) throw Error("the session is of the process that forked; make another one");
    return pyramid_->spec().geometry;
  }

  // One that no array holds, or a new one; of those that are idle a few are kept.
  std::shared_ptr<MeshData> idleMesh() {
    const auto is_idle = [](const std::shared_ptr<MeshData>& mesh) {
      return mesh.use_count() == 1;
    };
    std::shared_ptr<MeshData> found;
    if (const auto at = std::find_if(meshes_.begin(), meshes_.end(), is_idle); at != meshes_.end())
      found = *at;
    std::size_t idle = 0;
    std::erase_if(meshes_, [&](const std::shared_ptr<MeshData>& mesh) {
      return is_idle(mesh) && ++idle > kMostIdle;
    });
    if (found) return found;
    meshes_.push_back(std::make_shared<MeshData>());
    return meshes_.back();
  }

  std::shared_ptr<const Pyramid> pyramid_;
  std::unique_ptr<Extractor> extractor_;  // goes before the pyramid
  std::unique_ptr<std::mutex> mutex_;     // one call at a time
  std::vector<std::shared_ptr<MeshData>> meshes_;
};

// The memory of one mesh between calls of isosurface(), unless it is large: a loop over volumes
// touches no fresh memory.
class IdleMesh {
 public:
  // It, if no array holds it any more; else a new one, which takes its place.
  std::shared_ptr<MeshData> take() {
    const std::lock_guard lock(mutex_);
    if (mesh_.use_count() != 1) mesh_ = std::make_shared<MeshData>();
    return mesh_;
  }
  void forgetIfLarge(const MeshData& mesh) {
    constexpr std::uint64_t kMostVertices = std::uint64_t{1} << 22;  // some 200 MB with triangles
    const std::lock_guard lock(mutex_);
    if (mesh_.get() == &mesh && mesh.vertices() > kMostVertices) mesh_.reset();
  }

 private:
  std::mutex mutex_;
  std::shared_ptr<MeshData> mesh_;
};

}  // namespace

nb::object isosurfaceOf(const VolumeInfo& info, const nb::object& settings,
                        const MeshExtraction& extract) {
  static auto* const idle = new IdleMesh;
  Query query = readQuery(settings, info.geometry, info.voxels);
  const CallOptions call = readCall(settings);
  const std::vector<FieldWish> wishes = readFields(settings);
  const PieceChoice pieces = readPieces(settings);
  const std::shared_ptr<MeshData> mesh = idle->take();
  runInterruptibly(call, [&](CallState& state) {
    query.cancel = &state.cancel();
    query.fraction_done = &state.fraction();
    std::vector<MeshField> fields = fieldsOf(wishes, query, nullptr, nullptr, state.cancel());
    const ExtractionReport report = extract(query, mesh->surface(), state);
    mesh->filled(frameOf(info.geometry, info.voxels, false, query), query, report,
                 std::move(fields));
    if (pieces.isGiven()) mesh->keepPieces(pieces, &state.cancel());
  });
  idle->forgetIfLarge(*mesh);
  return nb::cast(MeshHandle{mesh});
}

void bindQueries(nb::module_& module) {
  nb::class_<MeshHandle>(module, "MeshHandle")
      .def("points", &meshPoints, nb::sig("def points(self) -> numpy.typing.NDArray[typing.Any]"))
      .def("index_points", &meshIndexPoints,
           nb::sig("def index_points(self) -> numpy.typing.NDArray[numpy.float64]"))
      .def(
          "faces",
          [](const MeshHandle& m) {
            return m.rows<std::uint32_t, 3>(m.data->surface().triangles().data(),
                                            m.data->triangles());
          },
          nb::sig("def faces(self) -> numpy.typing.NDArray[numpy.uint32]"))
      .def(
          "normals",
          [](const MeshHandle& m) {
            return m.rows<float, 3>(
                reinterpret_cast<const float*>(m.data->surface().normals().data()),
                m.data->vertices());
          },
          nb::sig("def normals(self) -> numpy.typing.NDArray[numpy.float32]"))
      .def(
          "levels",
          [](const MeshHandle& m) {
            return m.row(m.made([](MeshData& d) { return d.levels(); }), m.data->triangles());
          },
          nb::sig("def levels(self) -> numpy.typing.NDArray[numpy.uint8]"))
      .def(
          "caps",
          [](const MeshHandle& m) {
            return m.row(m.made([](MeshData& d) { return d.caps(); }), m.data->triangles());
          },
          nb::sig("def caps(self) -> numpy.typing.NDArray[numpy.bool_]"))
      .def("attributes", &meshAttributes,
           nb::sig("def attributes(self) -> dict[str, numpy.typing.NDArray[typing.Any]]"))
      .def("components", &meshComponents,
           nb::sig("def components(self) -> tuple[list[tuple[typing.Any, ...]], "
                   "numpy.typing.NDArray[numpy.uint32]]"))
      .def("check", &checkMesh, nb::sig("def check(self) -> dict[str, typing.Any]"))
      .def(
          "report",
          [](const MeshHandle& m) { return reportOf(m.data->report(), m.data->isOfPieces()); },
          nb::sig("def report(self) -> dict[str, typing.Any]"))
      .def("unit",
           [](const MeshHandle& m) {
             return std::string(lengthUnitName(m.data->frame().geometry.unit));
           })
      .def("save", &saveMesh, nb::arg("path"), nb::arg("colors").none(), nb::arg("zlib"),
           nb::arg("meshopt"), nb::arg("placement"));
  module.def("save_together", &saveTogether, nb::arg("meshes"), nb::arg("path"),
             nb::arg("are_labels"), nb::arg("zlib"), nb::arg("meshopt"), nb::arg("placement"));
  module.def("merge_shares", &mergeShares, nb::arg("paths"), nb::arg("out"), nb::arg("zlib"),
             nb::arg("meshopt"), nb::arg("placement"), nb::arg("force"), nb::arg("threads"),
             nb::arg("cancel").none(),
             nb::sig("def merge_shares(paths: list[str], out: str, zlib: bool, meshopt: bool, "
                     "placement: tuple[str, str, tuple[float, float, float]], force: bool, "
                     "threads: int, cancel: Cancel | None) -> dict[str, typing.Any]"));
  nb::class_<Session>(module, "SessionHandle")
      .def(nb::init<const PyramidHandle&>(), nb::arg("pyramid"))
      .def("extract", &Session::extract, nb::arg("settings"), nb::arg("is_progressive"))
      .def("extract_to", &Session::extractTo,
           nb::sig("def extract_to(self, settings: object, path: str, colors: object, zlib: bool, "
                   "meshopt: bool, placement: tuple[str, str, tuple[float, float, float]], "
                   "force: bool) -> dict[str, typing.Any]"),
           nb::arg("settings"), nb::arg("path"), nb::arg("colors").none(), nb::arg("zlib"),
           nb::arg("meshopt"), nb::arg("placement"), nb::arg("force"))
      .def("wait_for_bricks", &Session::waitForBricks, nb::arg("seconds"))
      .def("meshes", &Session::meshes)
      .def("abandon", &Session::abandon);
}

}  // namespace isobrick::python
