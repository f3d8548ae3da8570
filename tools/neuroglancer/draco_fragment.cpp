#include "tools/neuroglancer/draco_fragment.h"

#include <draco/compression/encode.h>
#include <draco/mesh/mesh.h>

#include <stdexcept>

namespace isobrick {

std::vector<char> packFragment(std::span<const glm::ivec3> positions,
                               std::span<const std::uint32_t> triangles) {
  draco::Mesh mesh;
  mesh.set_num_points(static_cast<std::uint32_t>(positions.size()));
  draco::GeometryAttribute about;
  about.Init(draco::GeometryAttribute::POSITION, nullptr, 3, draco::DT_INT32, false,
             sizeof(glm::ivec3), 0);
  const int id = mesh.AddAttribute(about, true, static_cast<std::uint32_t>(positions.size()));
  for (std::uint32_t i = 0; i < positions.size(); ++i)
    mesh.attribute(id)->SetAttributeValue(draco::AttributeValueIndex(i), &positions[i]);
  mesh.SetNumFaces(triangles.size() / 3);
  for (std::uint32_t i = 0; i < triangles.size() / 3; ++i) {
    const auto corner = [&](std::uint32_t c) { return draco::PointIndex(triangles[3 * i + c]); };
    mesh.SetFace(draco::FaceIndex(i), {{corner(0), corner(1), corner(2)}});
  }
  draco::Encoder encoder;
  constexpr int kSpeed = 5;  // 0: slowest and smallest, 10: fastest
  encoder.SetSpeedOptions(kSpeed, kSpeed);
  draco::EncoderBuffer packed;
  const draco::Status status = encoder.EncodeMeshToBuffer(mesh, &packed);
  if (!status.ok())
    throw std::runtime_error("Draco cannot pack a mesh: " + status.error_msg_string());
  return {packed.data(), packed.data() + packed.size()};
}

}  // namespace isobrick
