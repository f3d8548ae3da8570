#include "tests/support/ply_reader.h"

#include <bit>
#include <cstring>
#include <fstream>
#include <map>
#include <sstream>
#include <string>

#include "isobrick/storage/error.h"

namespace isobrick::test {

namespace {

static_assert(std::endian::native == std::endian::little);

enum class Scalar { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat, kDouble };

struct Property {
  std::string name;
  Scalar type = Scalar::kFloat;
  bool is_list = false;
  Scalar count_type = Scalar::kUint8;  // of a list
};

struct Element {
  std::string name;
  std::uint64_t count = 0;
  std::vector<Property> properties;
};

class PlyFile {
 public:
  explicit PlyFile(const std::filesystem::path& path) : path_(path), in_(path, std::ios::binary) {
    if (!in_) fail("cannot be opened");
    buffer_.resize(std::size_t{1} << 20);
  }

  PlyMesh read() {
    readHeader();
    PlyMesh mesh;
    for (const Element& element : elements_) {
      if (element.name == "vertex") {
        readVertices(element, mesh);
      } else if (element.name == "face") {
        readFaces(element, mesh);
      } else {
        for (std::uint64_t i = 0; i < element.count; ++i) {
          for (const Property& property : element.properties) skip(property);
        }
      }
    }
    if (used_ != filled_ || in_.peek() != std::ifstream::traits_type::eof()) {
      fail("has bytes after its last element");
    }
    return mesh;
  }

 private:
  [[noreturn]] void fail(const std::string& what) const {
    throw Error(path_.string() + ": PLY file " + what);
  }

  Scalar scalarNamed(const std::string& name) const {
    static const std::map<std::string, Scalar> kNames = {
        {"char", Scalar::kInt8},      {"int8", Scalar::kInt8},     {"uchar", Scalar::kUint8},
        {"uint8", Scalar::kUint8},    {"short", Scalar::kInt16},   {"int16", Scalar::kInt16},
        {"ushort", Scalar::kUint16},  {"uint16", Scalar::kUint16}, {"int", Scalar::kInt32},
        {"int32", Scalar::kInt32},    {"uint", Scalar::kUint32},   {"uint32", Scalar::kUint32},
        {"float", Scalar::kFloat},    {"float32", Scalar::kFloat}, {"double", Scalar::kDouble},
        {"float64", Scalar::kDouble},
    };
    const auto found = kNames.find(name);
    if (found == kNames.end()) fail("has a property of the unknown type '" + name + "'");
    return found->second;
  }

  void readHeader() {
    std::string line;
    if (!std::getline(in_, line) || line != "ply") fail("does not begin with 'ply'");
    bool has_format = false;
    while (std::getline(in_, line) && line != "end_header") {
      std::istringstream words(line);
      std::string word;
      words >> word;
      if (word == "format") {
        words >> word;
        if (word != "binary_little_endian") fail("is not binary little-endian");
        has_format = true;
      } else if (word == "element") {
        Element element;
        if (!(words >> element.name >> element.count)) fail("has a bad line '" + line + "'");
        elements_.push_back(element);
      } else if (word == "property") {
        if (elements_.empty()) fail("has a property before any element");
        Property property;
        words >> word;
        if (word == "list") {
          property.is_list = true;
          words >> word;
          property.count_type = scalarNamed(word);
          words >> word;
        }
        property.type = scalarNamed(word);
        if (!(words >> property.name)) fail("has a bad line '" + line + "'");
        elements_.back().properties.push_back(property);
      } else if (word != "comment" && word != "obj_info") {
        fail("has the unknown header line '" + line + "'");
      }
    }
    if (!in_ || !has_format) fail("has no complete header");
  }

  // ---- Binary part

  void readBytes(void* to, std::size_t size) {
    if (filled_ - used_ < size) {
      std::memmove(buffer_.data(), buffer_.data() + used_, filled_ - used_);
      filled_ -= used_;
      used_ = 0;
      in_.read(buffer_.data() + filled_, static_cast<std::streamsize>(buffer_.size() - filled_));
      filled_ += static_cast<std::size_t>(in_.gcount());
      if (filled_ < size) fail("is truncated");
    }
    std::memcpy(to, buffer_.data() + used_, size);
    used_ += size;
  }

  template <typename T>
  double readAs() {
    T value;
    readBytes(&value, sizeof(T));
    return static_cast<double>(value);
  }

  // Every scalar type of PLY fits a double.
  double readScalar(Scalar type) {
    switch (type) {
      case Scalar::kInt8:
        return readAs<std::int8_t>();
      case Scalar::kUint8:
        return readAs<std::uint8_t>();
      case Scalar::kInt16:
        return readAs<std::int16_t>();
      case Scalar::kUint16:
        return readAs<std::uint16_t>();
      case Scalar::kInt32:
        return readAs<std::int32_t>();
      case Scalar::kUint32:
        return readAs<std::uint32_t>();
      case Scalar::kFloat:
        return readAs<float>();
      case Scalar::kDouble:
        return readAs<double>();
    }
    fail("has a property of an unknown type");
  }

  void skip(const Property& property) {
    const double count = property.is_list ? readScalar(property.count_type) : 1;
    for (double i = 0; i < count; ++i) readScalar(property.type);
  }

  void readVertices(const Element& element, PlyMesh& mesh) {
    static const std::map<std::string, int> kPlaces = {{"x", 0},  {"y", 1},  {"z", 2},
                                                       {"nx", 3}, {"ny", 4}, {"nz", 5}};
    std::vector<int> places;
    unsigned present = 0;
    for (const Property& property : element.properties) {
      const auto found = kPlaces.find(property.name);
      const bool is_known = found != kPlaces.end() && !property.is_list;
      places.push_back(is_known ? found->second : -1);
      if (is_known) present |= 1u << found->second;
    }
    if ((present & 7u) != 7u) fail("has vertices without x, y and z");
    const bool has_normals = present == 63u;
    for (std::uint64_t i = 0; i < element.count; ++i) {
      double values[6] = {};
      for (std::size_t p = 0; p < places.size(); ++p) {
        if (places[p] < 0) {
          skip(element.properties[p]);
        } else {
          values[places[p]] = readScalar(element.properties[p].type);
        }
      }
      mesh.positions.emplace_back(values[0], values[1], values[2]);
      if (has_normals) mesh.normals.emplace_back(values[3], values[4], values[5]);
    }
  }

  void readFaces(const Element& element, PlyMesh& mesh) {
    std::size_t index_property = element.properties.size();
    for (std::size_t p = 0; p < element.properties.size(); ++p) {
      const Property& property = element.properties[p];
      const bool is_named = property.name == "vertex_indices" || property.name == "vertex_index";
      if (is_named && property.is_list) index_property = p;
    }
    if (index_property == element.properties.size()) fail("has faces without vertex_indices");
    for (std::uint64_t i = 0; i < element.count; ++i) {
      for (std::size_t p = 0; p < element.properties.size(); ++p) {
        const Property& property = element.properties[p];
        if (p != index_property) {
          skip(property);
          continue;
        }
        if (readScalar(property.count_type) != 3) {
          fail("has a face that is no triangle (face " + std::to_string(i) + ")");
        }
        for (int corner = 0; corner < 3; ++corner) {
          const double index = readScalar(property.type);
          if (!(index >= 0 && index <= 4294967295.0)) {
            fail("has a bad vertex index in face " + std::to_string(i));
          }
          mesh.triangles.push_back(static_cast<std::uint32_t>(index));
        }
      }
    }
  }

  const std::filesystem::path path_;
  std::ifstream in_;
  std::vector<Element> elements_;
  std::vector<char> buffer_;
  std::size_t used_ = 0, filled_ = 0;  // the bytes used_ .. filled_ of buffer_ are unread
};

}  // namespace

PlyMesh readPly(const std::filesystem::path& path) { return PlyFile(path).read(); }

}  // namespace isobrick::test
