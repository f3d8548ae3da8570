#include "tools/bench/isobrick_engine.h"

#include <optional>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/surface_mesh.h"

namespace isobrick {
namespace {

class IsobrickEngine : public SurfaceEngine {
 public:
  IsobrickEngine(const std::string& path, std::uint64_t budget_bytes, FileAccess access,
                 const Query& query)
      : path_(path), budget_bytes_(budget_bytes), access_(access), query_(query) {}

  void load() override {
    pyramid_.emplace(path_, budget_bytes_, access_);
    extractor_.emplace(*pyramid_);
  }

  void extract() override { extractor_->extract(query_, mesh_); }

  SurfaceSize size() const override {
    return {mesh_.triangles().size() / 3, mesh_.positions().size(),
            mesh_.positions().size_bytes() + mesh_.normals().size_bytes() +
                mesh_.triangles().size_bytes() + mesh_.parts().size() * sizeof(SurfaceMesh::Part)};
  }

  PlainMesh mesh() const override {
    PlainMesh plain;
    plain.positions.reserve(mesh_.positions().size());
    for (const SurfaceMesh::Part& part : mesh_.parts()) {
      const glm::vec3 origin(part.origin);
      for (const glm::vec3& local : mesh_.positions().subspan(part.first_vertex, part.vertices)) {
        const glm::vec3 index = origin + local;
        plain.positions.push_back({index.x, index.y, index.z});
      }
    }
    const auto triangles = mesh_.triangles();
    plain.triangles.reserve(triangles.size() / 3);
    for (std::size_t i = 0; i + 2 < triangles.size(); i += 3)
      plain.triangles.push_back({triangles[i], triangles[i + 1], triangles[i + 2]});
    return plain;
  }

  std::string note() const override { return "one session, into the memory of the surface before"; }

 private:
  std::string path_;
  std::uint64_t budget_bytes_;
  FileAccess access_;
  Query query_;
  std::optional<Pyramid> pyramid_;
  std::optional<Extractor> extractor_;
  SurfaceMesh mesh_;
};

}  // namespace

std::unique_ptr<SurfaceEngine> makeIsobrickEngine(const std::string& path,
                                                  std::uint64_t budget_bytes, FileAccess access,
                                                  const Query& query) {
  return std::make_unique<IsobrickEngine>(path, budget_bytes, access, query);
}

}  // namespace isobrick
