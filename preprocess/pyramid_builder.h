// The preprocessing as a whole: a volume source in, a pyramid file out, in bounded memory.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid_info.h"

namespace isobrick {

class InputWatch;  // input_identity.h

// Called now and then by one thread at a time: the phase's name and how much of it is done, 0 .. 1.
using BuildProgress = std::function<void(std::string_view phase, double fraction)>;

// The version of the bricks that an input and options give. It is part of the identity, so that
// pyramids and unfinished builds of an older program are built anew. Raise it with every change
// after which the same input and options give other bytes: in a kernel, in the packing, in how a
// source reads its file, in the order of the file. Never raise it for a release alone.
inline constexpr int kBuildAlgorithm = 4;

// A coarse version of the slices that a build has read so far: an ordinary pyramid of the first
// sample in every `step` along each axis, in the volume's place in the world, with all complete
// slices.
struct BuildPreview {
  std::string path;       // of the file
  std::int64_t step = 2;  // voxels from one sample to the next, a power of two
  Index3 voxels{0};       // of the volume that is being built
};

// Previews are published while level 0 is read, each under a name of its own. Each is removed when
// the next is there, and the last when the build ends, so a program opens one as soon as it is
// published, and may remove it. There are none for volumes of at most 128^3 voxels, and none if
// `memory_bytes` is below 160 MiB. They change neither the result nor the bound of the memory.
struct PreviewOptions {
  std::string folder;  // empty: there are none. Best in memory; for this build alone
  // The share of the build's time, 0 .. 1; 0: none; 1: one after every slab of bricks. A first one
  // that takes hardly any time comes after the first slab all the same.
  double most_share = 0.02;
  std::function<void(const BuildPreview&)> published;  // on the caller's thread
};

// How a pyramid is built.
struct BuildOptions {
  std::int64_t brick_cells = 64;  // cells along an edge of a brick: a power of two, 4 .. 256
  std::int64_t tile_cells = 4;    // and of a tile: a power of two, 2 .. brick_cells
  // From a level to the next coarser one.
  format::Filter filter = format::Filter::kAverage;
  // kStored (no compression), kLz4 or kZstd.
  format::Codec codec = format::Codec::kLz4;
  bool with_curvature = true;  // stores bounds, so that queries may have a curvature_tolerance
  // See PyramidSpec::curvature_epsilon; at least 0.
  double curvature_epsilon = 1.0 / 64;
  // Value that takes the place of NaN and infinite voxels; without it they are refused.
  std::optional<float> nan_as;
  // NaN voxels stay: they have no data, and cells that touch one no surface. Then `nan_as` is for
  // infinite ones alone. Not of a divided pyramid.
  bool mask_nan = false;
  // Not empty: the result is an index, which leaves the samples of level 0 in the source. The text
  // is that of sourceRecord() (sources/indexed_source.h). Without `resume`.
  std::string source_record;
  std::string tool_version;  // goes into the provenance; does not change the identity

  // For a divided pyramid (divided_pyramid.h): cells of level 0 along an edge of a super-brick, a
  // power of two, at least those of a brick. buildPyramid() wants 0.
  std::int64_t super_cells = 0;

  // Bounds all buffers of the build together, those of the source included. The rest lies
  // in temporary files in the folder of the output. Does not change the result.
  std::uint64_t memory_bytes = std::uint64_t{1} << 30;
  // Resumes from the files that an interrupted or killed build of the same input with the same
  // options left beside the output; without such files, begins at the beginning. Does not change
  // the result.
  bool resume = false;
  // A build that ends early leaves the files that `resume` takes; if false, it leaves nothing.
  bool keep_unfinished = true;

  const CancelFlag* cancel = nullptr;  // may be null
  BuildProgress progress;              // may be empty
  PreviewOptions preview;              // without a folder there are none
};

// Phases overlap: `busy_seconds` adds up the time that all threads spent in one, computing or
// waiting for the disk.
struct BuildPhase {
  std::string name;         // "read", "low-pass", "ranges", "count", "curvature", "pack", ...
  double busy_seconds = 0;  // of all threads
};

// The result of a build.
struct BuildReport {
  std::vector<BuildPhase> phases;     // in the order of the names above
  double seconds = 0;                 // from the first to the last
  std::uint64_t file_bytes = 0;       // of the pyramid
  std::uint64_t bricks = 0;           // of all levels
  std::uint64_t bricks_resumed = 0;   // taken over from an earlier build
  std::uint64_t replaced_voxels = 0;  // by nan_as
  std::uint64_t missing_voxels = 0;   // without data: BuildOptions::mask_nan
  // Whether any brick stores bounds of the curvature: those that have nothing to gain do not, as in
  // noise, where level 1 is nowhere within half a voxel of level 0.
  bool has_curvature = false;
};

// What is to be said if BuildOptions::with_curvature gave no BuildReport::has_curvature.
std::string noteOfNoCurvature();

// Reads `source` to its end and writes a pyramid to `path`, which appears only when it is complete
// and durable. Uses the calling TBB arena for computing, and a thread each for reading and writing.
// The file does not depend on the number of threads, on memory_bytes, or on the
// point at which earlier builds were interrupted.
//
// Throws Error for bad input and for a memory bound too small for one brick (the message says how
// much it takes), ResumableError if the disk is full or fails, or if the input changed or cannot be
// read any more, and Cancelled. After the last two, "<path>.partial" and its journal stay for
// `resume` if keep_unfinished is set and at least one brick was written, and the message says so;
// otherwise nothing is left. All kept bricks were made from the input as it was at the beginning:
// the times of its files are checked after every window, and its content at the end.
BuildReport buildPyramid(VolumeSource& source, const std::string& path,
                         const BuildOptions& options);
// The same for an input that was sampled already; `input` is that of `source`.
BuildReport buildPyramid(VolumeSource& source, InputWatch& input, const std::string& path,
                         const BuildOptions& options);

// The input of a pyramid and the way it is built, a line each: input (files with sizes, times and
// samples of their content, or a phantom's parameters), how voxels are read, grid, options,
// kBuildAlgorithm. Equal texts mean equal bricks. It is in the provenance, key "identity", and in
// the journal of an unfinished build. `input_identity` is that of the source, on the first line.
std::string buildIdentity(const VolumeInfo& info, const std::string& input_identity,
                          const BuildOptions& options);
// The same, with some blocks of every file read for it.
std::string buildIdentity(const VolumeSource& source, const BuildOptions& options);

}  // namespace isobrick
