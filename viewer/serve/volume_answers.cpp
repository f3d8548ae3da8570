#include "isobrick/viewer/serve/volume_answers.h"

#include <cmath>
#include <cstdint>
#include <glm/common.hpp>
#include <utility>

#include "isobrick/extract/extractor.h"
#include "isobrick/storage/checksum.h"
#include "isobrick/viewer/image.h"
#include "isobrick/viewer/serve/served_volumes.h"

namespace isobrick {
namespace {

constexpr double kFarVoxels = 1 << 30;

IndexPlane planeOf(const Asked& words, const Index3& voxels) {
  const auto corner = words.point("corner"), across = words.point("across");
  const auto along = words.point("along");
  if (corner && across && along) {
    for (const glm::dvec3& part : {*corner, *across, *along})
      if (glm::any(glm::greaterThan(glm::abs(part), glm::dvec3(kFarVoxels))))
        throw Error("the plane of the slice lies too far away");
    return {*corner, *across, *along};
  }
  if (corner || across || along) throw Error("'corner', 'across' and 'along' come together");
  const std::string name = words.text("axis");
  const int axis = name.empty() || name == "z" ? 2 : name == "y" ? 1 : 0;
  if (axis == 0 && name != "x") throw Error("'axis' is not x, y or z");
  const auto last = static_cast<double>(voxels[axis] - 1);
  return slicePlane(voxels, axis,
                    words.within("position", 0.0, last).value_or(std::floor(0.5 * last)));
}

}  // namespace

SurfaceFileOrder surfaceFileOrder(const Asked& words, const std::string& extension) {
  SurfaceFileOrder order;
  const auto isovalue = words.number("iso");
  if (!isovalue) throw Error("'iso' is missing: the isovalue of the surface");
  order.query.isovalue = *isovalue;
  const auto focus = words.point("focus");
  const auto radius = words.within("radius", 0.0, kFarVoxels);
  if (focus.has_value() != radius.has_value()) throw Error("'focus' and 'radius' come together");
  if (focus)
    order.query.focus =
        FocusSphere{glm::clamp(*focus, glm::dvec3(-kFarVoxels), glm::dvec3(kFarVoxels)), *radius};
  order.query.uniform_level = words.integer("level", 0, 63);
  if (focus && order.query.uniform_level) throw Error("'focus' and 'level' do not go together");
  if (const auto distance = words.within("simplify", 1e-6, kFarVoxels))
    order.query.simplify = SimplifyOptions{*distance};
  order.options.meshopt = words.integer("meshopt", 0, 1).value_or(0) == 1;
  if (order.options.meshopt && extension != ".glb")
    throw Error("'meshopt' is for surface.glb alone");
  return order;
}

void writeSurfaceFile(const Pyramid& pyramid, SurfaceFileOrder order, const std::string& path,
                      const CancelFlag& cancel) {
  order.query.cancel = order.options.cancel = &cancel;
  extractIsosurface(pyramid, order.query, *makeMeshFileSink(path, order.options));
}

std::string surfaceTag(const OpenedVolume& volume, const Asked& words,
                       const std::string& extension) {
  const std::string all = editionOf(volume) + extension + words.normalized();
  return '"' + std::to_string(checksum64(all.data(), all.size())) + '"';
}

SlicePictureOrder slicePictureOrder(const Asked& words, const Pyramid& pyramid) {
  SlicePictureOrder order;
  order.plane = planeOf(words, pyramid.spec().voxels);
  order.most_pixels = words.integer("size", 16, 2048).value_or(order.most_pixels);
  order.window =
      words.pair("window").value_or(std::array{pyramid.realRange().min, pyramid.realRange().max});
  if (const auto isovalue = words.number("iso"))
    order.contours.push_back({*isovalue, glm::vec3(1.0f, 0.75f, 0.2f)});
  order.least = words.number("least");
  return order;
}

std::string slicePicture(const Pyramid& pyramid, const SlicePictureOrder& order,
                         const CancelFlag& cancel) {
  const PlaneSampling sampling = samplingOf(pyramid.lattice(), order.plane, order.most_pixels);
  const SliceImage values = samplePlane(pyramid, order.plane, sampling, cancel);
  const PictureBytes picture = drawSlice(values, order.window, order.contours, 1.5);
  Image image{picture.width, picture.height, std::vector<float>(3 * values.values.size())};
  if (order.least) image.alpha.resize(values.values.size());
  const auto least = static_cast<float>(values.transform.stored(order.least.value_or(0.0)));
  for (std::size_t i = 0; i < values.values.size(); ++i) {
    const bool is_covered = !order.least || values.values[i] >= least;  // not without a value
    if (order.least && is_covered) image.alpha[i] = 1.0f;
    for (std::size_t c = 0; c < 3 && is_covered; ++c)
      image.rgb[3 * i + c] = linearFromSrgb(static_cast<float>(picture.rgba[4 * i + c]) / 255.0f);
  }
  const std::vector<char> bytes = encodeImage(ImageFormat::kPng, image);
  return {bytes.begin(), bytes.end()};
}

}  // namespace isobrick
