#include "tools/query_options.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <glm/common.hpp>
#include <limits>

#include "isobrick/extract/query.h"
#include "isobrick/storage/error.h"
#include "tools/interrupt.h"
#include "tools/one_line.h"
#include "tools/parsed_option.h"
#include "tools/thread_count.h"

namespace isobrick {
namespace {

double parseAboveZero(const std::string& text) {
  const double value = parseNumber(text);
  if (!(value > 0)) throw std::invalid_argument(fmt::format("'{}' is not above 0", text));
  return value;
}

// The least box of voxel indices around a box of world coordinates: on an oblique volume it reaches
// further than the box itself.
QueryBox indexBoxAround(const Corners& box, const GridGeometry& geometry) {
  QueryBox result{glm::dvec3(std::numeric_limits<double>::infinity()),
                  glm::dvec3(-std::numeric_limits<double>::infinity())};
  for (int corner = 0; corner < 8; ++corner) {
    glm::dvec3 world;
    for (int axis = 0; axis < 3; ++axis)
      world[axis] = (corner >> axis & 1) != 0 ? box.upper[axis] : box.lower[axis];
    const glm::dvec3 index = geometry.worldToIndex(world);
    result.min = glm::min(result.min, index);
    result.max = glm::max(result.max, index);
  }
  return result;
}

double leastSpacing(const GridGeometry& geometry) {
  return std::min({geometry.spacing.x, geometry.spacing.y, geometry.spacing.z});
}

}  // namespace

void addQueryOptions(CLI::App& app, QueryOptions& options) {
  options.threads = allCores();
  app.add_option("FILE", options.path, "Pyramid (.isb)")->type_name("PATH")->required();
  addParsedOption(app, "--iso", options.isovalue, parseSingle, "V",
                  "Isovalue; values of at least V are inside")
      ->required();
  CLI::Option* const focus = addParsedOption(
      app, "--focus", options.focus, parsePoint, "X,Y,Z",
      "Centre of interest in voxel indices: finest around it, coarser with distance");
  CLI::Option* const radius = addParsedOption(
      app, "--radius", options.radius, [](const std::string& t) { return parseNumberFrom(t, 0); },
      "R", "Radius of interest in voxels: everything within is of the finest level");
  focus->needs(radius);
  radius->needs(focus);
  addParsedOption(app, "--box", options.box, parseCorners, "X0,Y0,Z0,X1,Y1,Z1",
                  "Extract only cells that overlap this box of voxel indices");
  app.add_flag("--world", options.world,
               "--focus, --radius and --box are in world units. The radius is divided by the least "
               "spacing, so that the whole world sphere is of the finest level; on an oblique "
               "volume the box becomes the least box of indices around it");
  CLI::Option* const tolerance = addParsedOption(
      app, "--curvature", options.curvature_tolerance,
      [](const std::string& t) { return parseNumberFrom(t, 0); }, "T",
      "Leave parts at level 1 where the total curvature is at most T, in 1/voxel^2");
  CLI::Option* const rho =
      addParsedOption(app, "--curvature-radius", options.curvature_radius, parseAboveZero, "RHO",
                      "The same for parts flatter than a sphere of RHO voxels: T = 1/(2 RHO^2)");
  tolerance->excludes(rho);
  CLI::Option* const level = addParsedOption(
      app, "--level", options.level, [](const std::string& t) { return parseInteger(t, 0, 63); },
      "L", "Extract everything from this level; 0 is the finest");
  level->excludes(focus);
  addParsedOption(app, "--memory", options.memory_bytes, parseByteSize, "SIZE",
                  "Bytes of the file to keep in memory, such as 256M; default: 1G");
  addNoMapFlag(app, options.no_map);
  addThreadsOption(app, options.threads);
}

void addNoMapFlag(CLI::App& app, bool& no_map) {
  app.add_flag("--no-map", no_map,
               "Read all of the file and map nothing of it: for network file systems; the result "
               "is the same");
}

Query makeQuery(const QueryOptions& options, const Pyramid& pyramid) {
  const GridGeometry& geometry = pyramid.spec().geometry;
  Query query;
  query.isovalue = options.isovalue;
  if (options.focus) {
    query.focus.emplace();
    query.focus->center = options.world ? geometry.worldToIndex(*options.focus) : *options.focus;
    query.focus->radius =
        options.world ? *options.radius / leastSpacing(geometry) : *options.radius;
  }
  if (options.box)
    query.box = options.world ? indexBoxAround(*options.box, geometry)
                              : QueryBox{options.box->lower, options.box->upper};
  query.uniform_level = options.level;
  query.curvature_tolerance = options.curvature_tolerance;
  if (options.curvature_radius) {
    const double rho = *options.curvature_radius;
    query.curvature_tolerance = 1 / (2 * rho * rho);
  }
  query.cancel = &interruptFlag();
  return query;
}

void refusePyramidAsOutput(const std::string& path, const std::string& output) {
  std::error_code ignored;
  if (std::filesystem::equivalent(path, output, ignored))
    throw Error(fmt::format("'{}' is the pyramid itself; choose another output with -o", output));
}

void warnOfEmptySurface(const QueryOptions& options, const Pyramid& pyramid) {
  const ValueRange& range = pyramid.valueRange();
  if (range.crosses(static_cast<float>(options.isovalue))) return;
  fmt::print(stderr,
             "isobrick: warning: the mesh is empty: no surface at the isovalue {}, since the "
             "values of '{}' are {} to {}\n",
             options.isovalue, oneLine(options.path), range.min, range.max);
}

}  // namespace isobrick
