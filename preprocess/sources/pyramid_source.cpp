#include <utility>

#include "isobrick/preprocess/kernels/sample_block.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/shallow_json.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/storage/deviation_code.h"
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

// Something of a level that is read brick by brick: a brick has `brick_voxels` of it along an axis.
class BrickSource : public VolumeSource {
 public:
  BrickSource(std::shared_ptr<const Pyramid> pyramid, std::uint64_t budget_bytes, int level,
              const CancelFlag* cancel, PartKind part, std::int64_t brick_voxels)
      : pyramid_(std::move(pyramid)),
        level_(level),
        budget_bytes_(budget_bytes),
        cancel_(cancel),
        part_(part),
        brick_voxels_(brick_voxels) {
    info_.voxel_type = pyramid_->spec().voxel_type;
    info_.values = pyramid_->spec().values;
    info_.range = pyramid_->realRange();
    info_.geometry = pyramid_->spec().geometry;
    info_.source = pyramid_->path();
    info_.format = "isobrick pyramid";
    info_.encoding = concat("level ", level);
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
    const IndexBox whole{first_ + box.first, box.count};
    const Index3 last = pyramid_->layout().bricks(level_) - Index3(1);
    const Index3 begin = glm::min(whole.first / brick_voxels_, last);
    const Index3 end = glm::min((whole.end() - Index3(1)) / brick_voxels_, last) + Index3(1);
    const Index3 count = end - begin;
    if (bytes().isRemote()) announceBricks(begin, count);
    isolatedFor(std::int64_t{0}, elementCount(count), [&](std::int64_t i) {
      if (cancel_ != nullptr) cancel_->check();
      const Index3 brick = begin + indexAt(i, count);
      copyBrick(brick, whole, out);
      pyramid_->throwIfReadsFailed(level_, brick);
    });
  }

 protected:
  // What the brick has of `box`, to its place in `out`, which is the box.
  virtual void copyBrick(const Index3& brick, const IndexBox& box, void* out) const = 0;

  const std::shared_ptr<const Pyramid> pyramid_;
  const int level_;
  VolumeInfo info_;
  Index3 first_{0};  // of all that the level has, the one that is voxel (0,0,0)

 private:
  const PagedFile& bytes() const { return pyramid_->parts().tables().bytes(); }

  void announceBricks(const Index3& begin, const Index3& count) const {
    std::vector<PyramidParts::PartAddress> parts;
    forEachIndex({begin, count}, [&](const Index3& brick) {
      parts.push_back({part_, level_, brick});
    });
    pyramid_->parts().announce(parts);
  }

  const std::uint64_t budget_bytes_;
  const CancelFlag* const cancel_;
  const PartKind part_;
  const std::int64_t brick_voxels_;
};

class PyramidSource final : public BrickSource {
 public:
  PyramidSource(const std::shared_ptr<const Pyramid>& pyramid, std::uint64_t budget_bytes,
                int level, const CancelFlag* cancel)
      : BrickSource(pyramid, budget_bytes, level, cancel, PartKind::kSamples,
                    pyramid->layout().brickCells()) {
    const Lattice& lattice = pyramid_->lattice();
    info_.voxels = lattice.samples(level);
    info_.geometry.spacing *= static_cast<double>(std::int64_t{1} << level);
    takeProvenance(*pyramid_, info_);
    info_.properties["pyramid.filter"] = filterName(pyramid_->spec().filter);
    for (int axis = 0; axis < 3; ++axis) {
      const std::int64_t last = info_.voxels[axis] - 1;
      const std::int64_t beyond = (last << level) - lattice.position(level, axis, last);
      if (beyond > 0)
        info_.notes.push_back(concat(
            "level ", level, ": the last sample along ", "xyz"[axis], " repeats the border voxel, ",
            beyond, beyond == 1 ? " voxel" : " voxels", " nearer than a regular grid says"));
    }
  }

 private:
  void copyBrick(const Index3& brick, const IndexBox& box, void* out) const override {
    const IndexBox own = intersectionOf(pyramid_->layout().brickOwnSamples(level_, brick), box);
    if (own.size() == 0) return;
    const BrickSamples samples = pyramid_->samples(level_, brick);
    visitVoxelType(info_.voxel_type, [&](auto tag) {
      using T = typename decltype(tag)::Type;
      copyBox(SampleBlock<T>::dense(samples.data<T>(), samples.box), own, static_cast<T*>(out),
              box);
    });
  }
};

// Voxels are tiles, or cells of level 1.
class NodeSource final : public BrickSource {
 public:
  NodeSource(const std::shared_ptr<const Pyramid>& pyramid, std::uint64_t budget_bytes,
             NodeValue value, int level, const IndexBox& voxels, const CancelFlag* cancel)
      : BrickSource(pyramid, budget_bytes, level, cancel,
                    isRange(value) ? PartKind::kRanges : PartKind::kCurvature,
                    pyramid->layout().brickCells() / nodeCells(*pyramid, value)),
        value_(value) {
    const std::int64_t edge = nodeCells(*pyramid, value) << level;  // in voxels of level 0
    first_ = voxels.first / edge;
    const Index3 end = BrickLayout::ceilDivide(voxels.end() - Index3(1), edge);
    info_.voxels = glm::max(end - first_, Index3(1));
    info_.geometry.origin =
        info_.geometry.indexToWorld((glm::dvec3(first_) + 0.5) * static_cast<double>(edge));
    info_.geometry.spacing *= static_cast<double>(edge);
    if (!isRange(value)) {
      info_.voxel_type = VoxelType::kFloat32;
      info_.values = {};
    }
    info_.properties["vdb.nodes"] = value == NodeValue::kLeast ? "min"
                                    : value == NodeValue::kGreatest
                                        ? "max"
                                        : "curvature_" + std::to_string(coefficientOf(value));
    info_.properties["vdb.level"] = std::to_string(level);
  }

 private:
  static bool isRange(NodeValue value) { return value <= NodeValue::kGreatest; }
  static std::size_t coefficientOf(NodeValue value) {
    return static_cast<std::size_t>(value) - static_cast<std::size_t>(NodeValue::kCurvature);
  }
  static std::int64_t nodeCells(const Pyramid& pyramid, NodeValue value) {
    return isRange(value) ? pyramid.layout().tileCells() : pyramid.layout().curvatureCells();
  }

  void copyBrick(const Index3& brick, const IndexBox& box, void* out) const override {
    const BrickLayout& layout = pyramid_->layout();
    const std::int64_t nodes = layout.brickCells() / nodeCells(*pyramid_, value_);
    std::vector<ValueRange> ranges;
    std::vector<std::uint8_t> codes;
    IndexBox own{brick * nodes, {}};
    if (isRange(value_)) {
      own.count = layout.brickTiles(level_, brick);
      pyramid_->tileRanges(level_, brick, ranges);
    } else {
      own.count = layout.brickCurvatureBlocks(brick);
      pyramid_->parts().curvature(brick, codes);
    }
    const auto valueAt = [&](std::size_t i) {
      return !isRange(value_)
                 ? DeviationCode::decode(codes[kDeviationCoefficients * i + coefficientOf(value_)])
             : value_ == NodeValue::kLeast ? ranges[i].min
                                           : ranges[i].max;
    };
    visitVoxelType(info_.voxel_type, [&](auto tag) {
      using T = typename decltype(tag)::Type;
      std::vector<T> values(static_cast<std::size_t>(own.size()));
      for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<T>(valueAt(i));
      copyBox(SampleBlock<T>::dense(values.data(), own), intersectionOf(own, box),
              static_cast<T*>(out), box);
    });
  }

  const NodeValue value_;
};

}  // namespace

std::unique_ptr<VolumeSource> makePyramidSource(std::shared_ptr<const Pyramid> pyramid,
                                                std::uint64_t budget_bytes, int level,
                                                const CancelFlag* cancel) {
  const int levels = pyramid->lattice().levels();
  if (level < 0 || level >= levels)
    throw Error(concat("'", pyramid->path(), "' has the levels 0 to ", levels - 1, ", and not ",
                       level, "; choose one of these"),
                {.path = pyramid->path(), .level = level});
  return std::make_unique<PyramidSource>(std::move(pyramid), budget_bytes, level, cancel);
}

std::unique_ptr<VolumeSource> makeNodeSource(const std::shared_ptr<const Pyramid>& pyramid,
                                             std::uint64_t budget_bytes, NodeValue value, int level,
                                             const IndexBox& voxels, const CancelFlag* cancel) {
  if (value >= NodeValue::kCurvature && !pyramid->spec().has_curvature)
    throw fileError(pyramid->path(), "'", pyramid->path(), "' holds no curvature",
                    Remedy::kBuildWithCurvature);
  return std::make_unique<NodeSource>(pyramid, budget_bytes, value, level, voxels, cancel);
}

}  // namespace isobrick
