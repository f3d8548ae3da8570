#include "tools/neuroglancer/precomputed_meshes.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <utility>

#include "isobrick/preprocess/export/atomic_folder.h"
#include "isobrick/preprocess/shallow_json.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/lowercase.h"
#include "tools/neuroglancer/fragment_sink.h"
#include "tools/neuroglancer/precomputed_meshes.h"

namespace isobrick {

namespace {

namespace fs = std::filesystem;

constexpr std::uintmax_t kMostInfoBytes = std::uintmax_t{16} << 20;

}  // namespace

std::string neuroglancerTypeOf(const std::string& folder) {
  const fs::path path = fs::path(folder) / "info";
  if (!isRegularFile(path) || fileBytes(path) > kMostInfoBytes) return "";
  std::ifstream in(path, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  return textOf(member(parseShallowJson(text), "@type"));
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

nlohmann::ordered_json placeInWorld(const GridGeometry& geometry) {
  const auto listOf = [](const glm::dvec3& v) { return nlohmann::ordered_json{v.x, v.y, v.z}; };
  nlohmann::ordered_json columns = nlohmann::ordered_json::array();
  for (int axis = 0; axis < 3; ++axis)
    columns.push_back(listOf(glm::dvec3(geometry.direction[axis])));
  return {{"space", "LPS"}, {"origin", listOf(geometry.origin)}, {"direction", columns}};
}
namespace {

namespace fs = std::filesystem;
using MeshInfo = nlohmann::ordered_json;

constexpr char kMeshType[] = "neuroglancer_multilod_draco";
constexpr char kPropertiesFolder[] = "segment_properties";
constexpr double kNanometres = 1e6;  // in a millimetre

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
