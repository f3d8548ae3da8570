#include "tools/render/picture_surface.h"

#include <algorithm>
#include <mutex>
#include <utility>

#include "isobrick/extract/extractor.h"
#include "isobrick/viewer/stream/chunk_sink.h"
#include "tools/interrupt.h"
#include "tools/measured_sink.h"
#include "tools/progress_bar.h"

namespace isobrick {

PictureSurface extractPictureSurface(QueryOptions options) {
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
  ChunkSink sink({}, nullptr, [&](std::size_t place, SurfaceChunk&& chunk) {
    const std::lock_guard lock(mutex);
    if (result.chunks.size() <= place) result.chunks.resize(place + 1);
    result.chunks[place] = std::move(chunk);
  });
  MeasuredSink measured(sink, bar);
  result.triangles = extractIsosurface(pyramid, query, measured).triangles;
  warnOfEmptySurface(options, pyramid);
  if (query.focus)
    result.focus = {geometry.indexToWorld(query.focus->center),
                    query.focus->radius *
                        std::min({geometry.spacing.x, geometry.spacing.y, geometry.spacing.z})};
  return result;
}

}  // namespace isobrick
