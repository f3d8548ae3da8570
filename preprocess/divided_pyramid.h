// A pyramid in a folder of files, which any number of processes and machines build together.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "isobrick/preprocess/pyramid_builder.h"

namespace isobrick {

// The volume is divided into super-bricks, cubes of BuildOptions::super_cells cells. Each has a
// file, made by buildSuperBrick() from little more than its own voxels, in any order, anywhere.
// joinPyramid() makes the coarser levels from what lies in those files, and publishes the index:
// from then on Pyramid opens the folder. Every value is that of one build of the whole volume, so a
// query gives the same mesh.

// The super-brick that is used where a program does not choose: 2048 cells along an edge.
inline constexpr std::int64_t kDefaultSuperCells = 2048;

// The file of one super-brick.
struct SuperBrickFile {
  std::string name;  // in the folder
  IndexBox voxels;   // of level 0; each voxel of the volume is in one of these boxes
  IndexBox reads;    // of level 0: what buildSuperBrick() reads, some voxels around those
};

// All of them, in the order of their numbers. Throws Error if the options are unfit for the volume,
// and if it is so small that its pyramid has a single level.
std::vector<SuperBrickFile> superBrickFiles(const VolumeInfo& info, const BuildOptions& options);

// Builds the file of super-brick `number` in `folder`, which exists, as buildPyramid() builds one;
// there are no previews. A file of that name is replaced. The source should read box by box
// (VolumeSource::readsBoxes()); another one is read up to the super-brick's last slice.
BuildReport buildSuperBrick(VolumeSource& source, const std::string& folder, std::size_t number,
                            const BuildOptions& options);
// The same for an input that was sampled already; `input` is that of `source`.
BuildReport buildSuperBrick(VolumeSource& source, InputWatch& input, const std::string& folder,
                            std::size_t number, const BuildOptions& options);

// What is there under the name of a file of a divided pyramid.
enum class DividedFileState {
  kMissing,         // nothing
  kBuilt,           // a file with this identity, whose header and tables are whole
  kDamaged,         // a pyramid's file that is cut or damaged, or of another place in the volume
  kOfAnotherBuild,  // one of another identity, or no pyramid's
};

// Of a super-brick's file, or the index. `identity` is buildIdentity() of the source and the
// options.
DividedFileState stateOfDividedFile(const std::string& path, const std::string& identity);

// How joinPyramid() works.
struct JoinOptions {
  std::uint64_t memory_bytes = std::uint64_t{1} << 30;  // as of BuildOptions
  const CancelFlag* cancel = nullptr;                   // may be null
  BuildProgress progress;                               // may be empty
};

// What joinPyramid() did.
struct JoinReport {
  std::uint64_t super_bricks = 0;  // files that were joined
  std::uint64_t bricks = 0;        // of all levels, in all files
  std::uint64_t index_bytes = 0;   // of the index
  std::uint64_t file_bytes = 0;    // of all files, the index among them
  std::uint64_t corrections = 0;   // bricks whose ranges coarser levels widened
  double seconds = 0;              // all of it
};

// Checks that all files of super-bricks are in the folder, whole and of one build, makes the
// coarser levels and publishes the index. May be repeated: the result is the same. Reads the tables
// of every file, not the bricks (verifyPyramid() does). Throws Error that names files that are
// missing, damaged or of another build, and as buildPyramid() else.
JoinReport joinPyramid(const std::string& folder, const JoinOptions& options);

}  // namespace isobrick
