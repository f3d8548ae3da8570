#include "tools/neuroglancer/neuroglancer_info.h"

#include <fstream>
#include <iterator>

#include "isobrick/preprocess/shallow_json.h"
#include "isobrick/storage/file_system.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

constexpr std::uintmax_t kMostInfoBytes = std::uintmax_t{16} << 20;

}  // namespace

std::string neuroglancerTypeOf(const std::string& folder) {
  const fs::path path = fs::path(folder) / "info";
  if (!isRegularFile(path) || fileBytes(path) > kMostInfoBytes) return "";
  std::ifstream in(path, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  return textOf(member(parseShallowJson(text), "@type"));
}

std::vector<std::string> neuroglancerLosses(const GridGeometry& geometry) {
  std::vector<std::string> lost;
  if (geometry.direction != glm::dmat3(1.0) || geometry.origin != glm::dvec3(0.0))
    lost.push_back(
        "Neuroglancer's format has no origin and no direction; they are kept in the member "
        "'isobrick' of its file info, which other programs ignore");
  if (geometry.unit != LengthUnit::kMillimetre)
    lost.push_back("the volume does not say its unit of length; Neuroglancer takes millimetres");
  return lost;
}

nlohmann::ordered_json placeInWorld(const GridGeometry& geometry) {
  const auto listOf = [](const glm::dvec3& v) { return nlohmann::ordered_json{v.x, v.y, v.z}; };
  nlohmann::ordered_json columns = nlohmann::ordered_json::array();
  for (int axis = 0; axis < 3; ++axis)
    columns.push_back(listOf(glm::dvec3(geometry.direction[axis])));
  return {{"space", "LPS"}, {"origin", listOf(geometry.origin)}, {"direction", columns}};
}

}  // namespace isobrick
