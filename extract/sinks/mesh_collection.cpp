#include "isobrick/extract/sinks/mesh_collection.h"

#include <algorithm>
#include <limits>
#include <span>
#include <utility>

#include "isobrick/extract/sinks/mesh_formats.h"
#include "isobrick/extract/sinks/mesh_placement.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

// Gives every object its place.
class PlacedCollection : public MeshCollection {
 public:
  PlacedCollection(std::unique_ptr<MeshCollection> objects, const MeshPlacement& placement)
      : objects_(std::move(objects)), placement_(placement) {}

  std::unique_ptr<MeshFileSink> add(const MeshObject& object) override {
    return placedSink(objects_->add(object), placement_);
  }
  void finish() override { objects_->finish(); }

 private:
  const std::unique_ptr<MeshCollection> objects_;
  const MeshPlacement placement_;
};

// The label of the object that is being written, at all vertices.
struct LabelValue : VertexValues {
  void evaluate(std::span<const glm::dvec3>, std::span<const glm::vec3>,
                std::span<double> values) const override {
    std::ranges::fill(values, label);
  }
  double label = 0;
};

// One mesh of all labels.
class LabelledMesh : public MeshCollection {
 public:
  LabelledMesh(const std::string& path, MeshFileOptions options) : path_(path) {
    has_attribute_ = meshFormatOf(path, options).has_attributes;
    if (has_attribute_) options.attributes.push_back({"label", &value_, AttributeType::kUint32});
    file_ = makeMeshFileSink(path, options);
  }

  std::unique_ptr<MeshFileSink> add(const MeshObject& object) override {
    if (has_attribute_ && object.label > std::numeric_limits<std::uint32_t>::max())
      throw meshError(
          path_, "the label " + std::to_string(object.label) +
                     " is no number of 32 bits, as vertices have it there; write .glb, .3mf or "
                     ".obj, or a file of each label");
    return std::make_unique<Part>(*this, object);
  }
  void finish() override { file_->finish(); }

 private:
  // Passes an object on to the file.
  class Part : public MeshFileSink {
   public:
    Part(LabelledMesh& all, const MeshObject& object) : all_(all), object_(object) {}

    void begin(const MeshFrame& frame) override {
      if (!std::exchange(all_.has_begun_, true)) all_.file_->begin(frame);
      all_.file_->beginObject(object_.name);
      all_.value_.label = static_cast<double>(object_.label);
      before_ = all_.file_->vertices();
    }
    void prepare(PlacedBatch& placed) override { all_.file_->prepare(placed); }
    void place(PlacedBatch& placed) override { all_.file_->place(placed); }
    void write(PlacedBatch& placed) override { all_.file_->write(placed); }
    void finish() override { vertices_ = all_.file_->vertices() - before_; }
    std::uint64_t vertices() const override { return vertices_; }

   private:
    LabelledMesh& all_;
    const MeshObject object_;
    std::uint64_t before_ = 0, vertices_ = 0;
  };

  const std::string path_;
  LabelValue value_;
  bool has_attribute_ = false, has_begun_ = false;
  std::unique_ptr<MeshFileSink> file_;
};

}  // namespace

std::unique_ptr<MeshCollection> makeLabelCollection(const std::string& path,
                                                    const MeshFileOptions& options) {
  const std::string end = lowerExtension(path);
  if (end != ".ply" && end != ".vtp" && end != ".obj") return makeMeshCollection(path, options);
  return std::make_unique<LabelledMesh>(path, options);
}

std::unique_ptr<MeshCollection> makeMeshCollection(const std::string& path,
                                                   const MeshFileOptions& options) {
  const MeshFormat& format = meshFormatOf(path, options);
  if (format.make_several == nullptr)
    throw meshError(path, std::string("a mesh as ") + format.extension +
                              " holds one surface; write .glb or .3mf, or a file of each");
  auto objects = format.make_several(path, options);
  if (options.placement == MeshPlacement()) return objects;
  return std::make_unique<PlacedCollection>(std::move(objects), options.placement);
}

}  // namespace isobrick
