#include "isobrick/extract/sinks/gltf_text.h"

#include <charconv>
#include <cmath>

#include "isobrick/extract/sinks/mesh_formats.h"
#include "isobrick/extract/sinks/mesh_placement.h"

namespace isobrick {
namespace {

std::string numberText(double number) {
  char digits[32];
  return {digits, std::to_chars(digits, digits + sizeof digits, number).ptr};
}

// The nearest number that a float holds. It does not convert there and back, as GCC 12 drops that
// in vectorised code.
double roundToSingle(double number) {
  int exponent = 0;
  const double fraction = std::frexp(number, &exponent);
  return std::ldexp(std::round(std::ldexp(fraction, 24)), exponent - 24);
}

}  // namespace

std::string arrayText(const glm::dvec3& v) {
  return joined("[", numberText(v.x), ",", numberText(v.y), ",", numberText(v.z), "]");
}

glm::dvec3 gltfCenter(const MeshFrame& frame) {
  glm::dvec3 center = frame.geometry.indexToWorld(glm::dvec3(frame.voxels - Index3(1)) / 2.0);
  for (int axis = 0; axis < 3; ++axis) center[axis] = roundToSingle(center[axis]);
  return center;
}

std::string gltfAttribute(const std::string& name) {
  std::string capitals = "_" + name;
  for (char& c : capitals) c = c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
  return capitals;
}

GltfColor gltfColor(const glm::vec3& srgb) {
  const auto channel = [](float value) {
    return static_cast<std::uint16_t>(std::lround(65535.0f * linearFromSrgb(value)));
  };
  return {channel(srgb.r), channel(srgb.g), channel(srgb.b), 65535};
}

std::string gltfAsset(const MeshFrame& frame) {
  const glm::dvec3 shift = shiftOf(frame);
  const bool is_shifted = shift != glm::dvec3(0.0);
  return joined(R"("asset":{"version":"2.0","generator":"isobrick","extras":{"units":")",
                unitText(frame), R"(","space":")", spaceText(frame), "\"",
                is_shifted ? joined(R"(,"shift":)", arrayText(shift)) : "", "}}");
}

std::string gltfNode(const glm::dvec3& center) {
  const bool is_moved = center != glm::dvec3(0.0);
  return joined(R"({"nodes":[0]}],"nodes":[{"mesh":0)",
                is_moved ? joined(R"(,"translation":)", arrayText(center)) : "", "}]");
}

std::string glbHeader(const std::string& json, std::size_t json_bytes, std::uint64_t bin_bytes) {
  const bool has_data = bin_bytes > 0;
  std::string header(glbHeaderBytes(json_bytes) - (has_data ? 0 : 8), ' ');
  BytePointer to(reinterpret_cast<std::byte*>(header.data()));
  const auto bytes = [](std::uint64_t count) { return static_cast<std::uint32_t>(count); };
  to.put(std::uint32_t{0x46546C67}, std::uint32_t{2}, bytes(header.size() + bin_bytes));
  to.put(bytes(json_bytes), std::uint32_t{0x4E4F534A});
  header.replace(20, json.size(), json);
  if (has_data) {
    BytePointer bin(reinterpret_cast<std::byte*>(header.data()) + header.size() - 8);
    bin.put(bytes(bin_bytes), std::uint32_t{0x004E4942});
  }
  return header;
}

Error glbTooLarge(const std::string& path, bool can_pack) {
  return Error(
      "'" + path + "': a glTF binary file holds at most 4 GiB; " +
          "write .vtp or .ply instead, or extract a part of the surface or a coarser level",
      {.path = path}, can_pack ? std::vector{Remedy::kPackMesh} : std::vector<Remedy>{});
}

}  // namespace isobrick
