// The triangles of a cell beside finer ones (rule 10).
#pragma once

#include <optional>
#include <vector>

#include "isobrick/extract/kernels/contour.h"
#include "isobrick/extract/kernels/crossing.h"
#include "isobrick/extract/self_crossings.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// The fan of a loop is around its hub: the first vertex that shares faces of the cell with none but
// its two neighbours. If there is none, it is around the loop's centre of gravity. So no side of a
// triangle but the loop's own lies in a face, in which another cell might have the same side.
std::optional<std::size_t> hubOf(const ContourLoop& loop);

// Append the fan of a loop of the batch's vertices. `hub`: that of hubOf().
void addFan(const WorldFrame& frame, const ContourLoop& loop, std::size_t hub, MeshBatch& batch);
// The positions of the loop's vertices are used. `cell_center`: like the batch's positions; it
// takes the place of the centre of gravity if that would make a triangle without area, since it
// lies in no face's plane.
void addCenteredFan(const WorldFrame& frame, const glm::dvec3& cell_center, const ContourLoop& loop,
                    MeshBatch& batch);

// The fans of a cell of several loops. Each is as above, unless two of them would cross: then they
// are around the first hubs with which none do, and as few as possible around centres instead.
// Memory that is used for one cell after the other.
class SeveralFans {
 public:
  void clear();
  void add(const ContourLoop& loop);  // copies it
  std::size_t loops() const { return ends_.size(); }
  ContourLoop loop(std::size_t number) const;

  // Appends them all. `cell_corner`: the lower one, like the batch's positions.
  void append(const WorldFrame& frame, const glm::dvec3& cell_corner, const glm::dvec3& cell_center,
              MeshBatch& batch);

 private:
  // What a loop's fan can be around: hubs in their order, and last its centre.
  struct Choices {
    std::vector<std::size_t> hubs;
    glm::dvec3 center{0.0};
    std::size_t chosen = 0;
    bool isCentered() const { return chosen == hubs.size(); }
  };

  bool doCross(const glm::dvec3& cell_corner, const MeshBatch& batch);
  bool chooseApart(std::size_t most_centers, const glm::dvec3& cell_corner, const MeshBatch& batch);

  std::vector<std::uint32_t> vertices_;
  std::vector<std::uint8_t> faces_;
  std::vector<std::size_t> ends_;  // of loops, in these
  std::vector<Choices> choices_;
  SelfCrossings crossings_;
  std::vector<glm::ivec3> positions_;
  std::vector<SelfCrossings::Triangle> triangles_;
};

}  // namespace isobrick
