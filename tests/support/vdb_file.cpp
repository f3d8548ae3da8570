#include "tests/support/vdb_file.h"

#include <openvdb/openvdb.h>
#include <openvdb/tools/LevelSetSphere.h>

namespace isobrick::test {

void writeVdbFog(const std::string& path, const Index3& voxels, const std::vector<float>& values,
                 double spacing, const glm::dvec3& origin) {
  openvdb::initialize();
  const auto grid = openvdb::FloatGrid::create(0.0f);
  auto to = grid->getAccessor();
  for (std::size_t i = 0; i < values.size(); ++i) {
    const auto at = static_cast<std::int64_t>(i);
    to.setValue(
        openvdb::Coord(static_cast<int>(at % voxels.x), static_cast<int>(at / voxels.x % voxels.y),
                       static_cast<int>(at / voxels.x / voxels.y)),
        values[i]);
  }
  const auto transform = openvdb::math::Transform::createLinearTransform(spacing);
  transform->postTranslate({origin.x, origin.y, origin.z});
  grid->setTransform(transform);
  grid->setName("density");
  grid->setGridClass(openvdb::GRID_FOG_VOLUME);
  openvdb::io::File(path).write({grid});
}

void writeVdbBall(const std::string& path, double radius, const glm::dvec3& center,
                  double spacing) {
  openvdb::initialize();
  const auto grid = openvdb::tools::createLevelSetSphere<openvdb::FloatGrid>(
      static_cast<float>(radius),
      {static_cast<float>(center.x), static_cast<float>(center.y), static_cast<float>(center.z)},
      static_cast<float>(spacing));
  openvdb::io::File(path).write({grid});
}

}  // namespace isobrick::test
