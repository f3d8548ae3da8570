#include <openvdb/openvdb.h>
#include <openvdb/tools/Dense.h>
#include <openvdb/tools/MultiResGrid.h>

#include "tools/bench/peers/pyramid_peers.h"

namespace isobrick {
namespace {

class OpenVdbPyramid : public PeerPyramid {
 public:
  OpenVdbPyramid(const PeerVolume& volume, int levels) : volume_(volume), levels_(levels) {
    openvdb::initialize();
  }

  void load() override {
    const openvdb::CoordBBox box(
        openvdb::Coord(0),
        openvdb::Coord(static_cast<int>(volume_.x) - 1, static_cast<int>(volume_.y) - 1,
                       static_cast<int>(volume_.z) - 1));
    const openvdb::tools::Dense<const float, openvdb::tools::LayoutXYZ> dense(
        box, volume_.values.data());
    grid_ = openvdb::FloatGrid::create(0.0f);
    openvdb::tools::copyFromDense(dense, *grid_, 0.0f);
  }

  PeerPyramidSize make() override {
    const openvdb::tools::MultiResGrid<openvdb::FloatTree> pyramid(
        static_cast<std::size_t>(levels_), *grid_);
    PeerPyramidSize size;
    for (int level = 0; level < levels_; ++level) {
      const auto tree = pyramid.constTreePtr(static_cast<std::size_t>(level));
      if (level > 0) size.coarser_samples += tree->activeVoxelCount();
      size.bytes += tree->memUsage();
    }
    return size;
  }

 private:
  const PeerVolume& volume_;
  int levels_;
  openvdb::FloatGrid::Ptr grid_;
};

}  // namespace

std::unique_ptr<PeerPyramid> makeOpenVdbPyramid(const std::string& row, const PeerVolume& volume,
                                                int levels) {
  if (row != "openvdbMultiResGrid") return nullptr;
  return std::make_unique<OpenVdbPyramid>(volume, levels);
}

}  // namespace isobrick
