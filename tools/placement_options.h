// The options with which extract and merge say where a mesh lies.
#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <string>

#include "isobrick/extract/sinks/mesh_file_sink.h"

namespace isobrick {

struct PlacementOptions {
  MeshPlacement placement;
  bool shifts_to_origin = false;  // its shift is chosen
};

// --space, --unit and --shift, which need `output`. `knows_volume`: the shift may be 'auto'.
void addPlacementOptions(CLI::App& app, PlacementOptions& options, CLI::Option* output,
                         bool knows_volume);

// The placement for a volume, whose middle goes near the origin if that is wanted.
MeshPlacement placementOf(const PlacementOptions& options, const GridGeometry& geometry,
                          const Index3& voxels);

}  // namespace isobrick
