// From a volume, or the levels of one, to a file or folder of any format.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/preprocess/export/volume_writer.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/share_number.h"

namespace isobrick {

// The levels to export, finest first: one, or as many as the pyramid has. Spacing doubles from
// one to the next, the origin is the same. For .vdb, sources of nodes (makeNodeSource()) may
// follow; or all are grids of OpenVDB files, each at a place of its own.
using VolumeLevels = std::vector<std::unique_ptr<VolumeSource>>;

// How a volume is written, with the choices that some formats have beside.
struct ExportOptions : VolumeWriteOptions {
  // OpenVDB: the value of voxels that are not stored; without it that of the VDB file the volume
  // came from, or 0. Values no further from it than the tolerance are not stored either.
  std::optional<float> vdb_background;
  double vdb_tolerance = 0;  // of OpenVDB, in the units of the voxels
  // Half floats in place of floats; values that they cannot hold are refused. 8-bit voxels, which
  // lose nothing, are always written so.
  bool vdb_half = false;
  // OpenVDB: "blosc", "zip" or "none"; empty: Blosc if OpenVDB has it.
  std::string vdb_codec = {};
  // OME-Zarr: 3 writes version 0.5 (Zarr 3, chunks of 64 voxels an axis in shards), 2 writes 0.4
  // (Zarr 2, a file for each chunk).
  int zarr_version = 3;
  // Of version 3: voxels of a shard along each axis, a multiple of 64.
  std::int64_t zarr_shard = 512;
  // Of version 3: only this share of the shards, into a folder beside the output
  // ("scan.ome.zarr.part-3-of-8"). Processes may write theirs at any time, each the shards of its
  // own; the one that finds all of them there makes the output, byte for byte that of one process,
  // and removes them. Throws Error if one is of another volume, or of other options.
  std::optional<ShareNumber> zarr_part = {};
  // Values may change by more than a thousandth of their range if the format's types do not hold
  // them; without it that is refused, once all are known.
  bool is_lossy = false;
};

// Writes `levels` to `path`, whose ending decides: all endings of writeVolume(), and
//   .vdb       OpenVDB: a float grid for each level
//   .h5        HDF5: one dataset, named as in "file.h5:/path"
//   .exr       OpenEXR, a slice each, in a folder of their own: "slices/%04d.exr"
//   .tif       TIFF, likewise, or in one file of several pages
//   .ome.zarr  OME-Zarr 0.5 or 0.4, a folder: an array for each level
// docs/FORMATS.md says what each format keeps. Several levels are refused if the format has one.
//
// The output appears under its name when it is whole; a file of that name is replaced. Throws Error
// for other endings, for formats that this build of isobrick leaves out, for a memory bound that is
// too small (Remedy::kAllowMoreMemory; before anything is written), for failed writes, and whatever
// the sources throw; Cancelled.
VolumeWriteReport exportVolume(VolumeLevels& levels, const std::string& path,
                               const ExportOptions& options);

// A format that exportVolume() writes, for a list of them.
struct WritableFormat {
  std::string ending;  // ".nrrd"
  bool has_levels;     // all levels of a pyramid in one file
  bool is_built_in;    // false: this build of isobrick leaves it out
};
// All of them.
std::vector<WritableFormat> writableFormats();

// Throws the Error of exportVolume() for a name, or for several levels; writes nothing.
void refuseUnknownExport(const std::string& path, bool has_levels);

}  // namespace isobrick
