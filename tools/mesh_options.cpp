#include "tools/mesh_options.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <stdexcept>

#include "tools/interrupt.h"
#include "tools/outputs.h"
#include "tools/parse_text.h"
#include "tools/shared_options.h"

namespace isobrick {
namespace {

// The middle of the volume to the origin, in steps of the decimal places that its extent has: the
// numbers stay short.
glm::dvec3 shiftToOrigin(const GridGeometry& geometry, const Index3& voxels) {
  const auto corners = worldCorners(geometry, voxels);
  glm::dvec3 lower = corners[0], upper = lower;
  for (const glm::dvec3& corner : corners) {
    lower = glm::min(lower, corner);
    upper = glm::max(upper, corner);
  }
  const glm::dvec3 extent = upper - lower;
  const double step =
      std::pow(10, std::floor(std::log10(std::max({extent.x, extent.y, extent.z}))));
  // Not -0.
  return -step * glm::round((lower + upper) / (2 * step)) + 0.0;
}

}  // namespace

CLI::Option* addMeshOptions(CLI::App& app, MeshOptions& options, const std::string& help_of_output,
                            bool knows_volume) {
  CLI::Option* const output =
      app.add_option("-o,--output", options.output, help_of_output)->type_name("MESH");
  addForceFlag(app, options.force)->needs(output);
  const Choices<MeshSpace> spaces = {
      {"LPS", MeshSpace::kLps}, {"RAS", MeshSpace::kRas}, {"index", MeshSpace::kIndex}};
  addChoiceOption(app, "--space", options.placement.space, spaces, "LPS|RAS|index",
                  "Axes of the mesh: the world as it is, which counts as LPS (default); x and y "
                  "turned round; or voxel indices")
      ->needs(output);
  Choices<std::string> units;
  for (const char* unit : {"nm", "um", "mm", "cm", "m", "inch", "ft"})
    units.emplace_back(unit, unit);
  addChoiceOption(app, "--unit", options.placement.unit, units, "UNIT",
                  "Unit of the mesh's lengths: nm, um, mm, cm, m, inch or ft; the volume has to "
                  "know its own. Default: the volume's")
      ->needs(output);
  const auto parseShift = [&options, knows_volume](const std::string& text) {
    options.shifts_to_origin = text == "auto" && knows_volume;
    return options.shifts_to_origin ? glm::dvec3(0.0) : parsePoint(text);
  };
  addParsedOption(
      app, "--shift", options.placement.shift, parseShift, knows_volume ? "X,Y,Z|auto" : "X,Y,Z",
      std::string("Add this to all positions, last, in the space and unit of the mesh, for "
                  "programs that compute in single precision") +
          (knows_volume ? "; 'auto' moves the middle of the volume near the origin. Report and "
                          "header of the file say it"
                        : ""))
      ->needs(output);
  app.add_flag("--zlib", options.zlib, "Pack .vtp with zlib")->needs(output);
  app.add_flag("--meshopt", options.meshopt,
               "Pack .glb with EXT_meshopt_compression: positions to 1/8192 of the least spacing, "
               "normals to 10 bits")
      ->needs(output);
  return output;
}

MeshFileOptions meshFileOptions(const MeshOptions& options, const PyramidSpec* volume) {
  MeshFileOptions file{.cancel = &interruptFlag(),
                       .placement = options.placement,
                       .zlib = options.zlib,
                       .meshopt = options.meshopt};
  if (volume != nullptr && options.shifts_to_origin)
    file.placement.shift =
        shiftToOrigin(options.placement.placed(volume->geometry), volume->voxels);
  return file;
}

}  // namespace isobrick
