#include "tools/render/picture_surface.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/trigonometric.hpp>
#include <mutex>
#include <utility>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/surface_components.h"
#include "isobrick/viewer/color_map.h"
#include "isobrick/viewer/state/view_camera.h"
#include "isobrick/viewer/stream/chunk_sink.h"
#include "tools/interrupt.h"
#include "tools/measured_sink.h"
#include "tools/progress_bar.h"

namespace isobrick {
namespace {

void extractWithComponents(const Pyramid& pyramid, const Query& query, ProgressBar& bar,
                           ChunkSink& sink, PictureSurface& result) {
  Extractor extractor(pyramid);
  ComponentFinder finder(query);
  MeasuredSink found(finder, bar);
  extractor.extract(query, found);
  const SurfaceComponents components = finder.take();
  ComponentFilter filter(components, components.list().size(), sink);
  MeasuredSink measured(filter, bar);
  result.triangles = extractor.extract(query, measured).triangles;
  result.pieces.isovalue = query.isovalue;
  result.pieces.count = components.list().size();
  for (std::size_t i = 0; i < std::min(kComponentColorCount, components.list().size()); ++i)
    result.pieces.largest.emplace_back(i, components.list()[i].area);
}

template <typename F>
void forEachVertex(const PictureSurface& surface, F&& f) {
  for (const SurfaceChunk& chunk : surface.chunks)
    for (const SurfaceVertex& vertex : chunk.vertices)
      f(surface.lattice.toWorld(chunk.origin + glm::dvec3(vertex.position)));
}

// In front, with a sphere around the middle of the surface just in the picture.
ViewCamera cameraAround(const RenderOptions& options, const PictureSurface& surface) {
  constexpr double kMargin = 1.06;
  WorldBox box = emptyWorldBox();
  forEachVertex(surface, [&](const glm::dvec3& point) { box.include(point); });
  ViewCamera camera;
  if (box.empty()) return camera;
  camera.pivot = box.center();
  double radius = 0.0;
  forEachVertex(surface, [&](const glm::dvec3& point) {
    radius = std::max(radius, glm::distance(point, camera.pivot));
  });
  const double half_height = std::tan(0.5 * glm::radians(options.vertical_fov));
  const double half_width = half_height * options.width / options.height;
  const double sine = std::sin(std::atan(std::min(half_height, half_width)));
  if (radius > 0.0) camera.distance = kMargin * radius / sine;
  return camera;
}

}  // namespace

PictureSurface extractPictureSurface(QueryOptions options, bool by_component) {
  const auto file = openPyramidFile(options.input.pyramid, options.memory_bytes,
                                    fileAccess(options.no_map), remoteOptions(options.input));
  const Pyramid& pyramid = *file;
  chooseIsovalues(options, pyramid);
  const Query query = makeQuery(options, pyramid);
  const GridGeometry& geometry = pyramid.spec().geometry;
  PictureSurface result;
  result.lattice = latticeOf(geometry);
  result.isovalue = query.isovalue;
  result.unit = geometry.unit;
  ProgressBar bar(0, "million triangles");
  std::mutex mutex;
  ChunkSink sink({}, {nullptr, by_component}, [&](std::size_t place, SurfaceChunk&& chunk) {
    const std::lock_guard lock(mutex);
    if (result.chunks.size() <= place) result.chunks.resize(place + 1);
    result.chunks[place] = std::move(chunk);
  });
  if (by_component) {
    extractWithComponents(pyramid, query, bar, sink, result);
  } else {
    MeasuredSink measured(sink, bar);
    result.triangles = extractIsosurface(pyramid, query, measured).triangles;
  }
  warnOfEmptySurface(options, pyramid);
  if (query.focus)
    result.focus = {geometry.indexToWorld(query.focus->center),
                    query.focus->radius * geometry.leastSpacing()};
  return result;
}

std::vector<RenderOptions> turntable(const RenderOptions& options, const PictureSurface& surface,
                                     int count) {
  ViewCamera camera = cameraAround(options, surface);
  camera.elevation = std::clamp(options.orbit.elevation, -90.0, 90.0);
  std::vector<RenderOptions> all;
  for (int i = 0; i < count; ++i) {
    camera.azimuth = options.orbit.azimuth + 360.0 * i / count;
    const PlacedCamera placed = placeCamera(camera, 1.0);
    all.push_back(options);
    all.back().look_at = LookAtCamera{placed.eye, camera.pivot, placed.up};
  }
  return all;
}

}  // namespace isobrick
