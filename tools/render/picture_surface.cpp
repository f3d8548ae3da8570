#include "tools/render/picture_surface.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/trigonometric.hpp>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <utility>

#include "isobrick/extract/color_map.h"
#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/surface_components.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/shallow_json.h"
#include "isobrick/viewer/stream/chunk_sink.h"
#include "isobrick/viewer/stream/moved_chunk.h"
#include "tools/interrupt.h"
#include "tools/measured_sink.h"
#include "tools/progress_bar.h"

namespace isobrick {
namespace {

// A surface in which pieces count: their colours, or which are the largest.
void extractWithComponents(const Pyramid& pyramid, const Query& query,
                           const std::optional<std::uint64_t>& keep_largest, bool by_component,
                           ProgressBar& bar, ChunkSink& sink, DrawableSurface& result) {
  Extractor extractor(pyramid);
  ComponentFinder finder(query);
  MeasuredSink found(finder, bar);
  extractor.extract(query, found);
  const SurfaceComponents components = finder.take();
  const std::vector<SurfaceComponent>& list = components.list();
  const std::vector<std::uint8_t> is_kept =
      keep_largest ? components.largest(*keep_largest) : std::vector<std::uint8_t>(list.size(), 1);
  ComponentFilter filter(components, is_kept, sink);
  MeasuredSink measured(filter, bar);
  result.triangles += extractor.extract(query, measured).triangles;
  if (!by_component) return;
  ColoredPieces& pieces = result.pieces.emplace_back();
  pieces.isovalue = query.isovalue;
  for (std::size_t i = 0; i < list.size(); ++i) {
    if (is_kept[i] == 0) continue;
    ++pieces.count;
    if (pieces.largest.size() < kComponentColorCount) pieces.largest.emplace_back(i, list[i].area);
  }
}

// Chunks become those of the lattice of result.volume.
void extractForPicture(const Pyramid& pyramid, const Query& query, int number,
                       const std::optional<std::uint64_t>& keep_largest, bool by_component,
                       ProgressBar& bar, DrawableSurface& result) {
  const SceneLattice own = latticeOf(pyramid.spec().geometry);
  const SceneLattice scene = latticeOf(result.volume.geometry);
  std::mutex mutex;
  const std::size_t first = result.chunks.size();
  ChunkSink sink({number}, {nullptr, by_component}, [&](std::size_t place, SurfaceChunk&& chunk) {
    if (own != scene) moveChunk(chunk, own, scene);
    const std::lock_guard lock(mutex);
    result.chunks.resize(std::max(result.chunks.size(), first + place + 1));
    result.chunks[first + place] = std::move(chunk);
  });
  if (by_component || keep_largest)
    return extractWithComponents(pyramid, query, keep_largest, by_component, bar, sink, result);
  MeasuredSink measured(sink, bar);
  result.triangles += extractIsosurface(pyramid, query, measured).triangles;
}

// Those of `given`, one for each surface, or `otherwise` of the surface's number.
template <typename Look, typename Otherwise>
Look lookOf(const std::vector<Look>& given, std::size_t number, const Otherwise& otherwise) {
  return given.empty() ? otherwise(number) : given.at(number);
}

struct PictureVolume {
  QueryOptions options;
  std::shared_ptr<const Pyramid> pyramid;
};

std::vector<PictureVolume> openAll(std::vector<QueryOptions> volumes) {
  std::uint64_t pyramids = 0;
  for (const QueryOptions& options : volumes) pyramids += 1 + options.region.masks.size();
  std::vector<PictureVolume> opened;
  for (QueryOptions& options : volumes) {
    const std::uint64_t memory_bytes = options.memory_bytes / pyramids;
    openMasks(options, memory_bytes);
    auto pyramid = openPyramidFile(options.input.pyramid, memory_bytes, fileAccess(options.no_map),
                                   remoteOptions(options.input));
    chooseIsovalues(options, *pyramid);
    refuseTwinIsovalues(options.isovalues);
    opened.push_back({std::move(options), std::move(pyramid)});
  }
  return opened;
}

// That of the channel of the input that the pyramid was made of.
std::optional<glm::vec3> channelColorOf(const Pyramid& pyramid) {
  const nlohmann::json made = parseShallowJson(pyramid.provenance());
  const auto color = parseHexColor(isobrick::textOf(member(member(made, "channel"), "color")));
  if (!color) return std::nullopt;
  return glm::vec3(*color >> 16 & 255, *color >> 8 & 255, *color & 255) / 255.0f;
}

}  // namespace

DrawableSurface extractPictureSurface(std::vector<QueryOptions> volumes, const PictureLooks& looks,
                                      ViewState& view) {
  std::vector<PictureVolume> opened = openAll(std::move(volumes));
  DrawableSurface result;
  result.volume.voxels = opened.front().pyramid->spec().voxels;
  result.volume.geometry = opened.front().pyramid->spec().geometry;
  view.surfaces.clear();
  ProgressBar bar(0, "million triangles");
  for (PictureVolume& volume : opened) {
    QueryOptions& options = volume.options;
    const Pyramid& pyramid = *volume.pyramid;
    for (const std::optional<double>& isovalue : options.isovalues) {
      options.isovalue = *isovalue;
      const Query query = makeQuery(options, pyramid);
      const std::size_t number = view.surfaces.size();
      ViewSurface& surface = view.surfaces.emplace_back();
      surface.isovalue = query.isovalue;
      surface.inside = query.inside;
      surface.color = lookOf(looks.colors, number, [&](std::size_t i) {
        const auto otherwise = i == 0 ? surface.color : componentColor(i);
        return channelColorOf(pyramid).value_or(otherwise);
      });
      surface.opacity = lookOf(looks.opacities, number, [](std::size_t) { return 1.0; });
      if (query.focus && number == 0) {
        view.focus.center = query.focus->center;
        view.focus.radius = query.focus->radius;
      }
      extractForPicture(pyramid, query, static_cast<int>(number), looks.keep_largest,
                        view.coloring == ViewColoring::kComponent, bar, result);
      warnOfEmptySurface(options, pyramid);
    }
  }
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
