// The options with which extract and merge write a mesh.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

struct MeshOptions {
  std::string output;  // empty: the mesh is counted only
  MeshPlacement placement;
  bool shifts_to_origin = false;  // its shift is chosen
  bool zlib = false;
  bool meshopt = false;
  bool check = false;  // look at the mesh
  bool force = false;
  bool json = false;
};

// -o, --force, --space, --unit, --shift, --zlib and --meshopt. `knows_volume`: the shift may be
// 'auto'. Returns -o.
CLI::Option* addMeshOptions(CLI::App& app, MeshOptions& options, const std::string& help_of_output,
                            bool knows_volume);

// For a file, without attributes. `volume`: whose middle goes near the origin if that is wanted.
MeshFileOptions meshFileOptions(const MeshOptions& options, const PyramidSpec* volume = nullptr);

}  // namespace isobrick
