#include <openvdb/openvdb.h>
#include <openvdb/tools/Dense.h>
#include <openvdb/tools/VolumeToMesh.h>

#include <algorithm>
#include <vector>

#include "isobrick/storage/voxel_type.h"
#include "tools/bench/peers/peer_engines.h"

namespace isobrick {
namespace {

class OpenVdbEngine : public SurfaceEngine {
 public:
  OpenVdbEngine(const std::string& path, double isovalue, double adaptivity)
      : path_(path), isovalue_(isovalue), adaptivity_(adaptivity) {
    openvdb::initialize();
  }

  void load() override {
    volume_ = std::make_unique<Level0Volume>(path_);
    voxels_.resize(volume_->bytes());
    volume_->copyTo(voxels_.data());
  }

  void prepare() override {
    const auto count = volume_->voxels();
    const openvdb::CoordBBox box(openvdb::Coord(0), openvdb::Coord(static_cast<int>(count[0]) - 1,
                                                                   static_cast<int>(count[1]) - 1,
                                                                   static_cast<int>(count[2]) - 1));
    grid_ = openvdb::FloatGrid::create(static_cast<float>(volume_->leastVoxel()));
    visitVoxelType(voxelTypeNamed(volume_->typeName()).value(), [&](auto tag) {
      using T = typename decltype(tag)::Type;
      const openvdb::tools::Dense<T, openvdb::tools::LayoutXYZ> dense(
          box, reinterpret_cast<T*>(voxels_.data()));
      openvdb::tools::copyFromDense(dense, *grid_, 0.0f);
    });
    voxels_ = {};
    volume_.reset();
  }

  void extract() override {
    openvdb::tools::volumeToMesh(*grid_, points_, triangles_, quads_, isovalue_, adaptivity_);
  }

  SurfaceSize size() const override {
    return {triangles_.size() + 2 * quads_.size(), points_.size(),
            points_.size() * sizeof points_[0] + triangles_.size() * sizeof triangles_[0] +
                quads_.size() * sizeof quads_[0]};
  }

  PlainMesh mesh() const override {
    PlainMesh plain;
    for (const openvdb::Vec3s& p : points_) plain.positions.push_back({p.x(), p.y(), p.z()});
    for (const openvdb::Vec3I& t : triangles_) plain.triangles.push_back({t[0], t[1], t[2]});
    for (const openvdb::Vec4I& q : quads_) {
      plain.triangles.push_back({q[0], q[1], q[2]});
      plain.triangles.push_back({q[0], q[2], q[3]});
    }
    return plain;
  }

  std::string note() const override {
    return "float grid, no normals, quads counted as two triangles, closed at the volume's border";
  }

 private:
  std::string path_;
  double isovalue_, adaptivity_;
  std::unique_ptr<Level0Volume> volume_;  // until there is a grid, as are the voxels
  std::vector<char> voxels_;
  openvdb::FloatGrid::Ptr grid_;
  std::vector<openvdb::Vec3s> points_;
  std::vector<openvdb::Vec3I> triangles_;
  std::vector<openvdb::Vec4I> quads_;
};

}  // namespace

std::unique_ptr<SurfaceEngine> makeOpenVdbEngine(const std::string& path, double isovalue,
                                                 double adaptivity) {
  return std::make_unique<OpenVdbEngine>(path, isovalue, adaptivity);
}

}  // namespace isobrick
