#include "isobrick/extract/sinks/mesh_file_sink.h"

#include <algorithm>
#include <charconv>
#include <iterator>
#include <set>
#include <string_view>
#include <utility>

#include "isobrick/extract/sinks/gltf_text.h"
#include "isobrick/extract/sinks/mesh_formats.h"
#include "isobrick/extract/sinks/mesh_placement.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

constexpr MeshFormat kMeshFormats[] = {
    {".ply", makePlySink, true, true, false, false},
    {".stl", makeStlSink, false, false, false, false},
    {".obj", makeObjSink, false, true, false, false},
    {".glb", makeGlbSink, true, true, false, true, makeGlbCollection},
    {".vtp", makeVtpSink, true, false, true, false},
    {".3mf", makeThreeMfSink, false, false, false, false, makeThreeMfCollection}};

void refuseAttributes(const std::string& path, const MeshFileOptions& options) {
  // Those that vertices have anyway; glTF has capitals.
  std::set<std::string> names = {"_X",  "_Y",   "_Z",     "_NX",   "_NY",
                                 "_NZ", "_RED", "_GREEN", "_BLUE", "_NORMALS"};
  for (const VertexAttribute& attribute : options.attributes) {
    const std::string& name = attribute.name;
    if (!isAttributeName(name) || !names.insert(gltfAttribute(name)).second)
      throw meshError(path,
                      "'" + name +
                          "' is no name for an attribute, or the name of another one; take another "
                          "name, of letters, digits and '_'");
  }
  if (!options.colors) return;
  const VertexColors& colors = *options.colors;
  if (colors.attribute >= options.attributes.size() || !(colors.low < colors.high))
    throw meshError(path,
                    "colours go by an attribute that the vertices have, from a value to "
                    "a greater one; correct them");
}

}  // namespace

bool isAttributeName(std::string_view name) {
  const auto isLetter = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_';
  };
  return !name.empty() && name.size() <= kMostAttributeName && isLetter(name.front()) &&
         std::ranges::all_of(name, [&](char c) { return isLetter(c) || (c >= '0' && c <= '9'); });
}

std::vector<MeshFormatInfo> meshFormats() {
  std::vector<MeshFormatInfo> formats;
  for (const MeshFormat& format : kMeshFormats)
    formats.push_back({format.extension, format.has_attributes, format.has_colors, format.has_zlib,
                       format.has_meshopt});
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
    if (options.colors && !format.has_colors)
      throw meshError(
          path, "a mesh as " + end + " has no colours of its vertices; write .ply, .glb or .obj");
    if (!options.attributes.empty() && !options.colors && !format.has_attributes)
      throw meshError(
          path, "a mesh as " + end + " has no attribute of its vertices; write .ply, .glb or .vtp");
    refuseAttributes(path, options);
    if (options.zlib && !format.has_zlib)
      throw meshError(path, "only a mesh as .vtp can be packed with zlib; write .vtp");
    if (options.meshopt && !format.has_meshopt)
      throw meshError(path, "only a mesh as .glb can be packed with meshopt; write .glb");
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
