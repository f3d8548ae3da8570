#include "isobrick/viewer/render/gl_depth_reads.h"

#include <utility>

namespace isobrick {

std::uint64_t GlDepthReads::ask(const GlTargets& targets, const glm::dvec2& pixel,
                                const DepthProjection& projection) {
  Read read;
  read.question = ++last_;
  read.projection = projection;
  if (targets.holds(pixel)) {
    read.depth = GlBuffer::make();
    glNamedBufferStorage(*read.depth, sizeof(float), nullptr, GL_CLIENT_STORAGE_BIT);
    targets.copyDepth(pixel, *read.depth);
    read.fence = GlFence::make();
  }
  reads_.push_back(std::move(read));
  return last_;
}

std::optional<DistanceAnswer> GlDepthReads::take() {
  if (reads_.empty() || !reads_.front().fence.isPassed()) return std::nullopt;
  const Read read = std::move(reads_.front());
  reads_.pop_front();
  DistanceAnswer answer{read.question, std::nullopt};
  if (*read.depth == 0) return answer;
  float depth = 0.0f;
  glGetNamedBufferSubData(*read.depth, 0, sizeof(float), &depth);
  if (depth > 0.0f) answer.distance = read.projection.distanceAt(depth);
  return answer;
}

}  // namespace isobrick
