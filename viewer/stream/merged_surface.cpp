#include "isobrick/viewer/stream/merged_surface.h"

#include <limits>
#include <map>
#include <new>
#include <utility>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/stream/chunk_sink.h"
#include "isobrick/viewer/stream/surface_set.h"

namespace isobrick {
namespace {

class ChunksInMemory : public ChunkStore {
 public:
  ChunkId reserve(const SurfaceChunk& chunk) override try {
    chunks_[last_ + 1] = chunk;
    return ++last_;
  } catch (const std::bad_alloc&) {
    chunks_.erase(last_ + 1);
    throw NoGraphicsMemory("no memory left for the surface");
  }
  bool uploadPiece(ChunkId, const SurfaceChunk&, std::size_t, std::size_t) override { return true; }
  void endUploads() override {}
  void release(ChunkId chunk) noexcept override { chunks_.erase(chunk); }

  const SurfaceChunk& at(ChunkId chunk) const { return chunks_.at(chunk); }

 private:
  std::map<ChunkId, SurfaceChunk> chunks_;
  ChunkId last_ = 0;
};

// False if no other chunk has the vertex. A brick that only leaves of its level touch shares those
// on its sides, and there the chunk ends; one beside finer leaves may share any.
bool mayBeShared(const SurfaceVertex& vertex, const SurfaceChunk& chunk) {
  if (!chunk.key) return true;
  for (glm::length_t c = 0; c < 3; ++c)
    if (vertex.position[c] == chunk.lower[c] || vertex.position[c] == chunk.upper[c]) return true;
  return false;
}

class Joiner {
 public:
  explicit Joiner(const GridGeometry& geometry)
      : matrix_(geometry.indexToWorldMatrix()), origin_(geometry.origin) {}

  void add(const SurfaceChunk& chunk) {
    numbers_.clear();
    for (const SurfaceVertex& vertex : chunk.vertices) numbers_.push_back(add(vertex, chunk));
    for (const std::uint32_t vertex : chunk.triangles) mesh_.triangles.push_back(numbers_[vertex]);
    mesh_.levels.resize(mesh_.triangles.size() / 3, static_cast<std::uint8_t>(chunk.level));
  }
  MergedSurface take() { return std::move(mesh_); }

 private:
  std::uint32_t add(const SurfaceVertex& vertex, const SurfaceChunk& chunk) {
    const std::size_t next = mesh_.vertices.size();
    if (mayBeShared(vertex, chunk)) {
      const std::uint64_t number = places_.numberOf(chunk, vertex, next);
      if (number != next) return static_cast<std::uint32_t>(number);
    }
    if (next > std::numeric_limits<std::uint32_t>::max())
      throw Error("the surface has more than 2^32 vertices; extract it into a file");
    mesh_.vertices.push_back(origin_ + matrix_ * (chunk.origin + glm::dvec3(vertex.position)));
    mesh_.normals.push_back(unpackNormal(vertex.normal));
    return static_cast<std::uint32_t>(next);
  }

  const glm::dmat3 matrix_;
  const glm::dvec3 origin_;
  VertexPlaces places_;
  std::vector<std::uint32_t> numbers_;  // of a chunk's vertices
  MergedSurface mesh_;
};

}  // namespace

struct SurfaceMerger::Kept {
  explicit Kept(const GridGeometry& of) : geometry(of) {}

  const GridGeometry geometry;
  ChunksInMemory store;
  SurfaceSet set{store, std::numeric_limits<std::uint64_t>::max()};
};

SurfaceMerger::SurfaceMerger(const GridGeometry& geometry)
    : kept_(std::make_unique<Kept>(geometry)) {}

SurfaceMerger::~SurfaceMerger() = default;

std::optional<StreamMessage> SurfaceMerger::next(SurfaceStream& stream) {
  std::optional<StreamMessage> end;
  const auto poll = [&]() -> std::optional<StreamMessage> {
    if (end) return std::nullopt;
    std::optional<StreamMessage> message = stream.poll();
    if (message && message->kind != StreamMessage::Kind::kChunk) end = *message;
    return message;
  };
  UploadAllowance all{std::numeric_limits<double>::infinity(),
                      std::numeric_limits<std::uint64_t>::max()};
  const SurfaceSet::News news = kept_->set.pump(
      poll, [] { return 0.0; }, all);
  if (end && end->kind == StreamMessage::Kind::kPassDone && !news.shows_another) {
    end->kind = StreamMessage::Kind::kFailed;
    end->error = news.stale ? "the pass leaves out bricks that are not there any longer"
                            : "no memory left for the surface";
  }
  return end;
}

MergedSurface SurfaceMerger::merged(int surface) const {
  Joiner joiner(kept_->geometry);
  for (const ChunkId id : kept_->set.shown()) {
    const SurfaceChunk& chunk = kept_->store.at(id);
    if (chunk.surface == surface) joiner.add(chunk);
  }
  return joiner.take();
}

}  // namespace isobrick
