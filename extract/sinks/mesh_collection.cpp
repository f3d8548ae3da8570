#include "isobrick/extract/sinks/mesh_collection.h"

#include <utility>

#include "isobrick/extract/sinks/mesh_formats.h"
#include "isobrick/extract/sinks/mesh_placement.h"
#include "isobrick/storage/error.h"

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

}  // namespace

std::unique_ptr<MeshCollection> makeMeshCollection(const std::string& path,
                                                   const MeshFileOptions& options) {
  const MeshFormat& format = meshFormatOf(path, options);
  if (format.make_several == nullptr)
    throw Error("'" + path + "': a mesh as " + format.extension +
                    " holds one surface; write .glb or .3mf, or a file of each",
                {.path = path});
  auto objects = format.make_several(path, options);
  if (options.placement == MeshPlacement()) return objects;
  return std::make_unique<PlacedCollection>(std::move(objects), options.placement);
}

}  // namespace isobrick
