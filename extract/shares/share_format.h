// The file of a share of a mesh, ".isbm", as it lies on disk.
//
//   header     (ShareHeader)
//   batches    (a BatchRecord each, then its positions, normals, triangles and shared vertices; of
//   a
//              surface that is simplified again when it is merged, remains of vertices and
//              triangles)
//   identity   (text: the pyramid and the query)
//
// All numbers are little-endian. It is for the merge that follows: another version of isobrick may
// refuse it. Everything read from here is hostile until mesh_merge.cpp has checked it.
#pragma once

#include <cstdint>
#include <string>

#include "isobrick/extract/query.h"
#include "isobrick/extract/simplify/simplify_remains.h"
#include "isobrick/storage/format.h"  // refuses a big-endian host
#include "isobrick/storage/pyramid.h"

namespace isobrick::share_format {

inline constexpr char kMagic[8] = {'I', 'S', 'O', 'S', 'H', 'A', 'R', 'E'};
inline constexpr std::uint32_t kVersion = 2;

struct Header {
  char magic[8];
  std::uint32_t version;
  std::uint32_t length_unit;  // LengthUnit, of the geometry
  std::uint64_t file_bytes;
  std::uint32_t number, of;                // ShareNumber
  std::uint32_t inside;                    // InsideOf
  std::uint32_t has_caps;                  // 0 or 1
  std::uint64_t first_brick, brick_count;  // of the plan, which has all_bricks
  std::uint64_t all_bricks;
  std::uint64_t batches;    // records
  std::uint64_t triangles;  // of all batches
  std::uint64_t dims[3];    // voxels
  double spacing[3];
  double origin[3];
  double direction[9];              // column-major, as in a pyramid
  double simplify_distance;         // SimplifyOptions of the merge
  std::uint32_t simplify_in_world;  // 0 or 1
  std::uint32_t brick_cells;        // of the groups of the merge; 0: it simplifies nothing
  std::uint64_t identity_bytes;
  std::uint64_t identity_checksum;  // XXH3-64 of the text
  std::uint64_t header_checksum;    // XXH3-64 of all the bytes before it
};
static_assert(sizeof(Header) == 264);

struct BatchRecord {
  std::uint64_t bytes;     // of the record, this struct and the arrays
  std::uint64_t checksum;  // XXH3-64 of all its bytes behind this number
  std::uint32_t level;
  std::uint32_t is_uniform;  // 0 or 1
  std::int64_t brick[3];
  std::int64_t origin[3];
  std::uint32_t positions, indices, shared, transition_indices, cap_indices, reserved;
  std::uint64_t cells, transition_cells;
};
static_assert(sizeof(BatchRecord) == 112);

// A MeshBatch::SharedVertex.
struct SharedRecord {
  std::uint32_t vertex;
  std::uint32_t batches;
  std::uint64_t key;
};
static_assert(sizeof(SharedRecord) == 16);

inline constexpr std::uint64_t kVectorBytes = 12;  // a position or a normal: three f32

// The bytes of a record with these counts.
constexpr std::uint64_t recordBytes(std::uint64_t positions, std::uint64_t indices,
                                    std::uint64_t shared, bool has_remains) {
  return sizeof(BatchRecord) + 2 * kVectorBytes * positions + sizeof(std::uint32_t) * indices +
         sizeof(SharedRecord) * shared +
         (has_remains
              ? sizeof(SimplifyRemains::Vertex) * positions + sizeof(Deviation) * indices / 3
              : 0);
}

}  // namespace isobrick::share_format

namespace isobrick {

// The version of the meshes that a pyramid and a query give. Raise it with every change after which
// they are other ones, so that shares of two programs are not merged.
inline constexpr int kMeshAlgorithm = 4;

// A line for each fact; equal texts mean equal surfaces, batch by batch.
std::string surfaceIdentity(const Pyramid& pyramid, const SurfaceChoice& choice);

// "isovalue=500 (and isovalue=600 in the other)" for the first line that differs.
std::string firstDifference(const std::string& identity, const std::string& other);

}  // namespace isobrick
