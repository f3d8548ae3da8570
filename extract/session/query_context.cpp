#include "isobrick/extract/session/query_context.h"

#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <string>

#include "isobrick/storage/error.h"

namespace isobrick {

namespace {

// In voxels from the volume's first voxel.
constexpr double kFarthestFocus = 0x1p30;

constexpr double kRightAngle = std::numbers::pi / 2;

void checkFocus(const FocusSphere& focus) {
  for (int axis = 0; axis < 3; ++axis) {
    if (!std::isfinite(focus.center[axis]))
      throw Error("the focus point is not finite; give three numbers");
    // Squared distances beyond would be coarser than the room that rule 3 has for rounding.
    if (std::abs(focus.center[axis]) > kFarthestFocus)
      throw Error("the focus point is more than 2^30 voxels away; move it towards the volume");
  }
  if (!(focus.radius >= 0) || !std::isfinite(focus.radius))
    throw Error("the radius of interest must be a finite number >= 0");
}

void checkView(const Pyramid& pyramid, const ViewPoint& view) {
  const auto isAboveZero = [](double number) { return number > 0 && std::isfinite(number); };
  for (int axis = 0; axis < 3; ++axis)
    if (!std::isfinite(view.eye[axis]))
      throw Error("the eye is not at a finite point; give three numbers");
  const glm::dvec3 eye = pyramid.spec().geometry.worldToIndex(view.eye);
  for (int axis = 0; axis < 3; ++axis)
    if (!(std::abs(eye[axis]) <= kFarthestFocus))
      throw Error("the eye is more than 2^30 voxels away; move it towards the volume");
  if (!isAboveZero(view.pixels_per_unit.value_or(view.pixels_per_radian)))
    throw Error("the pixels per radian, or per unit, must be a finite number above 0");
  if (!isAboveZero(view.pixels))
    throw Error("the pixels that a cell may cover must be a finite number above 0");
  if (!view.field) return;
  const glm::dvec3& direction = view.field->direction;
  if (!isAboveZero(glm::length(direction)))
    throw Error("the direction of the view must be three finite numbers, not all 0");
  if (view.pixels_per_unit ? !isAboveZero(view.field->radius)
                           : !(view.field->half_angle > 0 && view.field->half_angle < kRightAngle))
    throw Error("the field of view must be above 0, and its half angle below pi/2");
}

void checkUniformLevel(const Pyramid& pyramid, int level) {
  const int levels = pyramid.lattice().levels();
  if (level < 0 || level >= levels)
    throw Error("level " + std::to_string(level) + " does not exist in '" + pyramid.path() +
                "'; its levels are 0 to " + std::to_string(levels - 1));
}

void checkCurvatureTolerance(const Pyramid& pyramid, const DetailChoice& choice) {
  if (!(*choice.curvature_tolerance >= 0))
    throw Error("the curvature tolerance must be a number >= 0");
  if (choice.uniform_level && *choice.uniform_level > 0)
    throw Error("the curvature tolerance acts on level 0; leave out the uniform level");
  if (!pyramid.spec().has_curvature)
    throw Error(
        "'" + pyramid.path() + "' holds no curvature; build it with curvature to use a tolerance",
        {.path = pyramid.path()}, {Remedy::kBuildWithCurvature});
}

void checkBox(const QueryBox& box) {
  for (int axis = 0; axis < 3; ++axis)
    if (!(box.min[axis] < box.max[axis]))
      throw Error("the box is empty; its first corner must be below its second on every axis");
}

void checkChoice(const Pyramid& pyramid, const DetailChoice& choice) {
  if (choice.focus && choice.uniform_level)
    throw Error("a focus and a uniform level exclude each other; give one of them");
  if (choice.focus) checkFocus(*choice.focus);
  if (choice.uniform_level) checkUniformLevel(pyramid, *choice.uniform_level);
  if (choice.view) checkView(pyramid, *choice.view);
  if (choice.curvature_tolerance) checkCurvatureTolerance(pyramid, choice);
}

// Level 0 that lies elsewhere has no levels, ranges and parts to choose by.
void checkIsFinest(const Pyramid& pyramid, const Query& query) {
  if (query.isOfLevelZero() && !query.is_progressive) return;
  throw Error("'" + pyramid.path() + "' has no coarser levels; ask for level 0, or build a pyramid",
              {.path = pyramid.path()});
}

}  // namespace

void checkQuery(const Pyramid& pyramid, const Query& query) {
  if (pyramid.parts().isSupplied()) checkIsFinest(pyramid, query);
  if (!std::isfinite(pyramid.storedIsovalue(query.isovalue)))
    throw Error("the isovalue is not a finite number; choose one within the volume's value range");
  checkChoice(pyramid, query);
  for (const DetailChoice& choice : query.or_finer) checkChoice(pyramid, choice);
  if (query.box) checkBox(*query.box);
  if (!query.region.isEverywhere() && query.cap && (!query.isOfLevelZero() || query.is_progressive))
    throw Error("caps where a region cuts need level 0 everywhere; ask for that, or for no caps");
  if (query.cap && query.box && query.is_progressive)
    throw Error(
        "a progressive query with a box has no caps, as the box grows with the levels that are in "
        "memory; leave out one of them");
  if (query.simplify && !(query.simplify->distance > 0 && std::isfinite(query.simplify->distance)))
    throw Error("the distance of a simplification must be a finite number above 0");
}
namespace {

// Adds the log's entry of one brick to the report.
void addReads(const PyramidParts& parts, const ReadLog::Entry& entry, ExtractionReport& report) {
  const auto [level, brick] = parts.brickAt(entry.brick_row);
  const BrickRow row = parts.brickRowOf(level, brick);
  ++report.bricks_read;
  if ((entry.marks & ReadLog::kActive) != 0) {
    ++report.bricks_active;
    report.bytes_active += row.part(PartKind::kSamples).stored_bytes;
  }
  for (const PartKind kind : kPartKinds)
    if ((entry.marks & ReadLog::markOf(kind)) != 0)
      report.bytes_read += row.part(kind).stored_bytes;
}

}  // namespace

std::vector<LevelCounts> noCounts(int levels) {
  std::vector<LevelCounts> counts(static_cast<std::size_t>(levels));
  for (int level = 0; level < levels; ++level)
    counts[static_cast<std::size_t>(level)].level = level;
  return counts;
}

ExtractionReport makeReport(const Pyramid& pyramid, const ReadLog& log,
                            const std::vector<LevelCounts>& levels) {
  ExtractionReport report;
  for (const LevelCounts& counts : levels) {
    report.triangles += counts.triangles;
    if (counts.triangles > 0) report.levels.push_back(counts);
  }
  for (const ReadLog::Entry& entry : log.entries()) addReads(pyramid.parts(), entry, report);
  return report;
}

}  // namespace isobrick
