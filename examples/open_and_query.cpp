// Opens a pyramid, prints its contents, and writes two surfaces: the bone around a point, as fine
// as the voxels there and coarser with the distance, and all of the skin from a coarser level.
//
//   open_and_query [FILE.isb]    without a file: of a phantom of a head, head.isb
#include <isobrick/isobrick.h>

#include <cstdio>

using namespace isobrick;

namespace {

void writeSurface(Extractor& extractor, const Query& query, const char* path) {
  const auto file = makeMeshFileSink(path);  // the ending decides on the format
  const ExtractionReport report = extractor.extract(query, *file);
  std::printf("%s: %llu triangles of isovalue %g, %llu of %llu bytes read were of its bricks\n",
              path, static_cast<unsigned long long>(report.triangles), query.isovalue,
              static_cast<unsigned long long>(report.bytes_active),
              static_cast<unsigned long long>(report.bytes_read));
  for (const LevelCounts& level : report.levels)
    std::printf("  level %d: %llu triangles\n", level.level,
                static_cast<unsigned long long>(level.triangles));
}

}  // namespace

int main(int argc, char** argv) try {
  const char* const path = argc > 1 ? argv[1] : "head.isb";
  if (argc < 2) buildPyramid(*makePhantomSource({.name = "head", .size = 128}), path, {});

  const Pyramid pyramid(path);
  const Index3 voxels = pyramid.lattice().voxels();
  std::printf("%lld x %lld x %lld voxels of %g to %g, noise %.3g, %d levels\n",
              static_cast<long long>(voxels.x), static_cast<long long>(voxels.y),
              static_cast<long long>(voxels.z), pyramid.realRange().min, pyramid.realRange().max,
              pyramid.noise(), pyramid.lattice().levels());
  const IsovalueSuggestions suggestions = suggestIsovalues(pyramid);
  for (const IsovalueSuggestion& suggestion : suggestions.values)
    std::printf("there is something at isovalue %g\n", suggestion.value);
  if (suggestions.values.empty()) return 0;

  Extractor extractor(pyramid);  // a session: keeps its memory from query to query
  Query bone;
  bone.isovalue = suggestions.values.back().value;
  bone.focus = FocusSphere{glm::dvec3(voxels) * glm::dvec3(0.6, 0.25, 0.6), 20};
  writeSurface(extractor, bone, "around_focus.ply");

  Query skin;
  skin.isovalue = suggestions.values.front().value;
  skin.uniform_level = 1;
  writeSurface(extractor, skin, "coarse.ply");
} catch (const Error& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
