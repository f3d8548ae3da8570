// A piece of a surface as it goes to a graphics card, or another front end, and stays there.
#pragma once

#include <array>
#include <compare>
#include <cstddef>
#include <cstdint>
#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>
#include <optional>
#include <vector>

#include "isobrick/extract/query.h"

namespace isobrick {

// The value of a vertex that has none.
inline constexpr std::int16_t kNoVertexValue = -32768;

// 20 bytes, as the shaders read them.
struct SurfaceVertex {
  glm::vec3 position{0.0f};              // from the chunk's origin, in the scene's lattice
  std::array<std::int16_t, 3> normal{};  // world, outward, unit = 32767
  std::int16_t value = kNoVertexValue;   // see packValue(), packComponent()
};
static_assert(sizeof(SurfaceVertex) == 20);

// A unit vector as SurfaceVertex::normal.
std::array<std::int16_t, 3> packNormal(const glm::vec3& normal);
// The inverse.
glm::vec3 unpackNormal(const std::array<std::int16_t, 3>& packed);
// A share of the range of all values, 0 .. 1, as -32766 .. 32767; not a number: kNoVertexValue.
std::int16_t packValue(double share);
// The place of a component's colour (componentColor), 0 .. 6, from its number; kNoComponent:
// kNoVertexValue.
std::int16_t packComponent(std::uint32_t number);

// The facts that the content of a chunk depends on, if it does not depend on other bricks: equal
// keys mean equal bytes.
struct ChunkKey {
  int surface = 0;                      // its number in the scene
  double isovalue = 0.0;                // of the query
  std::uint64_t values = 0;             // a number for the values at vertices; 0: none
  std::uint64_t components = 0;         // a number for the list that colours them; 0: none
  int level = 0;                        // of the pyramid
  std::array<std::int64_t, 3> brick{};  // of that level
  InsideOf inside = InsideOf::kAbove;   // of the query
  bool has_caps = false;                // Query::cap

  auto operator<=>(const ChunkKey&) const = default;  // an order of any kind
};

// The part of a surface that one brick adds: indexed triangles of one level. Positions are floats
// from an origin of their own, so they are as exact at the far end of a volume as at its near end.
struct SurfaceChunk {
  glm::dvec3 origin{0.0};                // whole numbers of the scene's lattice
  std::vector<SurfaceVertex> vertices;   // counted from the origin
  glm::vec3 lower{0.0f};                 // of the least box around the vertices
  glm::vec3 upper{0.0f};                 // likewise
  std::vector<std::uint32_t> triangles;  // 3 indices each, counter-clockwise seen from the outside
  // The last so many of them belong to transition cells, which join two levels.
  std::size_t transition_indices = 0;
  int level = 0;                // of the pyramid
  int surface = 0;              // which of the scene's surfaces
  std::uint64_t cells = 0;      // leaves that it is made of
  std::optional<ChunkKey> key;  // of a brick that only leaves of its level touch
  // In place of vertices and triangles, if the stream packs them (ChunkDelivery).
  std::vector<std::byte> packed = {};

  // Of vertices and triangles, and as packed.
  std::uint64_t bytes() const {
    return vertices.size() * sizeof(SurfaceVertex) + triangles.size() * sizeof(std::uint32_t) +
           packed.size();
  }
};

// Sets `lower` and `upper`.
void boundChunk(SurfaceChunk& chunk);

// How the lattice of a scene lies in the world: world = origin + matrix * lattice. For pyramids the
// lattice is that of the voxels.
struct SceneLattice {
  glm::dmat3 matrix{1.0};  // world units a step of the lattice
  glm::dvec3 origin{0.0};  // world units

  // A point of the lattice in the world.
  glm::dvec3 toWorld(const glm::dvec3& point) const { return origin + matrix * point; }
  // The inverse.
  glm::dvec3 toLattice(const glm::dvec3& world) const;
  bool operator==(const SceneLattice&) const = default;  // equal in both
};

// The eye in the lattice, in two parts: a snapped one for which origin - snapped is a float without
// rounding for every chunk within `reach` of it, and the small rest that is the same for all. Then
// position + (origin - snapped) is the correctly rounded sum for both chunks at a brick's side, so
// the sides of neighbours have the same bits and nothing shines through between them.
struct SnappedEye {
  glm::dvec3 snapped{0.0};  // of the lattice
  glm::dvec3 rest{0.0};     // eye - snapped

  // What a chunk's positions are moved by.
  glm::vec3 offsetOf(const SurfaceChunk& chunk) const { return offsetOf(chunk.origin); }
  // The same for its origin.
  glm::vec3 offsetOf(const glm::dvec3& origin) const { return glm::vec3(origin - snapped); }
};
// For chunks whose origins are at most `reach` away from the eye.
SnappedEye snapEye(const glm::dvec3& eye, double reach);

}  // namespace isobrick
