// Isosurfaces as Neuroglancer's multi-resolution meshes.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/triangle_sink.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/grid.h"

namespace isobrick {

// A surface that was written.
struct PrecomputedMesh {
  double isovalue = 0;
  std::uint64_t segment = 0;             // its number in Neuroglancer; 0: it has no triangles
  std::vector<std::uint64_t> triangles;  // of each level, the finest first
  std::uint64_t fragments = 0;           // of all levels
  std::uint64_t bytes = 0;               // of its two files
};

// Writes the folder `path`: the file info, and for each isovalue a segment, from 1 on: all levels
// of the pyramid, each a closed surface of its own, cut at the borders of bricks. Stored positions
// are voxels of level 0; `transform` leads to nanometres, where the voxel i lies at i + 1/2
// spacings, as in the volume that `convert` writes for Neuroglancer. `through` stands between the
// extraction and the sink: it may show progress. Fragments are packed in parallel and wait in a
// temporary file in the folder; memory holds 48 bytes for each. An existing folder is replaced.
// Throws Error, Cancelled.
std::vector<PrecomputedMesh> writePrecomputedMeshes(
    const Pyramid& pyramid, const std::vector<double>& isovalues, InsideOf inside,
    const std::string& path, const CancelFlag* cancel,
    const std::function<ExtractionReport(Extractor&, const Query&, TriangleSink&)>& through);

// True if the name ends so.
bool isPrecomputedName(const std::string& path);
// True if nothing is in the folder but what writePrecomputedMeshes() puts there.
bool holdsPrecomputedMeshes(const std::string& folder);

// The facts that Neuroglancer's formats have no place for, a line each.
std::vector<std::string> neuroglancerLosses(const GridGeometry& geometry);

}  // namespace isobrick
