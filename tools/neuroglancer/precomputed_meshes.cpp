#include "tools/neuroglancer/precomputed_meshes.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <glm/common.hpp>
#include <glm/matrix.hpp>
#include <iterator>
#include <limits>
#include <mutex>
#include <nlohmann/json.hpp>
#include <span>
#include <utility>

#include "isobrick/extract/sinks/side_file.h"
#include "isobrick/preprocess/export/atomic_folder.h"
#include "isobrick/preprocess/shallow_json.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/lowercase.h"
#include "tools/neuroglancer/draco_fragment.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

constexpr std::uintmax_t kMostInfoBytes = std::uintmax_t{16} << 20;

// The "@type" of the file info in the folder, such as "neuroglancer_multilod_draco"; empty if it
// has none.
std::string neuroglancerTypeOf(const std::string& folder) {
  const fs::path path = fs::path(folder) / "info";
  if (!isRegularFile(path) || fileBytes(path) > kMostInfoBytes) return "";
  std::ifstream in(path, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  return textOf(member(parseShallowJson(text), "@type"));
}

// The member "isobrick" of a file info, which keeps the place in the world.
nlohmann::ordered_json placeInWorld(const GridGeometry& geometry) {
  const auto listOf = [](const glm::dvec3& v) { return nlohmann::ordered_json{v.x, v.y, v.z}; };
  nlohmann::ordered_json columns = nlohmann::ordered_json::array();
  for (int axis = 0; axis < 3; ++axis)
    columns.push_back(listOf(glm::dvec3(geometry.direction[axis])));
  return {{"space", "LPS"}, {"origin", listOf(geometry.origin)}, {"direction", columns}};
}

using MeshInfo = nlohmann::ordered_json;

constexpr char kMeshType[] = "neuroglancer_multilod_draco";
constexpr char kPropertiesFolder[] = "segment_properties";
constexpr double kNanometres = 1e6;  // in a millimetre
constexpr int kFragmentBits = 16;    // of a coordinate within its fragment

std::string textOfInfo(const MeshInfo& info) { return info.dump(2) + "\n"; }

// Rows of three columns and a shift: from voxels to nanometres.
MeshInfo meshInfo(const GridGeometry& geometry) {
  MeshInfo transform = MeshInfo::array();
  for (int row = 0; row < 3; ++row) {
    const double scale = geometry.spacing[row] * kNanometres;
    for (int column = 0; column < 3; ++column) transform.push_back(row == column ? scale : 0.0);
    transform.push_back(scale / 2);
  }
  return {{"@type", kMeshType},
          {"vertex_quantization_bits", kFragmentBits},
          {"transform", transform},
          {"lod_scale_multiplier", 1.0},
          {"segment_properties", kPropertiesFolder},
          {"isobrick", placeInWorld(geometry)}};
}

MeshInfo propertiesInfo(const std::vector<PrecomputedMesh>& meshes) {
  MeshInfo ids = MeshInfo::array(), labels = MeshInfo::array();
  for (const PrecomputedMesh& mesh : meshes) {
    if (mesh.segment == 0) continue;
    ids.push_back(std::to_string(mesh.segment));
    labels.push_back(fmt::format("isovalue {}", mesh.isovalue));
  }
  return {
      {"@type", "neuroglancer_segment_properties"},
      {"inline",
       {{"ids", ids}, {"properties", {{{"id", "label"}, {"type", "label"}, {"values", labels}}}}}}};
}

// Little-endian, as the machine is.
class ManifestBytes {
 public:
  void putFloat(double value) { put(static_cast<float>(value)); }
  void putCount(std::uint64_t value) { put(static_cast<std::uint32_t>(value)); }
  const std::vector<char>& bytes() const { return bytes_; }

 private:
  template <typename T>
  void put(T value) {
    const char* const begin = reinterpret_cast<const char*>(&value);
    bytes_.insert(bytes_.end(), begin, begin + sizeof value);
  }
  std::vector<char> bytes_;
};

// A brick's part of the surface: a node of the format's octree.
struct MeshFragment {
  Index3 brick{0};
  std::uint32_t bytes = 0;   // packed; 0: it has no triangles
  std::uint64_t offset = 0;  // in the side file
  std::uint64_t triangles = 0;
};

// Bits of the three coordinates in turn, x lowest.
std::uint64_t mortonCode(const Index3& brick) {
  std::uint64_t code = 0;
  for (int bit = 0; bit < 21; ++bit)
    for (int axis = 0; axis < 3; ++axis)
      code |= (static_cast<std::uint64_t>(brick[axis]) >> bit & 1) << (3 * bit + axis);
  return code;
}

bool comesBefore(const MeshFragment& a, const MeshFragment& b) {
  return mortonCode(a.brick) < mortonCode(b.brick);
}

// A position within a fragment whose low corner is `low` and whose edge is `edge`, both in voxels:
// 0 is the low end of an axis, 2^16 - 1 the high one, 2^15 the middle. Vertices that two fragments
// share get coordinates of one and the same place: what is between them is closed.
glm::ivec3 fragmentPosition(const glm::dvec3& position, const Index3& low, std::int64_t edge) {
  constexpr double kMost = (1 << kFragmentBits) - 1;
  const glm::dvec3 share = (position - glm::dvec3(low)) / static_cast<double>(edge);
  return glm::ivec3(glm::clamp(glm::floor(share * kMost + 0.5), 0.0, kMost));
}

// Packs each batch of a uniform level, a fragment each, into a side file. Cells end where a brick
// and its eighths end, so that no triangle crosses their borders, as the format wants it.
class FragmentSink : public TriangleSink {
 public:
  // `edge`: voxels of level 0 along a brick. `spool` outlives it, and its first free byte is `end`.
  FragmentSink(std::int64_t edge, SideFile& spool, std::atomic<std::uint64_t>& end)
      : edge_(edge), spool_(spool), end_(end) {}

  void begin(const MeshFrame& frame) override {
    is_mirrored_ = glm::determinant(frame.geometry.direction) < 0;
  }
  void prepare(PlacedBatch& placed) override {
    auto& triangles = placed.batch.triangles;
    for (std::size_t t = 0; is_mirrored_ && t < triangles.size(); t += 3)
      std::swap(triangles[t], triangles[t + 1]);
  }
  void write(PlacedBatch& placed) override {
    const MeshBatch& batch = placed.batch;
    if (batch.triangles.empty()) return;
    std::vector<glm::ivec3> positions;
    positions.reserve(batch.positions.size());
    for (const glm::vec3& position : batch.positions)
      positions.push_back(fragmentPosition(glm::dvec3(batch.origin) + glm::dvec3(position),
                                           batch.brick * edge_, edge_));
    const std::vector<char> packed = packFragment(positions, batch.triangles);
    if (packed.size() > std::numeric_limits<std::uint32_t>::max())
      throw Error("a fragment of the mesh is larger than 4 GiB; build the pyramid with --brick 64");
    MeshFragment fragment{batch.brick, static_cast<std::uint32_t>(packed.size()),
                          end_.fetch_add(packed.size()), batch.triangles.size() / 3};
    spool_.pwrite(packed.data(), packed.size(), fragment.offset);
    const std::lock_guard lock(mutex_);
    fragments_.push_back(fragment);
  }

  // After the extraction: in the order of the bricks' Morton codes.
  std::vector<MeshFragment> takeFragments() {
    std::sort(fragments_.begin(), fragments_.end(), comesBefore);
    return std::move(fragments_);
  }

 private:
  const std::int64_t edge_;
  SideFile& spool_;
  std::atomic<std::uint64_t>& end_;
  bool is_mirrored_ = false;  // then triangles that turn left in the world turn right in voxels
  std::mutex mutex_;
  std::vector<MeshFragment> fragments_;
};

// Adds to the coarser level, without triangles, what holds a fragment of the finer one and is not
// there: a node without a parent would never be drawn. Both are in the order of Morton codes.
void addMissingParents(std::span<const MeshFragment> finer, std::vector<MeshFragment>& coarser) {
  std::vector<MeshFragment> missing;
  auto at = coarser.cbegin();
  for (const MeshFragment& child : finer) {  // so are their parents in order
    MeshFragment parent;
    parent.brick = child.brick / Index3(2);
    if (!missing.empty() && missing.back().brick == parent.brick) continue;
    at = std::lower_bound(at, coarser.cend(), parent, comesBefore);
    if (at == coarser.cend() || at->brick != parent.brick) missing.push_back(parent);
  }
  coarser.insert(coarser.end(), missing.begin(), missing.end());
  std::sort(coarser.begin(), coarser.end(), comesBefore);
}

using Levels = std::vector<std::vector<MeshFragment>>;

std::vector<char> manifestOf(const Levels& levels, std::int64_t edge) {
  ManifestBytes manifest;
  for (int axis = 0; axis < 3; ++axis) manifest.putFloat(static_cast<double>(edge));
  for (int axis = 0; axis < 3; ++axis) manifest.putFloat(0);  // the origin
  manifest.putCount(levels.size());
  // The length of a cell.
  for (std::size_t l = 0; l < levels.size(); ++l)
    manifest.putFloat(static_cast<double>(std::int64_t{1} << l));
  for (std::size_t i = 0; i < 3 * levels.size(); ++i) manifest.putFloat(0);  // offsets of vertices
  for (const auto& fragments : levels) manifest.putCount(fragments.size());
  for (const auto& fragments : levels) {
    for (int axis = 0; axis < 3; ++axis)
      for (const MeshFragment& fragment : fragments)
        manifest.putCount(static_cast<std::uint64_t>(fragment.brick[axis]));
    for (const MeshFragment& fragment : fragments) manifest.putCount(fragment.bytes);
  }
  return manifest.bytes();
}

// The fragments of all levels one after the other; returns their bytes.
std::uint64_t writeFragments(const Levels& levels, const SideFile& spool, const std::string& path,
                             const CancelFlag* cancel) {
  AtomicFile file(path);
  std::vector<char> packed;
  for (const auto& fragments : levels)
    for (const MeshFragment& fragment : fragments) {
      if (cancel != nullptr) cancel->check();
      packed.resize(fragment.bytes);
      if (packed.empty()) continue;
      spool.read(packed.data(), packed.size(), fragment.offset);
      file.write(packed.data(), packed.size());
    }
  file.commit(cancel);
  return file.position();
}

}  // namespace

std::vector<PrecomputedMesh> writePrecomputedMeshes(
    const Pyramid& pyramid, const std::vector<double>& isovalues, InsideOf inside,
    const std::string& path, const CancelFlag* cancel,
    const std::function<ExtractionReport(Extractor&, const Query&, TriangleSink&)>& through) {
  AtomicFolder folder(path);
  const auto writeText = [&](const std::string& name, const MeshInfo& info) {
    const std::string text = textOfInfo(info);
    folder.writeFile(name, text.data(), text.size());
  };
  Extractor extractor(pyramid);
  const std::int64_t edge = pyramid.layout().brickCells();
  std::vector<PrecomputedMesh> meshes;
  std::uint64_t segment = 0;
  for (const double isovalue : isovalues) {
    PrecomputedMesh mesh;
    mesh.isovalue = isovalue;
    SideFile spool(folder.temporaryPath() + "/mesh", "fragments");
    std::atomic<std::uint64_t> spooled{0};
    Levels levels;
    for (int level = 0; level < pyramid.lattice().levels(); ++level) {
      Query query;
      query.isovalue = isovalue;
      query.inside = inside;
      query.uniform_level = level;
      query.cancel = cancel;
      FragmentSink sink(edge << level, spool, spooled);
      mesh.triangles.push_back(through(extractor, query, sink).triangles);
      levels.push_back(sink.takeFragments());
      if (level > 0) addMissingParents(levels[levels.size() - 2], levels.back());
      mesh.fragments += levels.back().size();
    }
    // If the coarsest levels have lost the surface, finer ones are shown from afar.
    while (mesh.fragments > 0 && mesh.triangles[levels.size() - 1] == 0) {
      mesh.fragments -= levels.back().size();
      levels.pop_back();
    }
    if (mesh.fragments > 0) {
      mesh.segment = ++segment;
      const std::string name = std::to_string(mesh.segment);
      const std::vector<char> manifest = manifestOf(levels, edge);
      folder.writeFile(name + ".index", manifest.data(), manifest.size());
      mesh.bytes = manifest.size() +
                   writeFragments(levels, spool, folder.temporaryPath() + "/" + name, cancel);
    }
    meshes.push_back(std::move(mesh));
  }
  writeText("info", meshInfo(pyramid.spec().geometry));
  folder.makeFolder(kPropertiesFolder);
  writeText(std::string(kPropertiesFolder) + "/info", propertiesInfo(meshes));
  folder.commit(cancel);
  return meshes;
}

std::vector<std::string> neuroglancerLosses(const GridGeometry& geometry) {
  std::vector<std::string> lost;
  if (geometry.direction != glm::dmat3(1.0) || geometry.origin != glm::dvec3(0.0))
    lost.push_back(
        "Neuroglancer's format has no origin and no direction; they are kept in the member "
        "'isobrick' of its file info, which other programs ignore");
  if (geometry.unit != LengthUnit::kMillimetre)
    lost.push_back("the volume does not say its unit of length; Neuroglancer takes millimetres");
  return lost;
}

bool isPrecomputedName(const std::string& path) { return lowerExtension(path) == ".precomputed"; }

bool holdsPrecomputedMeshes(const std::string& folder) {
  if (neuroglancerTypeOf(folder) != kMeshType) return false;
  return holdsNothingBut(folder, [](const FolderMember& entry) {
    const fs::path name = entry.path().filename();
    if (name == kPropertiesFolder)
      return entry.isFolder() && !entry.isLink() &&
             holdsNothingBut(entry.path().string(), [](const FolderMember& inner) {
               return inner.name() == "info" && inner.isRegularFile();
             });
    const bool is_numbered =
        name.stem().string().find_first_not_of("0123456789") == std::string::npos &&
        (!name.has_extension() || name.extension() == ".index");
    return entry.isRegularFile() && (name == "info" || is_numbered);
  });
}

}  // namespace isobrick
