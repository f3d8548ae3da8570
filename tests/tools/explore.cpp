// Random queries around a focus, one after the other in one process, as somebody would explore:
//
//   explore FILE.isb LEAST_ISOVALUE GREATEST_ISOVALUE QUERIES MEMORY_BYTES map|read
//
// Prints a line for each query: its number, its triangles, and a checksum of all that came out, by
// which two runs can be compared; then one JSON object with what the process held at most.
// The queries depend on the file's dimensions and on the first three numbers alone.
#include <sys/resource.h>

#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>

#include "isobrick/extract/extractor.h"
#include "isobrick/storage/pyramid_parts.h"
#include "tests/support/hashing_sink.h"
#include "tests/support/random_numbers.h"

namespace isobrick::test {
namespace {

// A sphere of interest of some 5 % of the volume's edge, anywhere in its middle.
Query anyQuery(const Pyramid& pyramid, double least, double greatest, Random& random) {
  Query query;
  query.isovalue = randomReal(random, least, greatest);
  glm::dvec3 center;
  for (int axis = 0; axis < 3; ++axis)
    center[axis] = randomReal(random, 0.2, 0.8) * static_cast<double>(pyramid.spec().voxels[axis]);
  const auto edge = static_cast<double>(pyramid.spec().voxels.x);
  query.focus = FocusSphere{center, randomReal(random, 0.03, 0.07) * edge};
  return query;
}

int explore(char** words) {
  const double least = std::atof(words[1]), greatest = std::atof(words[2]);
  const int queries = std::atoi(words[3]);
  const Pyramid pyramid(words[0], std::strtoull(words[4], nullptr, 10),
                        std::strcmp(words[5], "read") == 0 ? FileAccess::kRead : FileAccess::kMap);
  Extractor extractor(pyramid);
  Random random(1);
  std::uint64_t triangles = 0;
  for (int n = 0; n < queries; ++n) {
    HashingSink sink;
    extractor.extract(anyQuery(pyramid, least, greatest, random), sink);
    std::printf("%d %" PRIu64 " %016" PRIx64 "\n", n, sink.triangles(), sink.value());
    triangles += sink.triangles();
  }
  rusage usage = {};
  getrusage(RUSAGE_SELF, &usage);
  const BrickPager::Counters counters = pyramid.parts().counters();
  std::printf("{\"triangles\": %" PRIu64 ", \"bytes_read\": %" PRIu64 ", \"evictions\": %" PRIu64
              ", \"peak_rss_bytes\": %" PRIu64 "}\n",
              triangles, counters.bytes_read, counters.parts_released,
              1024 * static_cast<std::uint64_t>(usage.ru_maxrss));
  return 0;
}

}  // namespace
}  // namespace isobrick::test

int main(int argc, char** argv) {
  if (argc != 7) {
    std::fputs("usage: explore FILE.isb LEAST GREATEST QUERIES MEMORY_BYTES map|read\n", stderr);
    return 2;
  }
  try {
    return isobrick::test::explore(argv + 1);
  } catch (const std::exception& failure) {
    std::fprintf(stderr, "explore: %s\n", failure.what());
    return 1;
  }
}
