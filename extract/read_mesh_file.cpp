#include "isobrick/extract/read_mesh_file.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <map>
#include <sstream>
#include <string_view>

#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

class MeshFile {
 public:
  explicit MeshFile(const std::string& path)
      : path_(path), in_(path, std::ios::binary), left_(in_ ? fileBytes(path) : 0) {
    if (!in_) fail("it cannot be opened");
  }

  [[noreturn]] void fail(const std::string& why) const {
    throw Error("cannot read the mesh '" + path_ + "': " + why, {.path = path_});
  }
  std::string line() {
    std::string text;
    if (!std::getline(in_, text)) fail("it ends in its header");
    left_ -= std::min<std::uint64_t>(left_, text.size() + 1);
    if (text.ends_with('\r')) text.pop_back();
    return text;
  }
  template <typename T>
  T next() {
    T value;
    in_.read(reinterpret_cast<char*>(&value), sizeof value);
    if (!in_) fail("it is shorter than it says");
    return value;
  }
  double nextWord() {
    double value = 0;
    if (!(in_ >> value)) fail("a number is missing, or is none");
    return value;
  }
  void skip(std::streamsize bytes) {
    if (in_.ignore(bytes).gcount() != bytes) fail("it is shorter than it says");
  }
  // A hostile count asks for no memory: an element has at least `bytes`.
  std::uint64_t counted(std::uint64_t count, std::uint64_t bytes) const {
    if (count > left_ / bytes || count >= std::numeric_limits<std::uint32_t>::max())
      fail("it is too short for what it says to hold, or holds too much");
    return count;
  }

 private:
  const std::string path_;
  std::ifstream in_;
  std::uint64_t left_;  // bytes, when the header ended
};

class PlyMeshReader {
 public:
  explicit PlyMeshReader(MeshFile& file) : file_(file) { readHeader(); }

  IndexedMesh read() {
    for (const Element& element : elements_)
      for (std::uint64_t i =
               file_.counted(element.count, std::max<std::uint64_t>(1, element.properties.size()));
           i-- > 0;)
        readItem(element);
    for (const std::uint32_t corner : mesh_.triangles)
      if (corner >= mesh_.positions.size()) file_.fail("a face has a vertex that is not there");
    return std::move(mesh_);
  }

 private:
  using Read = double (PlyMeshReader::*)();
  struct Property {
    std::string name;
    Read read = nullptr;
    Read read_count = nullptr;  // of a list
  };
  struct Element {
    std::string name;
    std::uint64_t count = 0;
    std::vector<Property> properties;
  };

  template <typename T>
  double binary() {
    return static_cast<double>(file_.next<T>());
  }
  double word() { return file_.nextWord(); }

  Read typeNamed(const std::string& name) const {
    static const std::map<std::string_view, Read> kTypes = {
        {"char", &PlyMeshReader::binary<std::int8_t>},
        {"int8", &PlyMeshReader::binary<std::int8_t>},
        {"uchar", &PlyMeshReader::binary<std::uint8_t>},
        {"uint8", &PlyMeshReader::binary<std::uint8_t>},
        {"short", &PlyMeshReader::binary<std::int16_t>},
        {"int16", &PlyMeshReader::binary<std::int16_t>},
        {"ushort", &PlyMeshReader::binary<std::uint16_t>},
        {"uint16", &PlyMeshReader::binary<std::uint16_t>},
        {"int", &PlyMeshReader::binary<std::int32_t>},
        {"int32", &PlyMeshReader::binary<std::int32_t>},
        {"uint", &PlyMeshReader::binary<std::uint32_t>},
        {"uint32", &PlyMeshReader::binary<std::uint32_t>},
        {"float", &PlyMeshReader::binary<float>},
        {"float32", &PlyMeshReader::binary<float>},
        {"double", &PlyMeshReader::binary<double>},
        {"float64", &PlyMeshReader::binary<double>}};
    const auto found = kTypes.find(name);
    if (found == kTypes.end()) file_.fail("its header has a property of an unknown type");
    return is_text_ ? &PlyMeshReader::word : found->second;
  }

  void readHeader() {
    if (file_.line() != "ply") file_.fail("it does not begin with 'ply'");
    for (std::string text = file_.line(); text != "end_header"; text = file_.line()) {
      std::istringstream words(text);
      std::string word, type;
      words >> word >> type;
      if (word == "format") {
        is_text_ = type == "ascii";
        if (!is_text_ && type != "binary_little_endian")
          file_.fail("it is of the format " + type + "; write it as binary little-endian");
      } else if (word == "element") {
        elements_.push_back({type, 0, {}});
        words >> elements_.back().count;
      } else if (word == "property") {
        if (elements_.empty()) file_.fail("its header has a property of no element");
        Property property;
        if (type == "list") {
          words >> type;
          property.read_count = typeNamed(type);
          words >> type;
        }
        property.read = typeNamed(type);
        words >> property.name;
        elements_.back().properties.push_back(property);
      }
    }
  }

  void readItem(const Element& element) {
    glm::dvec3 position(0.0);
    for (const Property& property : element.properties) {
      if (property.read_count != nullptr) {
        const auto count =
            static_cast<std::uint64_t>(std::max(0.0, (this->*property.read_count)()));
        const bool is_face = element.name == "face" && property.name.starts_with("vertex_ind");
        std::uint32_t first = 0, before = 0;
        for (std::uint64_t i = 0; i < count; ++i) {
          const double number = (this->*property.read)();
          if (!is_face) continue;
          if (!(number >= 0 && number < std::numeric_limits<std::uint32_t>::max()))
            file_.fail("a face has a vertex that is not there");
          const auto corner = static_cast<std::uint32_t>(number);
          if (i == 0) first = corner;
          if (i >= 2) mesh_.triangles.insert(mesh_.triangles.end(), {first, before, corner});
          before = corner;
        }
      } else {
        const double value = (this->*property.read)();
        for (int axis = 0; axis < 3; ++axis)
          if (property.name == std::string_view("xyz").substr(static_cast<std::size_t>(axis), 1))
            position[axis] = value;
      }
    }
    if (element.name == "vertex") mesh_.positions.push_back(position);
  }

  MeshFile& file_;
  bool is_text_ = false;
  std::vector<Element> elements_;
  IndexedMesh mesh_;
};

IndexedMesh readStl(MeshFile& file) {
  constexpr std::streamsize kHeaderBytes = 80;
  constexpr std::uint64_t kTriangleBytes = 50;
  file.skip(kHeaderBytes);
  IndexedMesh mesh;
  std::map<std::array<float, 3>, std::uint32_t> numbers;
  for (std::uint64_t t = file.counted(file.next<std::uint32_t>(), kTriangleBytes); t-- > 0;) {
    file.skip(3 * sizeof(float));  // its normal
    for (int corner = 0; corner < 3; ++corner) {
      const auto place = file.next<std::array<float, 3>>();
      const auto [at, is_new] =
          numbers.emplace(place, static_cast<std::uint32_t>(mesh.positions.size()));
      if (is_new) mesh.positions.emplace_back(place[0], place[1], place[2]);
      mesh.triangles.push_back(at->second);
    }
    file.skip(sizeof(std::uint16_t));
  }
  return mesh;
}

}  // namespace

IndexedMesh readMeshFile(const std::string& path) {
  MeshFile file(path);
  const std::string end = lowerExtension(path);
  if (end != ".ply" && end != ".stl")
    file.fail("only .ply and .stl are read; write it as one of these");
  IndexedMesh mesh = end == ".ply" ? PlyMeshReader(file).read() : readStl(file);
  for (const glm::dvec3& position : mesh.positions)
    if (!std::isfinite(position.x + position.y + position.z))
      file.fail("a vertex has no finite place");
  return mesh;
}

}  // namespace isobrick
