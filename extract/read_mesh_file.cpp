#include "isobrick/extract/read_mesh_file.h"

#include <array>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <limits>
#include <map>
#include <sstream>
#include <string_view>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

constexpr double kNothingRead = std::numeric_limits<double>::quiet_NaN();

// Reads the next number of a file; NaN if there is none.
using NumberReader = double (*)(std::istream& in);

template <typename T>
double binaryNumber(std::istream& in) {
  T number;
  return in.read(reinterpret_cast<char*>(&number), sizeof number) ? static_cast<double>(number)
                                                                  : kNothingRead;
}
double textNumber(std::istream& in) {
  double number = 0;
  return in >> number ? number : kNothingRead;
}

NumberReader readerOf(const std::string& type) {
  static const std::map<std::string_view, NumberReader> kTypes = {
      {"char", binaryNumber<std::int8_t>},     {"int8", binaryNumber<std::int8_t>},
      {"uchar", binaryNumber<std::uint8_t>},   {"uint8", binaryNumber<std::uint8_t>},
      {"short", binaryNumber<std::int16_t>},   {"int16", binaryNumber<std::int16_t>},
      {"ushort", binaryNumber<std::uint16_t>}, {"uint16", binaryNumber<std::uint16_t>},
      {"int", binaryNumber<std::int32_t>},     {"int32", binaryNumber<std::int32_t>},
      {"uint", binaryNumber<std::uint32_t>},   {"uint32", binaryNumber<std::uint32_t>},
      {"float", binaryNumber<float>},          {"float32", binaryNumber<float>},
      {"double", binaryNumber<double>},        {"float64", binaryNumber<double>}};
  const auto found = kTypes.find(type);
  if (found == kTypes.end()) throw Error("its header has a property of an unknown type");
  return found->second;
}

struct PlyProperty {
  std::string name;
  NumberReader read = nullptr, read_count = nullptr;  // the second of lists
};
struct PlyElement {
  std::string name;
  std::uint64_t count = 0;
  std::vector<PlyProperty> properties;
};

std::vector<PlyElement> readPlyHeader(std::istream& in) {
  std::vector<PlyElement> elements;
  bool is_text = false;
  std::string line;
  while (std::getline(in, line)) {
    std::istringstream words(line);
    std::string word, type;
    words >> word >> type;
    const auto reader = [&] {
      const NumberReader binary = readerOf(type);
      return is_text ? textNumber : binary;
    };
    if (word == "end_header") return elements;
    if (word == "format") {
      is_text = type == "ascii";
      if (!is_text && type != "binary_little_endian")
        throw Error("it is of the format " + type + "; write it as binary little-endian");
    } else if (word == "element") {
      elements.push_back({type, 0, {}});
      words >> elements.back().count;
    } else if (word == "property" && !elements.empty()) {
      PlyProperty& property = elements.back().properties.emplace_back();
      if (type == "list") {
        words >> type;
        property.read_count = reader();
        words >> type;
      }
      property.read = reader();
      words >> property.name;
    }
  }
  throw Error("it ends in its header");
}

IndexedMesh readPly(std::istream& in) {
  IndexedMesh mesh;
  for (const PlyElement& element : readPlyHeader(in))
    // A hostile count asks for no memory, and ends with the file.
    for (std::uint64_t i = 0; in && !element.properties.empty() && i < element.count; ++i) {
      glm::dvec3 position(0.0);
      for (const PlyProperty& property : element.properties) {
        const double count = property.read_count != nullptr ? property.read_count(in) : 1;
        std::uint32_t first = 0, before = 0;
        for (double n = 0; n < count && in; ++n) {
          const double number = property.read(in);
          if (property.name.size() == 1 && property.name >= "x" && property.name <= "z")
            position[property.name[0] - 'x'] = number;
          if (element.name != "face" || !property.name.starts_with("vertex_ind")) continue;
          if (!(number >= 0 && number < static_cast<double>(mesh.positions.size())))
            throw Error("a face has a vertex that is not there");
          const auto corner = static_cast<std::uint32_t>(number);
          if (n == 0) first = corner;
          if (n >= 2) mesh.triangles.insert(mesh.triangles.end(), {first, before, corner});
          before = corner;
        }
      }
      if (element.name == "vertex") mesh.positions.push_back(position);
    }
  return mesh;
}

IndexedMesh readStl(std::istream& in) {
  constexpr std::streamsize kHeaderBytes = 80;
  in.ignore(kHeaderBytes);
  IndexedMesh mesh;
  std::map<std::array<float, 3>, std::uint32_t> numbers;
  const double count = binaryNumber<std::uint32_t>(in);
  for (double t = 0; t < count && in; ++t) {
    in.ignore(3 * sizeof(float));  // its normal
    std::array<std::array<float, 3>, 3> corners{};
    in.read(reinterpret_cast<char*>(&corners), sizeof corners);
    binaryNumber<std::uint16_t>(in);
    for (const std::array<float, 3>& place : corners) {
      const auto [at, is_new] =
          numbers.emplace(place, static_cast<std::uint32_t>(mesh.positions.size()));
      if (is_new) mesh.positions.emplace_back(place[0], place[1], place[2]);
      mesh.triangles.push_back(at->second);
    }
  }
  return mesh;
}

}  // namespace

IndexedMesh readMeshFile(const std::string& path) try {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw Error("it cannot be opened");
  const std::string end = lowerExtension(path);
  if (end != ".ply" && end != ".stl")
    throw Error("only .ply and .stl are read; write it as one of these");
  IndexedMesh mesh = end == ".ply" ? readPly(in) : readStl(in);
  if (!in) throw Error("it is shorter than it says, or has a word where a number is wanted");
  if (mesh.positions.size() >= std::numeric_limits<std::uint32_t>::max())
    throw Error("it has more than 4,294,967,294 vertices");
  for (const glm::dvec3& position : mesh.positions)
    if (!std::isfinite(position.x + position.y + position.z))
      throw Error("a vertex has no finite place");
  return mesh;
} catch (const Error& error) {
  throw Error("cannot read the mesh '" + path + "': " + error.what(), {.path = path});
}

}  // namespace isobrick
