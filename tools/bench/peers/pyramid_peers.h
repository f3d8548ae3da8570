// Pyramids of other libraries, for build times beside ours. They stay in memory: neither library
// has a file that is paged.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace isobrick {

struct PeerPyramidSize {
  std::uint64_t coarser_samples = 0;  // of all levels but the finest
  std::uint64_t bytes = 0;            // of all levels, as far as the library says
};

class PeerPyramid {
 public:
  virtual ~PeerPyramid() = default;

  // Takes the voxels, x fastest, in the form in which the library wants its input.
  virtual void load() = 0;
  // Makes all levels anew.
  virtual PeerPyramidSize make() = 0;
};

// Factors 1, 2, 4, ... in `levels` levels; `voxels` (x, y, z) must outlive the pyramid.
struct PeerVolume {
  std::vector<float> values;
  std::int64_t x = 0, y = 0, z = 0;
};

// `row` is itkRecursivePyramid (itk::RecursiveMultiResolutionPyramidImageFilter, Gaussian) or
// itkBinShrink (itk::BinShrinkImageFilter again and again, means of 2x2x2); null for another. Sets
// the number of threads of ITK as a whole.
std::unique_ptr<PeerPyramid> makeItkPyramid(const std::string& row, const PeerVolume& volume,
                                            int levels, int threads);
// `row` is openvdbMultiResGrid (openvdb::tools::MultiResGrid of a FloatTree); null for another.
// Uses the calling TBB arena.
std::unique_ptr<PeerPyramid> makeOpenVdbPyramid(const std::string& row, const PeerVolume& volume,
                                                int levels);

}  // namespace isobrick
