#include "isobrick/extract/sinks/mesh_file_sink.h"

#include <charconv>
#include <utility>

#include "isobrick/extract/sinks/mesh_formats.h"
#include "isobrick/extract/sinks/mesh_placement.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

constexpr MeshFormat kMeshFormats[] = {
    {".ply", makePlySink, true, false, false},
    {".stl", makeStlSink, false, false, false},
    {".obj", makeObjSink, false, false, false},
    {".glb", makeGlbSink, true, false, true, makeGlbCollection},
    {".vtp", makeVtpSink, true, true, false},
    {".3mf", makeThreeMfSink, false, false, false, makeThreeMfCollection}};

}  // namespace

std::vector<MeshFormatInfo> meshFormats() {
  std::vector<MeshFormatInfo> formats;
  for (const MeshFormat& format : kMeshFormats)
    formats.push_back({format.extension, format.has_values, format.has_zlib, format.has_meshopt});
  return formats;
}

std::string shiftText(const glm::dvec3& shift) {
  std::string text;
  for (int axis = 0; axis < 3; ++axis) {
    char digits[352];
    text.append(axis == 0 ? "" : " ")
        .append(digits,
                std::to_chars(digits, digits + sizeof digits, shift[axis], std::chars_format::fixed)
                    .ptr);
  }
  return text;
}

const MeshFormat& meshFormatOf(const std::string& path, const MeshFileOptions& options) {
  const std::string end = lowerExtension(path);
  for (const MeshFormat& format : kMeshFormats) {
    if (end != format.extension) continue;
    if ((options.values != nullptr || options.components) && !format.has_values)
      throw Error("'" + path + "': a mesh as " + end +
                      " has no attribute of its vertices; write .ply, .glb or .vtp",
                  {.path = path});
    if (options.zlib && !format.has_zlib)
      throw Error("'" + path + "': only a mesh as .vtp can be packed with zlib; write .vtp",
                  {.path = path});
    if (options.meshopt && !format.has_meshopt)
      throw Error("'" + path + "': only a mesh as .glb can be packed with meshopt; write .glb",
                  {.path = path});
    return format;
  }
  throw Error(
      "cannot tell the mesh format of '" + path + "'; name it .ply, .stl, .obj, .glb, .vtp or .3mf",
      {.path = path});
}

std::unique_ptr<MeshFileSink> makeMeshFileSink(const std::string& path,
                                               const MeshFileOptions& options) {
  auto sink = meshFormatOf(path, options).make(path, options);
  if (options.placement == MeshPlacement()) return sink;
  return placedSink(std::move(sink), options.placement);
}

}  // namespace isobrick
