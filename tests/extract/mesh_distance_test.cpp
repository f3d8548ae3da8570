// Distances from meshes whose shape is known, and meshes read from files.
#include "isobrick/extract/mesh_distance.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/read_mesh_file.h"
#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/file_bytes.h"

namespace isobrick::test {
namespace {

// [-1, 1]^3, moved, without the triangles from `triangles` on.
IndexedMesh cubeAt(const glm::dvec3& middle, std::size_t triangles = 12) {
  IndexedMesh mesh;
  for (int corner = 0; corner < 8; ++corner)
    mesh.positions.push_back(
        middle + glm::dvec3(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1));
  mesh.triangles = {0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4,
                    2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3, 7, 5};
  mesh.triangles.resize(3 * triangles);
  return mesh;
}

double cubeDistance(const glm::dvec3& p) {
  const glm::dvec3 away = glm::abs(p) - 1.0;
  const glm::dvec3 outside = glm::max(away, glm::dvec3(0.0));
  return glm::length(outside) + std::min(0.0, std::max({away.x, away.y, away.z}));
}

// Faces, edges and corners are nearest in turn; far from the origin of the world.
TEST(MeshDistance, OfACubeHasItsSign) {
  const glm::dvec3 middle(5e5, -3e6, 100);
  const MeshDistance distance(cubeAt(middle)), open(cubeAt(middle, 11));
  EXPECT_TRUE(distance.isClosed());
  EXPECT_FALSE(open.isClosed());
  std::mt19937 random(7);
  std::uniform_real_distribution<double> place(-2.5, 2.5);
  std::vector<glm::dvec3> world;
  for (int i = 0; i < 5000; ++i)
    world.push_back(middle + glm::dvec3(place(random), place(random), place(random)));
  for (int i = 0; i < 27; ++i)  // straight above faces, edges and corners
    world.push_back(middle + 2.0 * glm::dvec3(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1));
  std::vector<double> found(world.size()), unsigned_found(world.size());
  distance.evaluate(world, {}, found);
  open.evaluate(world, {}, unsigned_found);
  for (std::size_t i = 0; i < world.size(); ++i) {
    ASSERT_NEAR(found[i], cubeDistance(world[i] - middle), 1e-6) << i;
    ASSERT_GE(unsigned_found[i], 0.0);
  }
  EXPECT_THROW(MeshDistance{IndexedMesh()}, Error);
}

IndexedMesh meshOfBall(const TemporaryFolder& folder, const glm::dvec3& center, double radius,
                       const char* name) {
  const Pyramid pyramid(buildField(
      folder, Index3(44), [&](const glm::dvec3& p) { return radius - glm::length(p - center); }, {},
      {}, name));
  IndexedMeshSink sink;
  extractIsosurface(pyramid, Query{}, sink);
  return sink.takeMesh();
}

TEST(MeshDistance, BetweenTwoSpheresIsThatOfTheirCentres) {
  const TemporaryFolder folder;
  const glm::dvec3 large_center(21.3, 21.8, 20.9), small_center(24.1, 20.2, 22.4);
  const double large_radius = 17, small_radius = 8;
  const IndexedMesh small = meshOfBall(folder, small_center, small_radius, "small.isb");
  const IndexedMesh large = meshOfBall(folder, large_center, large_radius, "large.isb");
  const MeshDistance from_large(large), from_small(small);
  std::vector<double> found(small.positions.size());
  from_large.evaluate(small.positions, small.normals, found);
  // Chords of a voxel lie up to 1/(8 r) within the sphere.
  for (std::size_t v = 0; v < found.size(); ++v)
    ASSERT_NEAR(found[v], glm::length(small.positions[v] - large_center) - large_radius, 0.05);
  found.resize(large.positions.size());
  from_small.evaluate(large.positions, large.normals, found);
  for (std::size_t v = 0; v < found.size(); ++v)
    ASSERT_NEAR(found[v], glm::length(large.positions[v] - small_center) - small_radius, 0.05);
}

TEST(ReadMeshFile, HasTheShapeThatWasWritten) {
  const TemporaryFolder folder;
  const Pyramid pyramid(buildField(folder, Index3(20), [](const glm::dvec3& p) {
    return 6 - glm::length(p - glm::dvec3(9.3, 9.9, 10.2));
  }));
  IndexedMeshSink sink;
  extractIsosurface(pyramid, Query{}, sink);
  for (const char* name : {"ball.ply", "ball.stl"}) {
    extractIsosurface(pyramid, Query{}, *makeMeshFileSink(folder.file(name)));
    const IndexedMesh read = readMeshFile(folder.file(name));
    EXPECT_EQ(read.triangles.size(), sink.mesh().triangles.size());
    ASSERT_EQ(read.positions.size(), sink.mesh().positions.size()) << name;
    EXPECT_TRUE(MeshDistance(read).isClosed());
    if (std::string(name) == "ball.ply") {
      for (std::size_t v = 0; v < read.positions.size(); ++v)
        ASSERT_EQ(read.positions[v], glm::dvec3(glm::vec3(sink.mesh().positions[v])));
    }
  }
}

TEST(ReadMeshFile, TakesTextAndPolygons) {
  const TemporaryFolder folder;
  const std::string path = folder.file("square.ply");
  std::ofstream(path) << "ply\r\nformat ascii 1.0\ncomment made by hand\nelement vertex 4\n"
                         "property float x\nproperty uchar red\nproperty float y\n"
                         "property double z\nelement face 1\n"
                         "property list uchar int vertex_indices\nend_header\n"
                         "0 255 0 0.5\n1 0 0 0.5\n1 0 1 0.5\n0 0 1 0.5\n4 0 1 2 3\n";
  const IndexedMesh square = readMeshFile(path);
  EXPECT_EQ(square.triangles, (std::vector<std::uint32_t>{0, 1, 2, 0, 2, 3}));
  ASSERT_EQ(square.positions.size(), 4u);
  EXPECT_EQ(square.positions[2], glm::dvec3(1, 1, 0.5));
}

TEST(ReadMeshFile, RefusesWhatIsDamaged) {
  const TemporaryFolder folder;
  const Pyramid pyramid(
      buildField(folder, Index3(6), [](const glm::dvec3& p) { return 2 - glm::length(p - 2.6); }));
  for (const char* name : {"a.ply", "a.stl"}) {
    const std::string path = folder.file(name);
    extractIsosurface(pyramid, Query{}, *makeMeshFileSink(path));
    const auto bytes = std::filesystem::file_size(path);
    for (std::uintmax_t cut = 1; cut <= bytes; cut += 1 + cut / 9) {
      std::filesystem::resize_file(path, bytes - cut);
      EXPECT_THROW(readMeshFile(path), Error) << name << " without " << cut << " bytes";
      extractIsosurface(pyramid, Query{}, *makeMeshFileSink(path));
    }
  }
  const auto refuse = [&](const std::string& text) {
    std::ofstream(folder.file("b.ply")) << text;
    EXPECT_THROW(readMeshFile(folder.file("b.ply")), Error) << text;
  };
  const std::string head = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\n";
  const std::string face = "element face 1\nproperty list uchar int vertex_index\nend_header\n";
  refuse(head + face + "1\n3 0 0 1\n");
  refuse(head + face + "1\n3 0 0 -1\n");
  refuse(head + face + "nan\n3 0 0 0\n");
  refuse("ply\nformat ascii 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n1\n");
  refuse("ply\nformat binary_big_endian 1.0\nend_header\n");
  refuse("ply\nformat ascii 1.0\nelement vertex 1\nproperty quad x\nend_header\n1\n");
  EXPECT_THROW(readMeshFile(folder.file("none.ply")), Error);
  EXPECT_THROW(readMeshFile(folder.file("a.obj")), Error);
}

}  // namespace
}  // namespace isobrick::test
