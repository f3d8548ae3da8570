#include "isobrick/preprocess/sources/bdv_xml.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <glm/geometric.hpp>
#include <glm/mat4x4.hpp>
#include <optional>
#include <sstream>
#include <vector>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/xml_tree.h"

namespace isobrick {
namespace {

std::vector<double> doublesOf(const std::string& text) {
  std::vector<double> numbers;
  std::istringstream words(text);
  for (std::string word; words >> word;) {
    const auto number = numberIn<double>(word);
    if (!number) return {};
    numbers.push_back(*number);
  }
  return numbers;
}

std::int64_t integerOf(const std::string& text) { return numberIn<std::int64_t>(text).value_or(0); }

std::string hdf5PathOf(const std::string& path, const XmlElement& root) {
  const XmlElement* const loader = root.find({"SequenceDescription", "ImageLoader"});
  const XmlElement* const file = loader == nullptr ? nullptr : loader->find({"hdf5"});
  if (file == nullptr)
    throw unusable(path,
                   "its images lie in " +
                       quotedText(loader == nullptr ? "nothing" : loader->attribute("format"), 40) +
                       ", and only 'bdv.hdf5' is read; name the images themselves, or save "
                       "it as XML/HDF5 with Fiji");
  const std::filesystem::path said(file->text);
  if (file->attribute("type") != "relative") return file->text;
  return (std::filesystem::path(path).parent_path() / root.textOf({"BasePath"}) / said)
      .lexically_normal()
      .string();
}

// Transforms of a view: the last one is applied first.
glm::dmat4 placeOf(const std::string& path, const XmlElement& registration) {
  glm::dmat4 place(1.0);
  for (const XmlElement& transform : registration.children) {
    if (transform.name != "ViewTransform") continue;
    const std::vector<double> rows = doublesOf(transform.textOf({"affine"}));
    if (rows.size() != 12)
      throw unusable(path, "a transform of its views is not twelve numbers; correct it");
    glm::dmat4 step(1.0);
    for (int row = 0; row < 3; ++row)
      for (int column = 0; column < 4; ++column)
        step[column][row] = rows[static_cast<std::size_t>(4 * row + column)];
    place = place * step;
  }
  return place;
}

}  // namespace

BdvDataset readBdvXml(const std::string& path) {
  const XmlElement root = readXml(path);
  if (root.name != "SpimData")
    throw unusable(path,
                   "it is XML of " + quotedText(root.name, 40) +
                       ", and only BigDataViewer's (SpimData) is read; name the volume itself");
  BdvDataset dataset;
  dataset.xml_path = path;
  dataset.hdf5_path = hdf5PathOf(path, root);
  if (const auto* const setups = root.find({"SequenceDescription", "ViewSetups"}))
    for (const XmlElement& setup : setups->children) {
      const std::vector<double> size = doublesOf(setup.textOf({"voxelSize", "size"}));
      if (setup.name != "ViewSetup" || size.size() != 3) continue;
      const std::int64_t id = integerOf(setup.textOf({"id"}));
      dataset.voxel_sizes[id] = {size[0], size[1], size[2]};
      dataset.units[id] = setup.textOf({"voxelSize", "unit"});
    }
  if (const auto* const registrations = root.find({"ViewRegistrations"}))
    for (const XmlElement& view : registrations->children)
      if (view.name == "ViewRegistration")
        dataset
            .places[{integerOf(view.attribute("setup")), integerOf(view.attribute("timepoint"))}] =
            placeOf(path, view);
  return dataset;
}

GridGeometry BdvDataset::geometryOf(std::int64_t setup, std::int64_t time) const {
  GridGeometry geometry;
  const auto size = voxel_sizes.find(setup);
  if (size != voxel_sizes.end()) geometry.spacing = size->second;
  const auto place = places.find({setup, time});
  if (place == places.end()) return geometry;
  glm::dvec3 steps;
  for (int axis = 0; axis < 3; ++axis) {
    const glm::dvec3 column(place->second[axis]);
    steps[axis] = glm::length(column);
    if (!(steps[axis] > 0))
      throw unusable(xml_path, "the place of its view " + std::to_string(setup) +
                                   " makes an axis vanish; correct it");
    geometry.direction[axis] = column / steps[axis];
  }
  geometry.origin = glm::dvec3(place->second[3]);
  if (size == voxel_sizes.end()) {
    geometry.spacing = steps;
    return geometry;
  }
  // BigStitcher counts in voxels of the least size: all lengths by one factor.
  const glm::dvec3 factors = geometry.spacing / steps;
  constexpr double kMostRelative = 1e-3;
  for (int axis = 1; axis < 3; ++axis)
    if (std::abs(factors[axis] / factors[0] - 1) > kMostRelative)
      throw unusable(xml_path, "its voxels have the size " + pointText(geometry.spacing) +
                                   " and its view " + std::to_string(setup) + " places them " +
                                   pointText(steps) +
                                   " apart, in other proportions; correct one of them");
  geometry.origin *= factors[0];
  return geometry;
}

}  // namespace isobrick
