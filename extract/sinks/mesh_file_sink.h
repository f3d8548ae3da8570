// Meshes streamed to files; nothing but shared vertices stays in memory.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "isobrick/extract/color_map.h"
#include "isobrick/extract/pyramid_values.h"
#include "isobrick/extract/sinks/triangle_sink.h"
#include "isobrick/storage/error.h"

namespace isobrick {

// A sink that writes a file and publishes it in finish().
class MeshFileSink : public TriangleSink {
 public:
  // Distinct vertices written; for STL, which has none, three a triangle.
  virtual std::uint64_t vertices() const = 0;
  // After finish(): words on what the format did not keep of the mesh, with figures. Empty:
  // nothing.
  virtual std::string loss() const { return {}; }
  // Between batches: those that come are of another object of the file's one mesh, with no vertex
  // of those before. In .obj its triangles are groups of this name.
  virtual void beginObject(const std::string&) {}
  // After begin(): words on what the format says that nobody knows of the mesh. Empty: nothing.
  virtual std::string assumption() const { return {}; }
};

// The axes of a mesh's coordinates.
enum class MeshSpace {
  kLps,    // of the volume's world, which counts as LPS: left, posterior, superior
  kRas,    // right, anterior, superior: x and y have the other sign
  kIndex,  // voxel indices of level 0
};

// Where a mesh lies. The default: in the world of its volume.
struct MeshPlacement {
  MeshSpace space = MeshSpace::kLps;  // its axes
  // "nm", "um", "mm", "cm", "m", "inch" or "ft"; empty: that of the volume, none of indices.
  std::string unit = {};
  glm::dvec3 shift{0.0};  // added last, in that space and unit
  // Equal in all.
  bool operator==(const MeshPlacement&) const = default;

  // The place of the voxels of a volume there. Throws Error for a unit that is none of these, one
  // of indices, and one of a volume whose own is unknown.
  GridGeometry placed(const GridGeometry& volume) const;
};

// A number for every vertex.
struct VertexAttribute {
  // A letter or '_', then letters, digits and '_', at most kMostAttributeName of them; no two are
  // equal, nor one that the format has itself, such as `x`. In .glb it is `_NAME`.
  std::string name = "value";
  // Null: PlacedBatch::components, whole numbers.
  const VertexValues* values = nullptr;
  // Of .ply and .vtp. Vertices without a value are NaN, or 0 where the type or the format has none.
  // What the type does not hold is an Error. In .glb all are floats.
  AttributeType type = AttributeType::kFloat32;
};
// Characters of an attribute's name.
inline constexpr std::size_t kMostAttributeName = 24;
// True of a name of that form.
bool isAttributeName(std::string_view name);

// Colours for the vertices by one of their attributes: sRGB in .ply (red, green, blue) and .obj
// (behind the position), linear in .glb (COLOR_0).
struct VertexColors {
  std::size_t attribute = 0;  // which of MeshFileOptions::attributes
  // From `low` on to `high`, which is above; vertices without a value are grey. Without a map
  // values are numbers of parts, and each has a colour of its own: componentColor().
  std::optional<ColorMap> map;
  double low = 0;   // has the map's first colour
  double high = 1;  // has its last one
};

// Options of a mesh file. All pointers may be null; their targets outlive the sink.
struct MeshFileOptions {
  // Checked in finish(), which then throws Cancelled and leaves no file.
  const CancelFlag* cancel = nullptr;
  // Of .ply, .vtp and .glb; of .obj for its colours alone. Error for the other formats.
  std::vector<VertexAttribute> attributes = {};
  // Of .ply, .glb and .obj. Error for the other formats.
  std::optional<VertexColors> colors = {};
  // Positions, normals and triangles follow it, and headers say it. Values are those of the places
  // in the volume's world.
  MeshPlacement placement = {};
  // Packs .vtp with zlib. Error for the other formats.
  bool zlib = false;
  // Packs .glb with EXT_meshopt_compression. Error for the other formats.
  bool meshopt = false;
};

// A format of meshes, and which of MeshFileOptions it takes.
struct MeshFormatInfo {
  std::string ending;   // ".ply"
  bool has_attributes;  // MeshFileOptions::attributes
  bool has_colors;      // MeshFileOptions::colors
  bool has_zlib;        // MeshFileOptions::zlib
  bool has_meshopt;     // MeshFileOptions::meshopt
};
// All that makeMeshFileSink() writes.
std::vector<MeshFormatInfo> meshFormats();

// Makes a sink for `path`; its extension decides:
//   .ply  binary little-endian: x y z (float, or double if MeshFrame says that single precision
//         does not separate crossings), nx ny nz, faces with the pyramid level as `level`
//   .stl  binary: triangles without shared vertices, at most 2^32 - 1. Positions are floats: see
//         MeshFileSink::loss()
//   .obj  text: v (digits enough to read the same float or double as in .ply), vn, f
//   .glb  glTF 2.0, binary: POSITION and NORMAL as float, indices of 32 bits; at most 4 GiB. If
//         .ply takes doubles, positions count from the middle of the volume, and the node's
//         translation, which a float holds exactly, leads there. With MeshFileOptions::meshopt
//         positions, always counted from the middle, are rounded to a lattice: of at most 1/8192 of
//         the least spacing if the volume is up to some 1,000 spacings wide. Normals are rounded
//         to 10 bits; the mesh is cut into primitives, whose common vertices are equal
//   .vtp  VTK PolyData, appended data: as .ply, with normals as `Normals`, and `level` of the cells
//   .3mf  an object for 3D printers: positions with digits enough to read back as those of .ply,
//         triangles, the unit; no normals. At most 2^31 - 1 vertices. Lengths of an unknown unit
//         count as millimetres: see MeshFileSink::assumption()
// All but .stl hold at most 2^32 - 1 vertices. All are in the world coordinates of the pyramid, LPS
// as its source has them, or where MeshFileOptions::placement says; their headers say so, and
// whether lengths are millimetres or of an unknown unit (MeshFrame::geometry).
//
// Throws Error for another extension and for a path that cannot be written. The file appears under
// its name in finish(); a sink that is destroyed earlier leaves nothing.
std::unique_ptr<MeshFileSink> makeMeshFileSink(const std::string& path,
                                               const MeshFileOptions& options = {});

}  // namespace isobrick
