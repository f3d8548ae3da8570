// How long a progressive query takes, from opening the file:
//
//   progressive_times FILE.isb ISOVALUE THREADS [X,Y,Z RADIUS]
//
// Prints seconds to the first surface and to the complete one, with their triangles, as JSON. Drop
// the file from the page cache before, if it is to be cold. tools/benchmark.sh and
// tools/bench_guard.sh run it.
#include <isobrick/isobrick.h>
#include <tbb/global_control.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>

using namespace isobrick;

namespace {

double secondsSince(std::chrono::steady_clock::time_point begin) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

int measure(int argc, char** argv) {
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                  static_cast<std::size_t>(std::atoi(argv[3])));
  Query query;
  query.isovalue = std::atof(argv[2]);
  query.is_progressive = true;
  if (argc == 6) {
    glm::dvec3 center;
    if (std::sscanf(argv[4], "%lf,%lf,%lf", &center.x, &center.y, &center.z) != 3) {
      std::fprintf(stderr, "progressive_times: '%s' is no point; give X,Y,Z\n", argv[4]);
      return 2;
    }
    query.focus = FocusSphere{center, std::atof(argv[5])};
  }
  const auto begin = std::chrono::steady_clock::now();
  const Pyramid pyramid(argv[1]);
  const double opened = secondsSince(begin);
  Extractor extractor(pyramid);
  SurfaceMesh mesh;
  ExtractionReport report = extractor.extract(query, mesh);
  const double first = secondsSince(begin);
  const auto first_triangles = static_cast<unsigned long long>(report.triangles);
  int passes = 1;
  std::uint64_t bytes_read = report.bytes_read;
  while (!report.is_complete && extractor.waitForBricks(std::chrono::milliseconds(50))) {
    report = extractor.extract(query, mesh);
    bytes_read += report.bytes_read;
    ++passes;
  }
  std::printf(
      "{\"opened\": %.6f, \"first\": %.6f, \"first_triangles\": %llu, \"last\": %.6f, "
      "\"triangles\": %llu, "
      "\"passes\": %d, \"bytes_read\": %llu}\n",
      opened, first, first_triangles, secondsSince(begin),
      static_cast<unsigned long long>(report.triangles), passes,
      static_cast<unsigned long long>(bytes_read));
  return report.is_complete ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4 && argc != 6) {
    std::fputs("usage: progressive_times FILE.isb ISOVALUE THREADS [X,Y,Z RADIUS]\n", stderr);
    return 2;
  }
  try {
    return measure(argc, argv);
  } catch (const Error& failure) {
    std::fprintf(stderr, "progressive_times: %s\n", failure.what());
    return 1;
  }
}
