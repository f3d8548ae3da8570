// Pyramids of fields that a test writes down.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/pyramid.h"
#include "tests/support/array_source.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {

using Field = std::function<double(const glm::dvec3&)>;  // of voxel indices

// Builds `name` in the folder, with the field's values as voxels of type T; returns its path.
template <typename T = float>
std::string buildField(const TemporaryFolder& folder, const Index3& dims, const Field& field,
                       const BuildOptions& options = {}, const GridGeometry& geometry = {},
                       const std::string& name = "field.isb") {
  std::vector<T> values;
  for (std::int64_t z = 0; z < dims.z; ++z)
    for (std::int64_t y = 0; y < dims.y; ++y)
      for (std::int64_t x = 0; x < dims.x; ++x)
        values.push_back(static_cast<T>(field(glm::dvec3(x, y, z))));
  ArraySource<T> source(dims, std::move(values), geometry);
  const std::string path = folder.file(name);
  buildPyramid(source, path, options);
  return path;
}

// The same of bricks of 16 cells, so that a small volume has many, and opened.
inline std::shared_ptr<const Pyramid> openField(const TemporaryFolder& folder, const Index3& dims,
                                                const Field& field,
                                                const GridGeometry& geometry = {}) {
  BuildOptions options;
  options.brick_cells = 16;
  return std::make_shared<const Pyramid>(buildField(folder, dims, field, options, geometry));
}

}  // namespace isobrick::test
