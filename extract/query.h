// A query: one isosurface, and how fine it is to be at each place; the plan made from it, and the
// report.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "isobrick/extract/surface_region.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/grid.h"

namespace isobrick {

// The sphere of interest (Sect. 5.1 of the paper): level 0 inside, coarser with distance. Voxel
// index coordinates and voxels; the centre may lie outside the volume, up to 2^30 voxels away on
// each axis.
struct FocusSphere {
  glm::dvec3 center{0.0};  // voxel index
  double radius = 0;       // voxels, >= 0
  bool operator==(const FocusSphere&) const = default;
};

// A closed box in voxel index coordinates.
struct QueryBox {
  glm::dvec3 min{0.0};  // lower corner
  glm::dvec3 max{0.0};  // upper corner
  bool operator==(const QueryBox&) const = default;
};

// The place from which the surface is seen, in world units: a cell is refined while its longest
// edge covers more than `pixels` pixels of a picture taken from there.
struct ViewPoint {
  glm::dvec3 eye{0.0};  // world units
  // For a perspective picture, near its middle: its height in pixels over its field of view in
  // radians. Above 0.
  double pixels_per_radian = 1000;
  // For a parallel projection, in place of the former: pixels per world unit. Above 0.
  std::optional<double> pixels_per_unit;
  double pixels = 1;  // above 0

  // The part of the world in the picture, as a cone around it or, for a parallel projection, a
  // cylinder. Outside of it the surface grows coarser with the distance. Without a field all
  // directions count.
  struct Field {
    glm::dvec3 direction{0.0};  // from the eye into the picture; any length above 0
    double half_angle = 0;      // radians, above 0 and below pi/2; of a perspective picture
    double radius = 0;          // world units, above 0; of a parallel projection
    bool operator==(const Field&) const = default;
  };
  std::optional<Field> field;  // see there
  bool operator==(const ViewPoint&) const = default;
};

// How fine the surface is to be at each place. Each member that is given leaves cells coarse; a
// cell is refined if all of them refine it. With none of them the finest level is extracted
// everywhere.
struct DetailChoice {
  // Level 0 inside the sphere, coarser with the distance from it.
  std::optional<FocusSphere> focus;
  // Extracts the whole surface from this level, 0 .. levels - 1. Not together with a focus.
  std::optional<int> uniform_level;
  // As fine as a picture taken from there can show.
  std::optional<ViewPoint> view;
  // Cells of level 1 inside the sphere of interest (everywhere without a focus) are extracted as
  // they are if the bound of the total curvature (Eq. 2) is at most this: 1/voxel^2, >= 0.
  // "Flatter than a sphere of radius rho voxels" is 1 / (2 rho^2). Not with uniform_level > 0.
  std::optional<double> curvature_tolerance;
  bool operator==(const DetailChoice&) const = default;
};

// Fewer triangles within a distance of the surface that the query gives without it: no point of the
// result is further from that surface, and no point of that surface is further from the result.
// Each brick is simplified on its own, and on level 0 then cubes of 256 cells as a whole; vertices
// that others have among them stay where they are.
struct SimplifyOptions {
  double distance = 0;    // above 0; in voxels of the least spacing, one length along all axes
  bool in_world = false;  // in world units instead
  // Leaves out connected components whose bounding box has a diagonal below the distance: specks
  // of noise. Those that lie in more than one brick stay.
  bool drop_small = false;
  bool operator==(const SimplifyOptions&) const = default;
};

// The side of a surface on which the object lies. The surface is the same; its triangles and
// normals look away from the object.
enum class InsideOf {
  kAbove,  // values of at least the isovalue: bright things
  kBelow,  // values below it: dark things, and level sets, which are negative inside
};

// Which surface it is, and how fine. Two queries with the same choice give the same surface.
struct SurfaceChoice : DetailChoice {
  // The surface separates value >= isovalue from value < isovalue. In the values of the input;
  // compared in single precision as it would be stored (Pyramid::storedIsovalue()).
  double isovalue = 0;
  InsideOf inside = InsideOf::kAbove;  // see there
  // Further choices: a cell is refined if any one of them, or the query's own, refines it.
  std::vector<DetailChoice> or_finer;
  // Only leaves that overlap this box are extracted, as a whole; the surface is open there.
  std::optional<QueryBox> box;
  // Closes the surface where it leaves the volume, or the box, as if all values beyond were
  // outside: with triangles in that border alone, the caps. The box grows until it cuts no leaf.
  // Where a region cuts it, too; that is of level 0 alone. Beside voxels without data the surface
  // stays open. A progressive query with a box has no caps.
  bool cap = false;
  SurfaceRegion region;                     // only the part of the surface within it
  std::optional<SimplifyOptions> simplify;  // none: the surface as it was meshed
  // Off: every brick and every tile is visited. The mesh is the same (rule 7), perhaps in another
  // order; for tests.
  bool cull_by_ranges = true;
  bool operator==(const SurfaceChoice&) const = default;

  // True if all of the surface is of level 0.
  bool isOfLevelZero() const {
    DetailChoice finest;
    if (uniform_level == 0) finest.uniform_level = 0;
    return static_cast<const DetailChoice&>(*this) == finest && or_finer.empty();
  }
};

// A surface, and how it is delivered.
struct Query : SurfaceChoice {
  // The query is answered at once from the bricks in memory: coarser if they are not enough, but
  // closed all the same. Only levels of a single brick are read. Asked again, it refines: see
  // Extractor::waitForBricks().
  bool is_progressive = false;
  // True if the caller has that brick's part of the surface already: the result leaves it out. It
  // is called on the caller's thread, at most once a brick, for bricks of which all cells, and all
  // cells that touch them, are leaves of the brick's level: the part of such a brick depends on
  // pyramid, level, brick, isovalue and side alone, without a region.
  std::function<bool(int level, const Index3& brick)> has_brick;
  // Checked all the time; may be null, and outlives the query.
  const CancelFlag* cancel = nullptr;
  // Raised to the share of the bricks that are meshed, 1 when all are. Any thread raises it, and
  // any other may read it. The caller sets it to 0 before. May be null, and outlives the query.
  std::atomic<float>* fraction_done = nullptr;
};

// One brick to mesh.
struct BrickWork {
  int level = 0;    // of the brick
  Index3 brick{0};  // its place among the bricks of the level
  // False if every cell of the brick, and every cell that touches it, is a leaf of this level:
  // plain marching cubes on the samples as they are.
  bool adaptive = false;
};

// Every brick that may hold a part of the surface, in the order in which its batches come out.
// Found in memory from ranges and oracles alone; nothing was read from the file. Its size is that
// of the surface, not of the file. A value: may be copied, cut in ranges and executed any number of
// times. The query's cancel flag, if it has one, must live as long as the plan is executed.
class ExtractionPlan {
 public:
  // The query that was planned.
  const Query& query() const { return query_; }
  // In the order in which their batches come out.
  std::span<const BrickWork> bricks() const { return bricks_; }

 private:
  friend class Extractor;
  Query query_;
  std::vector<BrickWork> bricks_;
};

// The result of an extraction for one level.
struct LevelCounts {
  int level = 0;                       // of the pyramid
  std::uint64_t cells = 0;             // leaves with at least one triangle
  std::uint64_t triangles = 0;         // of all its leaves
  std::uint64_t transition_cells = 0;  // cells whose triangles are fans
  std::uint64_t cap_triangles = 0;     // those of its triangles that are caps
};

// The result of an extraction.
struct ExtractionReport {
  bool is_complete = true;          // false: coarser than requested; of progressive queries alone
  std::uint64_t triangles = 0;      // of all levels
  std::vector<LevelCounts> levels;  // those with triangles, finest first
  std::uint64_t bricks_active = 0;  // bricks with at least one triangle
  std::uint64_t bricks_read = 0;    // bricks of which any part was requested
  std::uint64_t bytes_active = 0;   // stored bytes of the samples of active bricks
  std::uint64_t bytes_read = 0;     // stored bytes of all parts requested, each counted once
};

}  // namespace isobrick
