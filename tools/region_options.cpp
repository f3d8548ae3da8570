#include "tools/region_options.h"

#include <fmt/format.h>

#include <array>
#include <glm/geometric.hpp>
#include <stdexcept>

#include "isobrick/storage/file_system.h"
#include "tools/parse_text.h"
#include "tools/query_options.h"
#include "tools/shared_options.h"

namespace isobrick {
namespace {

// "OTHER", or "OTHER:7"; names of files, phantoms and URLs have colons too.
RegionOptions::Mask parseMask(const std::string& text) {
  constexpr std::string_view kPhantom = "phantom:";
  RegionOptions::Mask mask;
  mask.input.path = text;
  const std::size_t colon = text.rfind(':');
  const bool is_name = isNameTaken(text) ||
                       (text.rfind(kPhantom, 0) == 0 && text.find(':', kPhantom.size()) == colon);
  if (colon == std::string::npos || colon == 0 || is_name) return mask;
  try {
    mask.value = parseNumber(text.substr(colon + 1));
    mask.input.path.resize(colon);
  } catch (const std::invalid_argument&) {  // a part of the name
  }
  return mask;
}

// "NX,NY,NZ,D", or a point and a normal, "X,Y,Z,NX,NY,NZ".
RegionOptions::Cut<HalfSpace> parsePlane(std::string text, bool has_world) {
  const auto unit = has_world ? takeLengthUnit(text) : std::nullopt;
  const std::vector<double> numbers = parseNumbers(text);
  HalfSpace plane;
  if (numbers.size() == 4) {
    plane = {{numbers[0], numbers[1], numbers[2]}, numbers[3]};
  } else if (numbers.size() == 6) {
    plane.normal = {numbers[3], numbers[4], numbers[5]};
    plane.offset = glm::dot(plane.normal, glm::dvec3(numbers[0], numbers[1], numbers[2]));
  } else {
    throw std::invalid_argument(
        fmt::format("'{}' is no plane: NX,NY,NZ,D, or a point and a normal, X,Y,Z,NX,NY,NZ", text));
  }
  if (!(glm::length(plane.normal) > 0.0))
    throw std::invalid_argument(fmt::format("'{}' has a normal of 0,0,0", text));
  plane.offset *= unit.value_or(1);
  return {plane, unit.has_value()};
}

RegionOptions::Cut<RegionBall> parseSphere(std::string text, bool has_world) {
  const auto unit = has_world ? takeLengthUnit(text) : std::nullopt;
  const std::vector<double> numbers = parseNumbers(text);
  if (numbers.size() != 4 || !(numbers[3] > 0))
    throw std::invalid_argument(
        fmt::format("'{}' is no sphere X,Y,Z,R with a radius above 0", text));
  const glm::dvec3 center(numbers[0], numbers[1], numbers[2]);
  return {{center * unit.value_or(1), numbers[3] * unit.value_or(1)}, unit.has_value()};
}

}  // namespace

std::vector<std::string> RegionOptions::files() const {
  std::vector<std::string> all;
  for (const Mask& mask : masks) {
    all.push_back(mask.input.path);
    if (!mask.input.pyramid.empty()) all.push_back(mask.input.pyramid);
  }
  return all;
}

void addRegionOptions(CLI::App& app, RegionOptions& options, bool has_world) {
  const std::string units =
      has_world ? "in voxel indices; with --world in world units, and with a unit, as in "
                  "75,30,75,10mm, in the world"
                : "in voxel indices";
  beginGroup(app, kSurfaceGroup);
  addRepeatedOption(
      app, "--mask",
      [&options](const std::string& text) { options.masks.push_back(parseMask(text)); },
      "OTHER[:VALUE]",
      "Only where another pyramid or volume, of any grid in the same world, is not 0, or has this "
      "value: its voxel that is nearest to a voxel of FILE counts. With other masks, planes and "
      "spheres, what lies in all of them; they share --memory");
  addRepeatedOption(
      app, "--clip",
      [&options, has_world](const std::string& text) {
        options.planes.push_back(parsePlane(text, has_world));
      },
      "NX,NY,NZ,D",
      "Only the side of a plane to which its normal points, N.P >= D; or a point and the normal, "
      "X,Y,Z,NX,NY,NZ; " +
          units);
  addRepeatedOption(
      app, "--sphere",
      [&options, has_world](const std::string& text) {
        options.spheres.push_back(parseSphere(text, has_world));
      },
      "X,Y,Z,R", "Only within this sphere, " + units);
}

void findMasks(RegionOptions& options, const std::string& cache_folder, int threads,
               std::uint64_t memory_bytes) {
  for (RegionOptions::Mask& mask : options.masks) {
    mask.input.cache_folder = cache_folder;
    findPyramid(mask.input, threads, memory_bytes);
  }
}

void openMasks(RegionOptions& options, std::uint64_t memory_bytes, FileAccess access,
               const RemoteOptions& remote) {
  for (RegionOptions::Mask& mask : options.masks)
    mask.opened = openPyramidFile(mask.input.pyramid, memory_bytes, access, remote);
}

SurfaceRegion makeRegion(const RegionOptions& options, bool world, const GridGeometry& geometry) {
  SurfaceRegion region;
  for (const RegionOptions::Mask& mask : options.masks)
    region.masks.push_back({mask.opened, mask.value});
  for (const auto& [plane, has_unit] : options.planes) {
    if (has_unit) refuseUnitOfUnknown(geometry, "--clip");
    region.half_spaces.push_back(
        world || has_unit ? halfSpaceInWorld(geometry, plane.normal, plane.offset) : plane);
  }
  for (const auto& [ball, has_unit] : options.spheres) {
    if (has_unit) refuseUnitOfUnknown(geometry, "--sphere");
    region.balls.push_back(world || has_unit ? ballInWorld(geometry, ball.center, ball.radius)
                                             : ball);
  }
  return region;
}

}  // namespace isobrick
