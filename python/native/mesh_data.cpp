#include "mesh_data.h"

#include <sys/mman.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <new>
#include <type_traits>
#include <unordered_map>
#include <vector>

namespace isobrick::python {
namespace {

// Calls f(part, first vertex, end) for pieces of the mesh's parts, many at once.
template <typename F>
void forEachPiece(const SurfaceMesh& mesh, const F& f) {
  const std::vector<SurfaceMesh::Part>& parts = mesh.parts();
  tbb::parallel_for(std::size_t{0}, parts.size(), [&](std::size_t i) {
    f(parts[i], parts[i].first_vertex, parts[i].first_vertex + parts[i].vertices);
  });
}

template <typename Real>
void writePoints(const SurfaceMesh& mesh, const WorldPlacement& placement, Real* out) {
  forEachPiece(mesh, [&](const SurfaceMesh::Part& part, std::uint64_t begin, std::uint64_t end) {
    for (std::uint64_t v = begin; v < end; ++v) {
      const glm::dvec3 world = placement.worldPosition(part.origin, mesh.positions()[v]);
      for (int axis = 0; axis < 3; ++axis)
        out[3 * v + static_cast<std::uint64_t>(axis)] = static_cast<Real>(world[axis]);
    }
  });
}

// The parts of a mesh as the batches of a sink. Edge keys are only compared, so that the number of
// a vertex serves as one.
class PartBatches {
 public:
  explicit PartBatches(const SurfaceMesh& mesh)
      : mesh_(mesh), is_shared_(mesh.positions().size(), false) {
    for (const SurfaceMesh::Part& part : mesh_.parts())
      for (const std::uint32_t v : trianglesOf(part))
        if (v < part.first_vertex) is_shared_[v] = true;
  }

  void fill(const SurfaceMesh::Part& part, MeshBatch& batch) {
    batch.clear();
    batch.level = part.level;
    // Whatever tells the parts apart.
    const auto number = static_cast<std::int64_t>(&part - mesh_.parts().data());
    batch.brick = {number & 0x7ffff, number >> 19, 0};
    batch.cap_indices = static_cast<std::size_t>(3 * part.caps);
    batch.origin = part.origin;
    const auto first = static_cast<std::size_t>(part.first_vertex);
    const auto count = static_cast<std::size_t>(part.vertices);
    batch.positions.assign(&mesh_.positions()[0] + first, &mesh_.positions()[0] + first + count);
    batch.normals.assign(&mesh_.normals()[0] + first, &mesh_.normals()[0] + first + count);
    for (std::size_t v = 0; v < count; ++v)
      if (is_shared_[first + v])
        batch.shared.push_back({static_cast<std::uint32_t>(v), 0, first + v});
    std::unordered_map<std::uint32_t, std::uint32_t> place;
    for (const std::uint32_t v : trianglesOf(part))
      batch.triangles.push_back(v >= part.first_vertex
                                    ? v - static_cast<std::uint32_t>(part.first_vertex)
                                    : placeOf(v, part, place, batch));
  }

 private:
  std::span<const std::uint32_t> trianglesOf(const SurfaceMesh::Part& part) const {
    return mesh_.triangles().subspan(3 * part.first_triangle, 3 * part.triangles);
  }

  // A vertex that an earlier part brought goes behind the part's own.
  std::uint32_t placeOf(std::uint32_t v, const SurfaceMesh::Part& part,
                        std::unordered_map<std::uint32_t, std::uint32_t>& place,
                        MeshBatch& batch) const {
    const auto [at, is_new] = place.emplace(v, static_cast<std::uint32_t>(batch.positions.size()));
    if (is_new) {
      // Origins lie whole voxels apart and positions have room for them: the sum is exact.
      const glm::dvec3 shift(mesh_.partOfVertex(v).origin - part.origin);
      batch.positions.emplace_back(glm::vec3(glm::dvec3(mesh_.positions()[v]) + shift));
      batch.normals.push_back(mesh_.normals()[v]);
      batch.shared.push_back({at->second, 0, v});
    }
    return at->second;
  }

  const SurfaceMesh& mesh_;
  std::vector<bool> is_shared_;
};

// Of every triangle the component that its vertices have.
class TriangleComponents : public TriangleSink {
 public:
  explicit TriangleComponents(std::vector<std::uint32_t>& out) : out_(out) {}
  void place(PlacedBatch& placed) override {
    for (std::size_t i = 0; i < placed.batch.triangles.size(); i += 3)
      out_.push_back(placed.components[placed.batch.triangles[i]]);
  }

 private:
  std::vector<std::uint32_t>& out_;
};

}  // namespace

RoomyBytes::~RoomyBytes() {
  if (data_ != nullptr) ::munmap(data_, bytes_);
}

std::byte* RoomyBytes::room(std::size_t bytes) {
  constexpr std::size_t kStep = std::size_t{2} << 20;
  if (bytes <= bytes_ && data_ != nullptr) return data_;
  const std::size_t wanted = (bytes + kStep) / kStep * kStep;
  void* const at =
      ::mmap(nullptr, wanted, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (at == MAP_FAILED) throw std::bad_alloc();
  ::madvise(at, wanted, MADV_HUGEPAGE);  // if it is refused, small pages do
  if (data_ != nullptr) ::munmap(data_, bytes_);
  data_ = static_cast<std::byte*>(at);
  bytes_ = wanted;
  return data_;
}

void MeshData::filled(const MeshFrame& frame, const Query& query, const ExtractionReport& report,
                      std::vector<MeshField> fields) {
  frame_ = frame;
  is_cut_ = query.box || !query.region.isEverywhere();
  report_ = report;
  fields_ = std::move(fields);
  value_bytes_.clear();
  value_bytes_.resize(fields_.size());
  is_of_pieces_ = has_points_ = has_levels_ = has_caps_ = false;
}

std::vector<VertexAttribute> attributesOf(const std::vector<MeshField>& fields) {
  std::vector<VertexAttribute> attributes;
  for (const MeshField& field : fields)
    attributes.push_back({field.name, field.values.get(), field.type});
  return attributes;
}

const void* MeshData::points() {
  const bool doubles = hasDoubles();
  std::byte* const data =
      point_bytes_.room(3 * vertices() * (doubles ? sizeof(double) : sizeof(float)));
  if (has_points_) return data;
  const WorldPlacement placement(frame_.geometry);
  if (doubles)
    writePoints(surface_, placement, reinterpret_cast<double*>(data));
  else
    writePoints(surface_, placement, reinterpret_cast<float*>(data));
  has_points_ = true;
  return data;
}

void MeshData::indexPoints(double* out) const {
  writePoints(surface_, WorldPlacement(GridGeometry()), out);
}

const std::uint8_t* MeshData::levels() {
  auto* const data = reinterpret_cast<std::uint8_t*>(level_bytes_.room(triangles()));
  if (has_levels_) return data;
  for (const SurfaceMesh::Part& part : surface_.parts())
    std::fill_n(data + part.first_triangle, part.triangles, static_cast<std::uint8_t>(part.level));
  has_levels_ = true;
  return data;
}

const bool* MeshData::caps() {
  auto* const data = reinterpret_cast<bool*>(cap_bytes_.room(triangles()));
  if (has_caps_) return data;
  std::fill_n(data, triangles(), false);
  for (const SurfaceMesh::Part& part : surface_.parts())
    std::fill_n(data + part.first_triangle + part.triangles - part.caps, part.caps, true);
  has_caps_ = true;
  return data;
}

const void* MeshData::values(std::size_t number) {
  const MeshField& field = fields_.at(number);
  std::unique_ptr<RoomyBytes>& bytes = value_bytes_.at(number);
  if (bytes != nullptr) return bytes->room(0);
  auto made = std::make_unique<RoomyBytes>();
  std::byte* const data = made->room(vertices() * sizeof(double));
  const WorldPlacement placement(frame_.geometry);
  // Of one type in the array's memory; integers have no NaN.
  const auto put = [&]<typename Number>(Number, std::uint64_t begin, std::span<const double> from) {
    auto* const to = reinterpret_cast<Number*>(data) + begin;
    for (std::size_t i = 0; i < from.size(); ++i)
      to[i] = std::is_integral_v<Number> && std::isnan(from[i]) ? Number{0}
                                                                : static_cast<Number>(from[i]);
  };
  forEachPiece(surface_,
               [&](const SurfaceMesh::Part& part, std::uint64_t begin, std::uint64_t end) {
                 const auto count = static_cast<std::size_t>(end - begin);
                 std::vector<glm::dvec3> world;
                 world.reserve(count);
                 for (std::uint64_t v = begin; v < end; ++v)
                   world.push_back(placement.worldPosition(part.origin, surface_.positions()[v]));
                 std::vector<double> values(count);
                 field.values->evaluate(world, surface_.normals().subspan(begin, count), values);
                 switch (field.type) {
                   case AttributeType::kFloat32:
                     return put(float{}, begin, values);
                   case AttributeType::kFloat64:
                     return put(double{}, begin, values);
                   case AttributeType::kInt32:
                     return put(std::int32_t{}, begin, values);
                   case AttributeType::kUint32:
                     return put(std::uint32_t{}, begin, values);
                 }
               });
  bytes = std::move(made);
  return data;
}

void MeshData::passTo(TriangleSink& sink, const CancelFlag* cancel) const {
  sink.begin(frame_);
  PartBatches batches(surface_);
  PlacedBatch placed;
  for (const SurfaceMesh::Part& part : surface_.parts()) {
    if (cancel != nullptr) cancel->check();
    batches.fill(part, placed.batch);
    sink.prepare(placed);
    sink.place(placed);
    sink.write(placed);
  }
  sink.finish();
}

void MeshData::save(const std::string& path, MeshFileOptions options) const {
  options.attributes = attributesOf(fields_);
  passTo(*makeMeshFileSink(path, options), options.cancel);
}

MeshQuality MeshData::check(const CancelFlag* cancel) const {
  CountingSink counting;
  MeshCheck check(counting);
  passTo(check, cancel);
  return check.quality();
}

SurfaceComponents MeshData::components(std::vector<std::uint32_t>& of_triangle,
                                       const CancelFlag* cancel) const {
  Query query;
  query.cap = frame_.has_caps;
  if (is_cut_) query.box.emplace();
  ComponentFinder finder(query);
  passTo(finder, cancel);
  SurfaceComponents components = finder.take();
  TriangleComponents numbers(of_triangle);
  ComponentFilter filter(components, components.list().size(), numbers);
  passTo(filter, cancel);
  return components;
}

void MeshData::keepPieces(const PieceChoice& choice, const CancelFlag* cancel) {
  std::vector<std::uint32_t> of_triangle;
  const std::vector<std::uint8_t> pieces = choice.keptOf(components(of_triangle, cancel));
  std::vector<std::uint8_t> is_kept(of_triangle.size());
  for (std::size_t t = 0; t < is_kept.size(); ++t) is_kept[t] = pieces[of_triangle[t]];
  surface_.keep(is_kept);
  is_of_pieces_ = true;
  report_.triangles = triangles();
}

}  // namespace isobrick::python
