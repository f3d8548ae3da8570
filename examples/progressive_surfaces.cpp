// A surface at once, and finer each time the query is asked again, as in a viewer. Each query is
// answered from the bricks in memory; the missing ones come in meanwhile, first those near the
// focus. The last one is the surface that the same query gives if it is not progressive, to the
// byte: it goes to refined.ply.
#include <isobrick/isobrick.h>

#include <chrono>
#include <cstdio>

using namespace isobrick;

int main() try {
  buildPyramid(*makePhantomSource({.name = "head", .size = 256}), "progressive.isb", {});

  const Pyramid pyramid("progressive.isb");  // nothing of it is in memory yet
  Query query;
  query.isovalue = 1324;
  query.focus = FocusSphere{{150, 60, 150}, 60};
  query.is_progressive = true;

  Extractor extractor(pyramid);
  SurfaceMesh mesh;  // keeps its memory; valid until the next extraction into it
  ExtractionReport report;
  int passes = 0;
  do {
    report = extractor.extract(query, mesh);
    std::printf("pass %d: %llu triangles, the finest of level %d%s\n", ++passes,
                static_cast<unsigned long long>(report.triangles),
                report.levels.empty() ? 0 : report.levels.front().level,
                report.is_complete ? "" : "; more to come");
    // Here a viewer draws mesh.positions(), normals() and triangles(), a part at a time: a part has
    // an origin, and its positions count from there.
  } while (!report.is_complete && extractor.waitForBricks(std::chrono::milliseconds(50)));

  query.is_progressive = false;
  SurfaceMesh whole;
  const ExtractionReport full = extractIsosurface(pyramid, query, whole);
  const bool is_same = mesh.positions().size() == whole.positions().size() &&
                       mesh.triangles().size() == whole.triangles().size() &&
                       full.triangles == report.triangles;
  std::printf("%d passes; the last one is %s\n", passes, is_same ? "the whole surface" : "coarser");

  const auto file = makeMeshFileSink("refined.ply");
  extractor.extract(query, *file);
  return is_same ? 0 : 1;
} catch (const Error& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
