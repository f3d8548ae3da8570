// A renderer that draws nothing and remembers what it was asked for, of frames the last: for tests.
#pragma once

#include <deque>
#include <limits>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

#include "isobrick/viewer/render/scene_renderer.h"

namespace isobrick {

class NullRenderer : public SceneRenderer {
 public:
  struct Kept {
    std::uint64_t bytes = 0;
    std::uint64_t triangles = 0;
    int level = 0;
    int surface = 0;
    std::uint64_t uploaded = 0;  // bytes
  };

  bool is_software = true;

  ChunkId reserve(const SurfaceChunk& chunk) override {
    kept_[++last_] = {chunk.bytes(), chunk.triangles.size() / 3, chunk.level, chunk.surface};
    bytes_ += chunk.bytes();
    return last_;
  }
  bool uploadPiece(ChunkId id, const SurfaceChunk&, std::size_t begin, std::size_t bytes) override {
    if (pieces_left == 0) return false;
    --pieces_left;
    Kept& kept = kept_.at(id);
    if (begin != kept.uploaded || begin + bytes > kept.bytes || bytes > kPieceBytes)
      throw std::logic_error("a piece that is none");
    kept.uploaded += bytes;
    uploaded_bytes_ += bytes;
    return true;
  }
  void endUploads() override { ++ended_uploads_; }
  ChunkId upload(const SurfaceChunk& chunk) override {
    const ChunkId id = reserve(chunk);
    kept_.at(id).uploaded = chunk.bytes();
    uploaded_bytes_ += chunk.bytes();
    return id;
  }
  void release(ChunkId chunk) noexcept override {
    bytes_ -= kept_.at(chunk).bytes;
    kept_.erase(chunk);
  }
  // Keeps no vertices.
  SurfaceChunk download(ChunkId chunk) const override {
    SurfaceChunk kept;
    kept.level = kept_.at(chunk).level;
    kept.surface = kept_.at(chunk).surface;
    return kept;
  }
  SliceId reserveSlice(int width, int height) override {
    slices_[++last_slice_] = {width, height, 0};
    return last_slice_;
  }
  void uploadRows(SliceId slice, const SliceImage& image, int first, int count) override {
    KeptSlice& kept = slices_.at(slice);
    if (first != kept.rows || image.width != kept.width || image.height != kept.height ||
        first + count > image.height)
      throw std::logic_error("rows that are none");
    kept.rows += count;
    uploaded_bytes_ += sizeof(float) * static_cast<std::uint64_t>(image.width * count);
  }
  int greatestSlice() const override { return greatest_slice; }
  void releaseSlice(SliceId slice) override {
    if (slices_.erase(slice) == 0) throw std::logic_error("a slice that is not kept");
    released_slices_.push_back(slice);
  }
  std::uint64_t bytesKept() const override { return bytes_; }
  void draw(const SceneFrame& frame) override {
    for (const ChunkId chunk : frame.chunks) {
      const Kept& kept = kept_.at(chunk);  // throws: not kept
      if (kept.uploaded != kept.bytes) throw std::logic_error("a chunk of which a part is lacking");
    }
    for (const SceneSlice& slice : frame.slices)
      if (slices_.at(slice.image).rows != slices_.at(slice.image).height)
        throw std::logic_error("a slice of which a part is lacking");
    frame_ = frame;
    ++draws_;
  }
  Image drawTile(const SceneFrame& frame, const PixelBox& tile, bool) override {
    draw(frame);
    return {tile.width, tile.height,
            std::vector<float>(3 * static_cast<std::size_t>(tile.width) *
                               static_cast<std::size_t>(tile.height))};
  }
  void endTiles() override {}
  int neighbourhoodOf(const SceneFrame&) const override { return 0; }
  // What tests want to be hit.
  std::uint64_t askDistance(const glm::dvec2&) override {
    answers_.push_back({++distances_read_, distance});
    return distances_read_;
  }
  std::optional<DistanceAnswer> takeDistance() override {
    if (answers_.empty() || answers_late) return std::nullopt;
    const DistanceAnswer answer = answers_.front();
    answers_.pop_front();
    return answer;
  }
  Image picture() override { return {}; }
  bool isLost() override { return false; }
  const std::string& deviceName() const override { return device_name_; }
  bool isSoftware() const override { return is_software; }
  int greatestSize() const override { return 16384; }

  std::optional<double> distance;
  bool answers_late = false;  // while it is set, no distance comes
  int greatest_slice = 16384;
  // That it takes before it wants to be asked in a later frame.
  std::uint64_t pieces_left = std::numeric_limits<std::uint64_t>::max();

  const std::map<ChunkId, Kept>& kept() const { return kept_; }
  // What was drawn last, and how often something was.
  const SceneFrame& frame() const { return frame_; }
  std::uint64_t draws() const { return draws_; }
  // Width, height and the rows that were uploaded.
  struct KeptSlice {
    int width = 0, height = 0, rows = 0;
  };
  const std::map<SliceId, KeptSlice>& slices() const { return slices_; }
  std::uint64_t distancesRead() const { return distances_read_; }
  const std::vector<SliceId>& releasedSlices() const { return released_slices_; }
  std::uint64_t uploadedBytes() const { return uploaded_bytes_; }
  std::uint64_t endedUploads() const { return ended_uploads_; }

 private:
  std::string device_name_ = "none";
  std::map<ChunkId, Kept> kept_;
  std::map<SliceId, KeptSlice> slices_;
  SceneFrame frame_;
  std::vector<SliceId> released_slices_;
  ChunkId last_ = 0;
  SliceId last_slice_ = 0;
  std::uint64_t bytes_ = 0, uploaded_bytes_ = 0, ended_uploads_ = 0, draws_ = 0;
  std::uint64_t distances_read_ = 0;
  std::deque<DistanceAnswer> answers_;
};

}  // namespace isobrick
