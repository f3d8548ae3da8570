#include "isobrick/viewer/serve/volume_answers.h"

#include <cmath>
#include <cstdint>
#include <glm/common.hpp>
#include <utility>

#include "isobrick/extract/extractor.h"
#include "isobrick/storage/checksum.h"
#include "isobrick/viewer/image.h"
#include "isobrick/viewer/serve/client_message.h"
#include "isobrick/viewer/serve/served_volumes.h"

namespace isobrick {
namespace {

constexpr double kFarVoxels = 1 << 30;

std::optional<IndexPlane> planeOf(const Asked& words) {
  const auto corner = words.point("corner"), across = words.point("across");
  const auto along = words.point("along");
  if (corner && across && along) {
    for (const glm::dvec3& part : {*corner, *across, *along})
      if (glm::any(glm::greaterThan(glm::abs(part), glm::dvec3(kFarVoxels))))
        throw Error("the plane of the slice lies too far away");
    return IndexPlane{*corner, *across, *along};
  }
  if (corner || across || along) throw Error("'corner', 'across' and 'along' come together");
  return std::nullopt;
}

int axisOf(const Asked& words) {
  const std::string name = words.text("axis");
  const int axis = name.empty() || name == "z" ? 2 : name == "y" ? 1 : 0;
  if (axis == 0 && name != "x") throw Error("'axis' is not x, y or z");
  return axis;
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
  order.query.inside = askedInside(words);
  order.query.cap = words.integer("cap", 0, 1).value_or(0) == 1;
  order.query.region = surfaceRegionOf(askedRegion(words), {}, 1.0);
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

SlicePictureOrder slicePictureOrder(const Asked& words) {
  SlicePictureOrder order;
  order.plane = planeOf(words);
  if (!order.plane) {
    order.axis = axisOf(words);
    order.position = words.within("position", 0.0, kFarVoxels);
  }
  order.most_pixels = words.integer("size", 16, 2048).value_or(order.most_pixels);
  order.window = words.pair("window");
  if (const auto isovalue = words.number("iso"))
    order.contours.push_back({*isovalue, glm::vec3(1.0f, 0.75f, 0.2f)});
  order.least = words.number("least");
  return order;
}

IndexPlane planeOf(const SlicePictureOrder& order, const Pyramid& pyramid) {
  if (order.plane) return *order.plane;
  const Index3& voxels = pyramid.spec().voxels;
  const auto last = static_cast<double>(voxels[order.axis] - 1);
  const double position = order.position.value_or(std::floor(0.5 * last));
  if (position > last) throw Error("'position' is not within its bounds");
  return slicePlane(voxels, order.axis, position);
}

std::string slicePicture(const Pyramid& pyramid, const SlicePictureOrder& order,
                         const CancelFlag& cancel) {
  const IndexPlane plane = planeOf(order, pyramid);
  const PlaneSampling sampling = samplingOf(pyramid.lattice(), plane, order.most_pixels);
  const SliceImage values = samplePlane(pyramid, plane, sampling, cancel);
  const auto window =
      order.window.value_or(std::array{pyramid.realRange().min, pyramid.realRange().max});
  const PictureBytes picture = drawSlice(values, window, order.contours, 1.5);
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
