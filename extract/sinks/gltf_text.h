// The common part of both kinds of binary glTF. Private to extract/sinks/.
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <string>
#include <string_view>

#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "isobrick/extract/sinks/triangle_sink.h"
#include "isobrick/storage/error.h"

namespace isobrick {

// Puts parts of a text together.
template <typename... Parts>
std::string joined(const Parts&... parts) {
  std::string text;
  (text.append(parts), ...);
  return text;
}

// "[1,0.5,-3e+20]", with digits that read back as the same numbers.
std::string arrayText(const glm::dvec3& v);

// The middle of the volume, exact as a float too, since many readers convert it to one.
glm::dvec3 gltfCenter(const MeshFrame& frame);

// The name that an attribute has there: "_VALUE".
std::string gltfAttribute(const std::string& name);

// A colour (sRGB) as COLOR_0 has it: linear light, normalised, opaque.
using GltfColor = std::array<std::uint16_t, 4>;
GltfColor gltfColor(const glm::vec3& srgb);

// "asset":{...}
std::string gltfAsset(const MeshFrame& frame);
// The rest of "scenes":[ and "nodes":[...] of one mesh that was moved by -center.
std::string gltfNode(const glm::dvec3& center);
// "materials":[...]: that of the surface and, if there are any, that of caps.
inline std::string_view gltfMaterials(const MeshFrame& frame) {
  if (frame.has_caps)
    return R"("materials":[{"name":"surface","doubleSided":true,"pbrMetallicRoughness":)"
           R"({"metallicFactor":0,"roughnessFactor":0.8}},)"
           R"({"name":"cap","doubleSided":true,"pbrMetallicRoughness":)"
           R"({"baseColorFactor":[0.8,0.45,0.3,1],"metallicFactor":0,"roughnessFactor":0.8}}])";
  return R"("materials":[{"doubleSided":true,"pbrMetallicRoughness":)"
         R"({"metallicFactor":0,"roughnessFactor":0.8}}])";
}

// All that comes before the bytes of the chunk of data: the JSON is filled up with spaces to
// `json_bytes`, a multiple of 4. Without data that chunk is left out: no buffer may be empty.
std::string glbHeader(const std::string& json, std::size_t json_bytes, std::uint64_t bin_bytes);
// Its length, if there is data.
constexpr std::uint64_t glbHeaderBytes(std::uint64_t json_bytes) { return 12 + 8 + json_bytes + 8; }

// `can_pack`: --meshopt is a way out too.
Error glbTooLarge(const std::string& path, bool can_pack);

}  // namespace isobrick
