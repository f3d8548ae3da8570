// extract_only FILE.isb ISOVALUE: prints how many triangles the surface has.
#include <isobrick/extract/extractor.h>
#include <isobrick/extract/sinks/vertex_numbering.h>

#include <cstdio>
#include <cstdlib>

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  const isobrick::Pyramid pyramid(argv[1]);
  isobrick::Query query;
  query.isovalue = std::atof(argv[2]);
  isobrick::CountingSink sink;
  isobrick::extractIsosurface(pyramid, query, sink);
  std::printf("%llu triangles\n", static_cast<unsigned long long>(sink.triangles()));
  return sink.triangles() > 0 ? 0 : 1;
}
