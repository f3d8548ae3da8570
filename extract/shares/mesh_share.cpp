// Writing a share: every batch as a record, at a place that is decided in order.
#include "isobrick/extract/shares/mesh_share.h"

#include <cassert>
#include <cstring>

#include "isobrick/extract/shares/share_format.h"
#include "isobrick/extract/simplify/batch_group.h"
#include "isobrick/extract/sinks/mesh_formats.h"
#include "isobrick/extract/sinks/vertex_numbering.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/checksum.h"
#include "isobrick/storage/stored_grid.h"

namespace isobrick {
namespace {

class MeshShareSink : public MeshFileSink {
 public:
  MeshShareSink(const std::string& path, const ExtractionPlan& plan, const ShareNumber& share,
                std::int64_t brick_cells, std::string identity, const CancelFlag* cancel)
      : file_(path), identity_(std::move(identity)), cancel_(cancel) {
    const NumberRun run = bricksOf(plan, share);
    header_.number = share.number;
    header_.of = share.of;
    header_.first_brick = run.first;
    header_.brick_count = run.count;
    header_.all_bricks = plan.bricks().size();
    if (!simplifiesGroups(plan.query())) return;
    header_.simplify_distance = plan.query().simplify->distance;
    header_.simplify_in_world = plan.query().simplify->in_world ? 1 : 0;
    header_.brick_cells = static_cast<std::uint32_t>(brick_cells);
  }

  bool takesRemains() const override { return true; }
  void begin(const MeshFrame& frame) override {
    storeGrid(frame.voxels, frame.geometry, header_);
    header_.inside = static_cast<std::uint32_t>(frame.inside);
    header_.has_caps = frame.has_caps ? 1 : 0;
  }

  void place(PlacedBatch& placed) override {
    numbering_.place(placed);
    placed.first_byte = end_;
    end_ += recordBytesOf(placed.batch);
    ++header_.batches;
    header_.triangles += placed.batch.triangles.size() / 3;
  }

  void write(PlacedBatch& placed) override {
    encode(placed, placed.bytes);
    file_.pwrite(placed.bytes.data(), placed.bytes.size(), placed.first_byte);
  }

  void finish() override {
    file_.continueFrom(end_);
    file_.write(identity_.data(), identity_.size());
    std::memcpy(header_.magic, share_format::kMagic, sizeof header_.magic);
    header_.version = share_format::kVersion;
    header_.file_bytes = file_.position();
    header_.identity_bytes = identity_.size();
    header_.identity_checksum = checksum64(identity_.data(), identity_.size());
    header_.header_checksum = checksum64(&header_, offsetof(share_format::Header, header_checksum));
    file_.pwrite(&header_, sizeof header_, 0);
    file_.commit(cancel_);
  }

  std::uint64_t vertices() const override { return numbering_.count(); }

 private:
  std::uint64_t recordBytesOf(const MeshBatch& batch) const {
    return share_format::recordBytes(batch.positions.size(), batch.triangles.size(),
                                     batch.shared.size(), header_.brick_cells > 0);
  }

  void encode(const PlacedBatch& placed, std::vector<std::byte>& bytes) const {
    const MeshBatch& batch = placed.batch;
    bytes.resize(recordBytesOf(batch));
    share_format::BatchRecord record = {};
    record.bytes = bytes.size();
    record.level = static_cast<std::uint32_t>(batch.level);
    record.is_uniform = batch.is_uniform ? 1 : 0;
    for (int axis = 0; axis < 3; ++axis) {
      record.brick[axis] = batch.brick[axis];
      record.origin[axis] = batch.origin[axis];
    }
    record.positions = static_cast<std::uint32_t>(batch.positions.size());
    record.indices = static_cast<std::uint32_t>(batch.triangles.size());
    record.shared = static_cast<std::uint32_t>(batch.shared.size());
    record.transition_indices = static_cast<std::uint32_t>(batch.transition_indices);
    record.cap_indices = static_cast<std::uint32_t>(batch.cap_indices);
    record.cells = batch.cells;
    record.transition_cells = batch.transition_cells;
    BytePointer to(bytes.data() + sizeof record);
    for (const auto* vectors : {&batch.positions, &batch.normals})
      for (const glm::vec3& v : *vectors) to.put(v.x, v.y, v.z);
    for (const std::uint32_t index : batch.triangles) to.put(index);
    for (const MeshBatch::SharedVertex& vertex : batch.shared)
      to.put(share_format::SharedRecord{vertex.vertex, vertex.batches, vertex.key});
    if (header_.brick_cells > 0) {
      for (const SimplifyRemains::Vertex& vertex : placed.remains->vertices) to.put(vertex);
      for (const Deviation& deviation : placed.remains->triangles) to.put(deviation);
    }
    std::memcpy(bytes.data(), &record, sizeof record);
    constexpr std::size_t kChecked = offsetof(share_format::BatchRecord, level);
    record.checksum = checksum64(bytes.data() + kChecked, bytes.size() - kChecked);
    std::memcpy(bytes.data(), &record, sizeof record);
  }

  AtomicFile file_;
  const std::string identity_;
  const CancelFlag* const cancel_;
  share_format::Header header_{};
  std::uint64_t end_ = sizeof(share_format::Header);
  VertexNumbering numbering_;
};

}  // namespace

NumberRun bricksOf(const ExtractionPlan& plan, const ShareNumber& share) {
  return runOfShare(plan.bricks().size(), share);
}

std::unique_ptr<MeshFileSink> makeMeshShareSink(const std::string& path, const Pyramid& pyramid,
                                                const ExtractionPlan& plan,
                                                const ShareNumber& share,
                                                const CancelFlag* cancel) {
  return std::make_unique<MeshShareSink>(path, plan, share, pyramid.layout().brickCells(),
                                         surfaceIdentity(pyramid, plan.query()), cancel);
}

}  // namespace isobrick
