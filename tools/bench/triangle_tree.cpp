#include "tools/bench/triangle_tree.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <limits>
#include <utility>

#include "isobrick/extract/sinks/nearest_parts.h"

namespace isobrick {
namespace {

double squaredLength(const glm::dvec3& v) { return glm::dot(v, v); }

// Every third bit from bit 0 on holds one of the 21 lower bits of `x`.
std::uint64_t spreadBits(std::uint64_t x) {
  x &= 0x1fffff;
  x = (x | x << 32) & 0x1f00000000ffff;
  x = (x | x << 16) & 0x1f0000ff0000ff;
  x = (x | x << 8) & 0x100f00f00f00f00f;
  x = (x | x << 4) & 0x10c30c30c30c30c3;
  x = (x | x << 2) & 0x1249249249249249;
  return x;
}

// The place of a point on a space-filling curve. Points from 0 to 2^20, as voxel indices are; all
// others go to the nearest end, which only costs time.
std::uint64_t placeOnCurve(const glm::vec3& point) {
  const glm::vec3 inside = glm::clamp(2.0f * point, glm::vec3(0), glm::vec3(2097151));
  return spreadBits(static_cast<std::uint64_t>(inside.x)) |
         spreadBits(static_cast<std::uint64_t>(inside.y)) << 1 |
         spreadBits(static_cast<std::uint64_t>(inside.z)) << 2;
}

std::vector<std::uint32_t> orderAlongCurve(const PlainMesh& mesh) {
  std::vector<std::pair<std::uint64_t, std::uint32_t>> places(mesh.triangles.size());
  tbb::parallel_for(std::size_t{0}, places.size(), [&](std::size_t t) {
    const auto& [a, b, c] = mesh.triangles[t];
    const glm::vec3 sum = cornerOf(mesh, a) + cornerOf(mesh, b) + cornerOf(mesh, c);
    places[t] = {placeOnCurve(sum / 3.0f), static_cast<std::uint32_t>(t)};
  });
  tbb::parallel_sort(places.begin(), places.end());
  std::vector<std::uint32_t> order(places.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = places[i].second;
  return order;
}

}  // namespace

TriangleTree::TriangleTree(const PlainMesh& mesh) : mesh_(mesh), order_(orderAlongCurve(mesh)) {
  if (order_.empty()) return;
  const auto groups = [](std::size_t count) { return (count + kFanout - 1) / kFanout; };
  boxes_.emplace_back(groups(order_.size()));
  tbb::parallel_for(std::size_t{0}, boxes_[0].size(), [&](std::size_t group) {
    Box box{glm::vec3(std::numeric_limits<float>::infinity()),
            glm::vec3(-std::numeric_limits<float>::infinity())};
    const std::size_t end = std::min((group + 1) * kFanout, order_.size());
    for (std::size_t i = group * kFanout; i < end; ++i)
      for (const std::uint32_t vertex : mesh_.triangles[order_[i]]) {
        box.lower = glm::min(box.lower, cornerOf(mesh_, vertex));
        box.upper = glm::max(box.upper, cornerOf(mesh_, vertex));
      }
    boxes_[0][group] = box;
  });
  while (boxes_.back().size() > 1) {
    const std::vector<Box>& finer = boxes_.back();
    std::vector<Box> coarser(groups(finer.size()));
    for (std::size_t group = 0; group < coarser.size(); ++group) {
      coarser[group] = finer[group * kFanout];
      const std::size_t end = std::min((group + 1) * kFanout, finer.size());
      for (std::size_t i = group * kFanout + 1; i < end; ++i) {
        coarser[group].lower = glm::min(coarser[group].lower, finer[i].lower);
        coarser[group].upper = glm::max(coarser[group].upper, finer[i].upper);
      }
    }
    boxes_.push_back(std::move(coarser));
  }
}

double TriangleTree::squaredTo(const glm::dvec3& point, std::uint32_t triangle) const {
  const auto& [a, b, c] = mesh_.triangles[triangle];
  return squaredDistance(point, cornerOf(mesh_, a), cornerOf(mesh_, b), cornerOf(mesh_, c));
}

double TriangleTree::distance(const glm::dvec3& point, Hint& hint) const {
  if (order_.empty()) return std::numeric_limits<double>::infinity();
  const auto squaredToBox = [&](const Box& box) {
    const glm::dvec3 outside = glm::max(
        glm::max(glm::dvec3(box.lower) - point, point - glm::dvec3(box.upper)), glm::dvec3(0));
    return squaredLength(outside);
  };
  if (hint.triangle >= order_.size()) hint.triangle = 0;
  double nearest = squaredTo(point, order_[hint.triangle]);

  // Boxes still to be searched; the nearest child of a box comes first. A box leaves at most
  // kFanout - 1 others behind on each level.
  struct Visit {
    double squared;
    std::uint32_t box;
    int level;
  };
  std::array<Visit, 64> stack;
  std::size_t waiting = 0;
  const int top = static_cast<int>(boxes_.size()) - 1;
  stack[waiting++] = {squaredToBox(boxes_.back()[0]), 0, top};
  while (waiting > 0) {
    const Visit visit = stack[--waiting];
    if (visit.squared >= nearest) continue;
    const std::size_t first = visit.box * kFanout;
    if (visit.level == 0) {
      const std::size_t end = std::min(first + kFanout, order_.size());
      for (std::size_t i = first; i < end; ++i) {
        const double squared = squaredTo(point, order_[i]);
        if (squared >= nearest) continue;
        nearest = squared;
        hint.triangle = static_cast<std::uint32_t>(i);
      }
      continue;
    }
    const std::vector<Box>& finer = boxes_[static_cast<std::size_t>(visit.level) - 1];
    const std::size_t end = std::min(first + kFanout, finer.size()), begin = waiting;
    for (std::size_t i = first; i < end; ++i) {
      const double squared = squaredToBox(finer[i]);
      if (squared < nearest)
        stack[waiting++] = {squared, static_cast<std::uint32_t>(i), visit.level - 1};
    }
    std::sort(stack.begin() + static_cast<std::ptrdiff_t>(begin),
              stack.begin() + static_cast<std::ptrdiff_t>(waiting),
              [](const Visit& a, const Visit& b) { return a.squared > b.squared; });
  }
  return std::sqrt(nearest);
}

}  // namespace isobrick
