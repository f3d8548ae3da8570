#include "isobrick/viewer/serve/volume_answers.h"

#include <cmath>
#include <glm/common.hpp>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "isobrick/storage/checksum.h"
#include "isobrick/viewer/image.h"
#include "isobrick/viewer/serve/served_volumes.h"
#include "isobrick/viewer/stream/plane_sampler.h"

namespace isobrick {
namespace {

constexpr double kFarVoxels = 1 << 30;

std::function<IndexPlane(const Pyramid&)> planeOf(const Asked& words) {
  const auto corner = words.point("corner"), across = words.point("across");
  const auto along = words.point("along");
  if (corner || across || along) {
    require(corner && across && along, 400, "'corner', 'across' and 'along' come together");
    const IndexPlane plane{*corner, *across, *along};
    for (const glm::dvec3& part : {plane.corner, plane.across, plane.along})
      require(glm::all(glm::lessThanEqual(glm::abs(part), glm::dvec3(kFarVoxels))), 400,
              "the plane of the slice lies too far away");
    return [plane](const Pyramid&) { return plane; };
  }
  const std::string name = words.text("axis");
  const int axis = name.empty() || name == "z" ? 2 : name == "y" ? 1 : 0;
  require(axis != 0 || name == "x", 400, "'axis' is not x, y or z");
  const auto wanted = words.within("position", 0.0, kFarVoxels);
  return [axis, wanted](const Pyramid& pyramid) {
    const Index3& voxels = pyramid.spec().voxels;
    const auto last = static_cast<double>(voxels[axis] - 1);
    const double position = wanted.value_or(std::floor(0.5 * last));
    require(position <= last, 400, "'position' is not within its bounds");
    return slicePlane(voxels, axis, position);
  };
}

// Pixels below `least`, or without a value, are transparent.
Image imageOf(const SliceImage& values, const PictureBytes& picture,
              const std::optional<double>& least) {
  const std::size_t pixels = values.values.size();
  Image image{picture.width, picture.height, std::vector<float>(3 * pixels)};
  if (least) image.alpha.resize(pixels);
  const auto stored_least = static_cast<float>(values.transform.stored(least.value_or(0.0)));
  for (std::size_t i = 0; i < pixels; ++i) {
    const bool is_covered = !least || values.values[i] >= stored_least;
    if (least && is_covered) image.alpha[i] = 1.0f;
    for (std::size_t c = 0; c < 3 && is_covered; ++c)
      image.rgb[3 * i + c] = linearFromSrgb(static_cast<float>(picture.rgba[4 * i + c]) / 255.0f);
  }
  return image;
}

}  // namespace

SurfaceFile surfaceFileOf(const Asked& words, const std::string& extension) {
  Query query;
  const auto isovalue = words.number("iso");
  require(isovalue.has_value(), 400, "'iso' is missing: the isovalue of the surface");
  query.isovalue = *isovalue;
  const auto focus = words.point("focus");
  const auto radius = words.within("radius", 0.0, kFarVoxels);
  require(focus.has_value() == radius.has_value(), 400, "'focus' and 'radius' come together");
  if (focus)
    query.focus =
        FocusSphere{glm::clamp(*focus, glm::dvec3(-kFarVoxels), glm::dvec3(kFarVoxels)), *radius};
  query.uniform_level = words.integer("level", 0, 63);
  require(!focus || !query.uniform_level, 400, "'focus' and 'level' do not go together");
  if (const auto distance = words.within("simplify", 1e-6, kFarVoxels))
    query.simplify = SimplifyOptions{*distance};
  MeshFileOptions options;
  options.meshopt = words.integer("meshopt", 0, 1) == 1;
  require(!options.meshopt || extension == ".glb", 400, "'meshopt' is for surface.glb alone");
  return [query, options](const Pyramid& pyramid, const std::string& path,
                          const CancelFlag& cancel) mutable {
    query.cancel = options.cancel = &cancel;
    extractIsosurface(pyramid, query, *makeMeshFileSink(path, options));
  };
}

std::string surfaceTag(const OpenedVolume& volume, const Asked& words,
                       const std::string& extension) {
  const std::string all = editionOf(volume) + extension + words.normalized();
  return '"' + std::to_string(checksum64(all.data(), all.size())) + '"';
}

SlicePicture slicePictureOf(const Asked& words) {
  const int most_pixels = words.integer("size", 16, 2048).value_or(512);
  const auto wanted_window = words.pair("window");
  std::vector<SliceContour> contours;
  if (const auto isovalue = words.number("iso"))
    contours.push_back({*isovalue, glm::vec3(1.0f, 0.75f, 0.2f)});
  return [=, plane_of = planeOf(words), least = words.number("least")](const Pyramid& pyramid,
                                                                       const CancelFlag& cancel) {
    const IndexPlane plane = plane_of(pyramid);
    const PlaneSampling sampling = samplingOf(pyramid.lattice(), plane, most_pixels);
    const SliceImage values = samplePlane(pyramid, plane, sampling, cancel);
    const auto window =
        wanted_window.value_or(std::array{pyramid.realRange().min, pyramid.realRange().max});
    const PictureBytes picture = drawSlice(values, window, contours, 1.5);
    const std::vector<char> bytes = encodeImage(ImageFormat::kPng, imageOf(values, picture, least));
    return std::string(bytes.begin(), bytes.end());
  };
}

}  // namespace isobrick
