#include "tools/render/picture_surface.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/trigonometric.hpp>
#include <mutex>
#include <utility>

#include "isobrick/extract/color_map.h"
#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/surface_components.h"
#include "isobrick/viewer/stream/chunk_sink.h"
#include "tools/interrupt.h"
#include "tools/measured_sink.h"
#include "tools/progress_bar.h"

namespace isobrick {
namespace {

void extractWithComponents(const Pyramid& pyramid, const Query& query, ProgressBar& bar,
                           ChunkSink& sink, DrawableSurface& result) {
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

}  // namespace

DrawableSurface extractPictureSurface(QueryOptions options, ViewState& view) {
  const auto file = openPyramidFile(options.input.pyramid, options.memory_bytes,
                                    fileAccess(options.no_map), remoteOptions(options.input));
  const Pyramid& pyramid = *file;
  chooseIsovalues(options, pyramid);
  const Query query = makeQuery(options, pyramid);
  DrawableSurface result;
  result.volume.voxels = pyramid.spec().voxels;
  result.volume.geometry = pyramid.spec().geometry;
  view.surfaces[0].isovalue = query.isovalue;
  if (query.focus) {
    view.focus.center = query.focus->center;
    view.focus.radius = query.focus->radius;
  }
  ProgressBar bar(0, "million triangles");
  std::mutex mutex;
  const bool by_component = view.coloring == ViewColoring::kComponent;
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
  return result;
}

ViewCamera cameraOf(const DrawableSurface& surface, const ViewCamera& camera, double aspect,
                    bool turns) {
  CameraFit fit(camera, aspect);
  WorldBox box = emptyWorldBox();
  surface.forEachVertex([&](const glm::dvec3& point) {
    fit.include(point);
    box.include(point);
  });
  if (!turns || box.empty()) return fit.fitted();
  // A sphere around the middle of the surface is just in the picture.
  constexpr double kMargin = 1.06;
  ViewCamera result = camera;
  result.elevation = std::clamp(camera.elevation, -90.0, 90.0);
  result.pivot = box.center();
  double radius = 0.0;
  surface.forEachVertex([&](const glm::dvec3& point) {
    radius = std::max(radius, glm::distance(point, result.pivot));
  });
  const double half = std::tan(0.5 * glm::radians(camera.vertical_fov)) * std::min(1.0, aspect);
  if (radius > 0.0) result.distance = kMargin * radius / std::sin(std::atan(half));
  return result;
}

}  // namespace isobrick
