#include "isobrick/viewer/session/drawn_scene.h"

#include <glm/common.hpp>
#include <map>

#include "isobrick/viewer/stream/chunk_sink.h"

namespace isobrick {

bool DrawnScene::draw(SceneRenderer& renderer, const SceneFrame& frame, bool anew) {
  if (!anew && frame_ == frame) return false;
  forget();
  renderer.draw(frame);
  frame_ = frame;
  return true;
}

void DrawnScene::forget() { frame_.reset(); }

std::uint64_t DrawnScene::ask(DepthReadback& readback, const glm::dvec2& pixel) {
  if (!frame_) return 0;
  // A depth is that of the middle of a pixel, wherever in it the cursor is.
  const glm::dvec2 middle = glm::floor(pixel) + 0.5;
  const glm::dvec2 place = 2.0 * middle / glm::dvec2(frame_->width, frame_->height) - 1.0;
  asked_.push_back({readback.askDistance(pixel), frame_->camera, {place.x, -place.y}});
  return asked_.back().question;
}

std::optional<DrawnScene::Answer> DrawnScene::take(DepthReadback& readback) {
  while (!asked_.empty()) {
    const std::optional<DistanceAnswer> distance = readback.takeDistance();
    if (!distance) return std::nullopt;
    while (!asked_.empty() && asked_.front().question < distance->question) asked_.pop_front();
    // Others may have asked before.
    if (asked_.empty() || asked_.front().question != distance->question) continue;
    const Asked asked = asked_.front();
    asked_.pop_front();
    Answer answer{asked.question, std::nullopt};
    if (distance->distance)
      answer.point = rayThrough(asked.camera, asked.place).at(*distance->distance);
    return answer;
  }
  return std::nullopt;
}

void takeShownMesh(const SceneReadback& renderer, const std::vector<ChunkId>& chunks,
                   const MeshFrame& frame, TriangleSink& sink) {
  std::map<int, VertexPlaces> places;  // by surface
  std::uint64_t known = 0;
  sink.begin(frame);
  for (const ChunkId id : chunks) {
    const SurfaceChunk chunk = renderer.download(id);
    PlacedBatch placed;
    MeshBatch& batch = placed.batch;
    batch.level = chunk.level;
    batch.origin = Index3(chunk.origin);
    batch.triangles.assign(chunk.triangles.begin(), chunk.triangles.end());
    for (const SurfaceVertex& vertex : chunk.vertices) {
      const EdgeKey key = places[chunk.surface].numberOf(chunk, vertex, known++);
      batch.shared.push_back({static_cast<std::uint32_t>(batch.positions.size()), 0, key});
      batch.positions.push_back(vertex.position);
      batch.normals.push_back(unpackNormal(vertex.normal));
    }
    sink.place(placed);
    sink.write(placed);
  }
  sink.finish();
}

}  // namespace isobrick
