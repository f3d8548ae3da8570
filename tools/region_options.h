// The options that cut a surface to a part of its volume: --mask, --clip and --sphere.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <glm/vec3.hpp>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/extract/surface_region.h"
#include "isobrick/storage/pyramid.h"
#include "tools/volume_input.h"

namespace isobrick {

struct RegionOptions {
  struct Mask {
    VolumeInput input;
    std::optional<double> value;
    std::shared_ptr<const Pyramid> opened;  // after openMasks()
  };
  // In voxel indices, in world units, or, with a unit, in millimetres of the world.
  template <typename Shape>
  struct Cut {
    Shape shape;
    bool has_unit = false;
  };
  std::vector<Mask> masks;
  std::vector<Cut<HalfSpace>> planes;
  std::vector<Cut<RegionBall>> spheres;

  bool isEverywhere() const { return masks.empty() && planes.empty() && spheres.empty(); }
  std::vector<std::string> files() const;  // of masks, and their pyramids
};

// `has_world`: the command has --world.
void addRegionOptions(CLI::App& app, RegionOptions& options, bool has_world = true);

// findPyramid() of all masks, in this cache folder (empty: the default one).
void findMasks(RegionOptions& options, const std::string& cache_folder, int threads,
               std::uint64_t memory_bytes);
// Opens all masks, each with `memory_bytes`.
void openMasks(RegionOptions& options, std::uint64_t memory_bytes, FileAccess access,
               const RemoteOptions& remote);

// `world`: planes and spheres are in world units. The masks are open.
SurfaceRegion makeRegion(const RegionOptions& options, bool world, const GridGeometry& geometry);

}  // namespace isobrick
