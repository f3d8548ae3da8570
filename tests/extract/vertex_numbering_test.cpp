// Which vertices a numbering remembers, and a table of edges whose entries come and go.
#include "isobrick/extract/sinks/vertex_numbering.h"

#include <gtest/gtest.h>

#include <map>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/edge_vertex_map.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "tests/support/array_source.h"
#include "tests/support/random_numbers.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

TEST(EdgeVertexMapTest, KeysThatGoTakeNoOthersWithThem) {
  Random random(5);
  EdgeVertexMap<std::uint32_t> map;
  std::map<EdgeKey, std::uint32_t> expected;
  for (std::uint32_t n = 0; n < 200000; ++n) {
    // Few keys beside each other, so that they displace one another.
    const EdgeKey key = makeEdgeKey(
        Index3(randomInt(random, 0, 12), randomInt(random, 0, 12), randomInt(random, 0, 12)),
        static_cast<int>(randomInt(random, 0, 2)));
    const auto known = expected.find(key);
    const std::uint32_t* found = map.find(key);
    ASSERT_EQ(found != nullptr, known != expected.end());
    if (found == nullptr) {
      map.insert(key, n);
      expected[key] = n;
    } else {
      ASSERT_EQ(*found, known->second);
      map.erase(key);
      expected.erase(known);
    }
    ASSERT_EQ(map.size(), expected.size());
  }
}

// Hands batches on to a numbering and looks at what it holds.
class FrontSink : public TriangleSink {
 public:
  void place(PlacedBatch& placed) override {
    numbering.place(placed);
    most = std::max(most, numbering.remembered());
    shared += placed.batch.shared.size();
  }
  VertexNumbering numbering;
  std::size_t most = 0, shared = 0;
};

TEST(VertexNumberingTest, HoldsTheFrontOfAUniformMeshAndNothingAfterIt) {
  const TemporaryFolder folder;
  const Index3 dims(67, 50, 81);
  Random random(3);
  ArraySource<float> source(dims, arrayOfField<float>(dims, [&](const Index3&) {
                              return static_cast<float>(random() % 100);
                            }));
  BuildOptions options;
  options.brick_cells = 8;
  options.tile_cells = 4;
  buildPyramid(source, folder.file("noise.isb"), options);
  const Pyramid pyramid(folder.file("noise.isb"));
  Query query;
  query.isovalue = 50;
  FrontSink sink;
  extractIsosurface(pyramid, query, sink);
  EXPECT_GT(sink.shared, 100000u);
  EXPECT_LT(sink.most, sink.shared / 4);
  EXPECT_EQ(sink.numbering.remembered(), 0u);
  SurfaceMesh mesh;
  extractIsosurface(pyramid, query, mesh);
  EXPECT_EQ(sink.numbering.count(), mesh.positions().size());

  query.focus = FocusSphere{{30, 20, 40}, 12};
  FrontSink mixed;
  extractIsosurface(pyramid, query, mixed);
  extractIsosurface(pyramid, query, mesh);
  EXPECT_EQ(mixed.numbering.count(), mesh.positions().size());
}

}  // namespace
}  // namespace isobrick::test
