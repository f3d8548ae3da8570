#include "isobrick/preprocess/build_identity.h"

#include <cstddef>
#include <nlohmann/json.hpp>

#include "isobrick/preprocess/input_identity.h"
#include "isobrick/storage/checksum.h"
#include "isobrick/storage/format.h"

namespace isobrick {
namespace {

std::string jsonOfNumber(double number) { return nlohmann::json(number).dump(); }

}  // namespace

std::string provenanceText(const VolumeSource& source, const BuildOptions& options,
                           const std::string& identity) {
  const VolumeInfo& info = source.info();
  nlohmann::json json = {{"tool", "isobrick " + options.tool_version},
                         {"source", info.source},
                         {"format", info.format},
                         {"filter", filterName(options.filter)},
                         {"identity", identity},
                         {"notes", info.notes}};
  for (const std::string& note : source.notesOfReading()) json["notes"].push_back(note);
  if (!info.properties.empty()) json["properties"] = info.properties;
  // Whether there were any is not said: a resumed build does not see all voxels.
  if (options.nan_as && info.voxel_type == VoxelType::kFloat32)
    json["notes"].push_back("voxels that were not finite became " +
                            jsonOfNumber(static_cast<double>(*options.nan_as)));
  // A path need not be UTF-8; a provenance that cannot be written would lose the whole build.
  return json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

std::string buildIdentity(const VolumeInfo& info, const std::string& input_identity,
                          const BuildOptions& options) {
  // Its numbers, without the bytes that fill the struct up.
  const auto hash = checksum64(&info.geometry, offsetof(GridGeometry, unit));
  std::string text = "input=" + input_identity + "\n";
  const auto line = [&](const char* name, const std::string& value) {
    text += std::string(name) + "=" + value + "\n";
  };
  line("voxels", std::to_string(info.voxels.x) + "x" + std::to_string(info.voxels.y) + "x" +
                     std::to_string(info.voxels.z) + " " +
                     std::string(voxelTypeName(info.voxel_type)));
  line("format", info.format + (info.encoding.empty() ? "" : ", ") + info.encoding);
  line("geometry", std::to_string(hash));
  line("length unit", std::string(lengthUnitName(info.geometry.unit)));
  line("filter", std::string(filterName(options.filter)));
  line("codec", std::string(codecName(options.codec)));
  line("brick", std::to_string(options.brick_cells));
  line("tile", std::to_string(options.tile_cells));
  line("curvature", options.with_curvature ? jsonOfNumber(options.curvature_epsilon) : "none");
  line("error", "none");  // as programs say it that could store bounds of errors
  line("nan_as", options.nan_as ? jsonOfNumber(static_cast<double>(*options.nan_as)) : "none");
  line("version", std::to_string(format::kVersion));
  line("algorithm", std::to_string(kBuildAlgorithm));
  return text;
}

std::string buildIdentity(const VolumeSource& source, const BuildOptions& options) {
  return buildIdentity(source.info(), inputIdentity(source, options.cancel), options);
}

}  // namespace isobrick
