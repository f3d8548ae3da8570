#include <utility>

#include "isobrick/preprocess/kernels/sample_block.h"
#include "isobrick/preprocess/shallow_json.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/isolated_loop.h"
#include "isobrick/storage/pyramid_parts.h"

namespace isobrick {
namespace {

// The volume by the provenance; text of unknown origin, so nothing relies on it.
void takeProvenance(const Pyramid& pyramid, VolumeInfo& info) {
  const nlohmann::json json = parseShallowJson(pyramid.provenance());
  if (const auto& notes = member(json, "notes"); notes.is_array())
    for (const auto& note : notes)
      if (note.is_string()) info.notes.push_back(note.get<std::string>());
  if (const auto& kept = member(json, "properties"); kept.is_object())
    for (const auto& [key, value] : kept.items())
      if (value.is_string()) info.properties[key] = value.get<std::string>();
}

class PyramidSource final : public VolumeSource {
 public:
  PyramidSource(std::shared_ptr<const Pyramid> pyramid, std::uint64_t budget_bytes, int level,
                const CancelFlag* cancel)
      : pyramid_(std::move(pyramid)), budget_bytes_(budget_bytes), level_(level), cancel_(cancel) {
    const Lattice& lattice = pyramid_->lattice();
    info_.voxels = lattice.samples(level);
    info_.voxel_type = pyramid_->spec().voxel_type;
    info_.values = pyramid_->spec().values;
    info_.range = pyramid_->realRange();
    info_.geometry = pyramid_->spec().geometry;
    info_.geometry.spacing *= static_cast<double>(std::int64_t{1} << level);
    info_.source = pyramid_->path();
    info_.format = "isobrick pyramid";
    info_.encoding = "level " + std::to_string(level);
    takeProvenance(*pyramid_, info_);
    info_.properties["pyramid.filter"] = filterName(pyramid_->spec().filter);
    for (int axis = 0; axis < 3; ++axis) {
      const std::int64_t last = info_.voxels[axis] - 1;
      const std::int64_t beyond = (last << level) - lattice.position(level, axis, last);
      if (beyond > 0)
        info_.notes.push_back(
            std::string("level ") + std::to_string(level) + ": the last sample along " +
            "xyz"[axis] + " repeats the border voxel, " + std::to_string(beyond) +
            (beyond == 1 ? " voxel" : " voxels") + " nearer than a regular grid says");
    }
  }

  const VolumeInfo& info() const override { return info_; }
  // A file behind a URL ends its reads if it changes.
  std::vector<std::string> files() const override {
    return bytes().isRemote() ? std::vector<std::string>() : std::vector{bytes().path()};
  }
  std::string identity() const override { return bytes().identity(); }
  std::uint64_t bufferBytes() const override { return budget_bytes_; }
  bool readsBoxes() const override { return true; }

  void readBox(const IndexBox& box, void* out) const override {
    const std::int64_t cells = pyramid_->layout().brickCells();
    const Index3 last = pyramid_->layout().bricks(level_) - Index3(1);
    const Index3 begin = glm::min(box.first / cells, last);
    const Index3 end = glm::min((box.end() - Index3(1)) / cells, last) + Index3(1);
    const Index3 count = end - begin;
    if (bytes().isRemote()) announce(begin, count);
    isolatedFor(std::int64_t{0}, elementCount(count), [&](std::int64_t i) {
      if (cancel_ != nullptr) cancel_->check();
      copyBrick(begin + indexAt(i, count), box, out);
    });
  }

 private:
  const PagedFile& bytes() const { return pyramid_->parts().tables().bytes(); }

  void announce(const Index3& begin, const Index3& count) const {
    std::vector<PyramidParts::PartAddress> samples;
    forEachIndex({begin, count}, [&](const Index3& brick) {
      samples.push_back({PartKind::kSamples, level_, brick});
    });
    pyramid_->parts().announce(samples);
  }

  void copyBrick(const Index3& brick, const IndexBox& box, void* out) const {
    const IndexBox own = intersectionOf(pyramid_->layout().brickOwnSamples(level_, brick), box);
    if (own.size() == 0) return;
    const BrickSamples samples = pyramid_->samples(level_, brick);
    visitVoxelType(info_.voxel_type, [&](auto tag) {
      using T = typename decltype(tag)::Type;
      copyBox(SampleBlock<T>::dense(samples.data<T>(), samples.box), own, static_cast<T*>(out),
              box);
    });
    pyramid_->throwIfReadsFailed(level_, brick);
  }

  std::shared_ptr<const Pyramid> pyramid_;
  std::uint64_t budget_bytes_;
  int level_;
  const CancelFlag* cancel_;
  VolumeInfo info_;
};

}  // namespace

std::unique_ptr<VolumeSource> makePyramidSource(std::shared_ptr<const Pyramid> pyramid,
                                                std::uint64_t budget_bytes, int level,
                                                const CancelFlag* cancel) {
  const int levels = pyramid->lattice().levels();
  if (level < 0 || level >= levels)
    throw Error("'" + pyramid->path() + "' has the levels 0 to " + std::to_string(levels - 1) +
                    ", and not " + std::to_string(level) + "; choose one of these",
                {.path = pyramid->path(), .level = level});
  return std::make_unique<PyramidSource>(std::move(pyramid), budget_bytes, level, cancel);
}

}  // namespace isobrick
