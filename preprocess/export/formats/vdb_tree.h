// The tree of an OpenVDB grid, made of a volume. Private to preprocess/export/formats/.
#pragma once

#include <openvdb/openvdb.h>

#include <cmath>
#include <cstdint>
#include <functional>
#include <iosfwd>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "isobrick/preprocess/export/formats/export_volume.h"
#include "isobrick/preprocess/scratch_volume.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// The places of a volume's voxels in its grid, which of them are active, and how they are stored.
struct VdbGridPlan {
  std::string name;
  int level = 0;
  Index3 first{0};  // coordinate of voxel (0,0,0)
  float background = 0;
  float tolerance = 0;
  openvdb::GridClass grid_class = openvdb::GRID_UNKNOWN;
  bool saves_half = false;

  // The value that a voxel counts as: values within the tolerance are the background.
  float valueOf(float value) const {
    return grid_class != openvdb::GRID_LEVEL_SET && std::abs(value - background) <= tolerance
               ? background
               : value;
  }
  // Throws Error if a half float would be infinite and the value is not.
  void refuseBeyondHalf(float value, const std::string& path) const;
  bool isActive(float value) const {
    return grid_class == openvdb::GRID_LEVEL_SET ? std::abs(value) < background
                                                 : value != background;
  }
};

// The leaves' values as the file will have them, in a temporary file until everything before them
// is written: a run for each node above leaves, in the order in which they were made.
class VdbPackedLeaves {
 public:
  explicit VdbPackedLeaves(const std::string& folder);

  // By any number of threads, a node each.
  void put(const openvdb::Coord& node, const std::vector<char>& bytes);
  // The runs of all nodes of `tree` that have leaves, in its order.
  void appendTo(std::ostream& out, const openvdb::FloatTree& tree, const ExportOptions& options,
                const std::function<void(double)>& tick) const;

 private:
  struct Run {
    std::uint64_t first = 0, bytes = 0;
  };
  ScratchVolume file_;
  std::mutex mutex_;  // guards all below
  std::uint64_t end_ = 0;
  std::map<openvdb::Coord, Run> runs_;
};

// Reads all of `source`, which reads boxes, once and in parallel: fills the tree of `grid`, which
// has its class and background already, with nodes without values, and `leaves` with these, packed
// with OpenVDB's `compression`. Holds the nodes, some 120 bytes for each 8x8x8 voxels that are not
// constant, and some 20 MiB a thread, of which it takes as many as options.memory_bytes allows. If
// the nodes take more than that, throws Error with Remedy::kAllowMoreMemory, and for values that
// half floats cannot hold with Remedy::kWholeFloats; both name `path`.
void makeVdbTree(const VolumeSource& source, const VdbGridPlan& plan, std::uint32_t compression,
                 const std::string& path, const ExportOptions& options,
                 const std::function<void(double)>& tick, openvdb::FloatGrid& grid,
                 VdbPackedLeaves& leaves);

}  // namespace isobrick
