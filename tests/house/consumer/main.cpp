// The library in a few lines: make a volume, build its pyramid, open it, extract a surface.
#include <cstdio>

#include "extract/extractor.h"
#include "extract/sinks/indexed_mesh.h"
#include "preprocess/phantoms/phantom.h"
#include "preprocess/pyramid_builder.h"

int main() {
  isobrick::PhantomSpec sphere;
  sphere.name = "sphere";
  sphere.size = 32;
  const auto source = isobrick::makePhantomSource(sphere);
  isobrick::buildPyramid(*source, "consumer.isb", isobrick::BuildOptions{});

  const isobrick::Pyramid pyramid("consumer.isb");
  isobrick::Query query;
  query.isovalue = 0;
  query.focus = isobrick::FocusSphere{{16, 16, 28}, 3};
  isobrick::IndexedMeshSink sink;
  const isobrick::ExtractionReport report = isobrick::extractIsosurface(pyramid, query, sink);
  std::printf("%zu vertices, %llu triangles\n", sink.mesh().positions.size(),
              static_cast<unsigned long long>(report.triangles));
  return report.triangles > 0 ? 0 : 1;
}
