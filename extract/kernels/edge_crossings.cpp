#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "isobrick/extract/kernels/edge_crossings.cpp"
#include "isobrick/extract/kernels/edge_crossings.h"

#include <hwy/foreach_target.h>  // must come before highway.h
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace isobrick {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// To `out`: how far the crossing is along the edge from its end, as a part of it, the normal, and
// the square of its length before it was made a unit.
void makeQueuedEdges(const EdgeQueue& queue, const WorldFrame& frame, float isovalue,
                     float (*out)[EdgeQueue::kMost]) {
  static_assert(sizeof(EdgeEnd) == 4 * sizeof(float));
  const hn::CappedTag<float, EdgeQueue::kMost> df;
  using EdgeFloats = hn::Vec<decltype(df)>;
  const float* const m = frame.normalMatrix();
  for (std::size_t i = 0; i < queue.count; i += hn::Lanes(df)) {
    EdgeFloats low, high, low_x, low_y, low_z, high_x, high_y, high_z;
    hn::LoadInterleaved4(df, &queue.low[i].value, low, low_x, low_y, low_z);
    hn::LoadInterleaved4(df, &queue.high[i].value, high, high_x, high_y, high_z);
    // crossingParameter()
    const auto across = hn::Sub(high, low);
    auto t = hn::Div(hn::Sub(hn::Set(df, isovalue), low), across);
    const auto least = hn::LoadU(df, &queue.least[i]), most = hn::LoadU(df, &queue.most[i]);
    t = hn::IfThenElse(hn::Gt(t, least), t, least);
    t = hn::IfThenElse(hn::Lt(t, most), t, most);
    const auto rounder = hn::Set(df, kCrossingRounder);
    t = hn::Sub(hn::Add(t, rounder), rounder);
    const auto s = hn::Sub(hn::Set(df, 1.0f), t);
    hn::Store(s, df, out[0] + i);
    // gradientAt() and WorldFrame::normal()
    const auto between = [&](EdgeFloats a, EdgeFloats b) {
      return hn::Add(hn::Mul(a, s), hn::Mul(b, t));
    };
    const EdgeFloats gx = between(low_x, high_x), gy = between(low_y, high_y),
                     gz = between(low_z, high_z);
    const auto row = [&](std::size_t n, auto g) {
      if (frame.isDiagonal()) return hn::Mul(hn::Set(df, m[4 * n]), g);
      return hn::Add(
          hn::Add(hn::Mul(hn::Set(df, m[3 * n]), gx), hn::Mul(hn::Set(df, m[3 * n + 1]), gy)),
          hn::Mul(hn::Set(df, m[3 * n + 2]), gz));
    };
    const auto x = row(0, gx), y = row(1, gy), z = row(2, gz);
    const auto square = hn::Add(hn::Add(hn::Mul(x, x), hn::Mul(y, y)), hn::Mul(z, z));
    const auto factor = hn::Div(hn::Set(df, -1.0f), hn::Sqrt(square));
    hn::Store(hn::Mul(x, factor), df, out[1] + i);
    hn::Store(hn::Mul(y, factor), df, out[2] + i);
    hn::Store(hn::Mul(z, factor), df, out[3] + i);
    // crossingParameter() halves values that are too far apart.
    const auto infinity = hn::Set(df, std::numeric_limits<float>::infinity());
    hn::Store(hn::IfThenElse(hn::Lt(hn::Abs(across), infinity), square, infinity), df, out[4] + i);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace isobrick
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isobrick {

HWY_EXPORT(makeQueuedEdges);

void EdgeQueue::make(const WorldFrame& frame, float isovalue, glm::vec3* positions,
                     glm::vec3* normals) {
  alignas(64) float made[5][kMost];
  HWY_DYNAMIC_DISPATCH(makeQueuedEdges)(*this, frame, isovalue, made);
  for (std::size_t i = 0; i < count; ++i) {
    const CrossedEdge& edge = edges[i];
    const float* const begin = &edge.begin.x;
    float* const position = &positions[edge.vertex].x;
    for (int axis = 0; axis < 3; ++axis) position[axis] = begin[axis];
    // crossingCoordinate()
    position[edge.axis] = edge.end - made[0][i] * (edge.end - begin[edge.axis]);
    if (WorldFrame::isUsable(made[4][i])) {
      float* const normal = &normals[edge.vertex].x;
      for (std::size_t axis = 0; axis < 3; ++axis) normal[axis] = made[1 + axis][i];
    } else {
      const EdgeCrossing one =
          makeEdgeCrossing(frame, isovalue, edge, low[i], high[i], {least[i], most[i]});
      positions[edge.vertex] = one.position;
      normals[edge.vertex] = one.normal;
    }
  }
  count = 0;
}

}  // namespace isobrick
#endif
