// A .glb of several surfaces, put together from one of each.
#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/extract/color_map.h"
#include "isobrick/extract/sinks/gltf_text.h"
#include "isobrick/extract/sinks/mesh_collection.h"
#include "isobrick/extract/sinks/mesh_formats.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_io.h"

namespace isobrick {
namespace {

using GltfJson = nlohmann::ordered_json;

// A whole .glb of one surface, which has no name any more.
class GlbPart {
 public:
  explicit GlbPart(const std::string& path) : file_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
    ::unlink(path.c_str());
    std::uint32_t head[5] = {};
    read(path, 0, head, sizeof head);
    std::string text(head[3], '\0');
    read(path, sizeof head, text.data(), text.size());
    json = GltfJson::parse(text);
    data_at = glbHeaderBytes(head[3]);
    data_bytes = head[2] > data_at ? head[2] - data_at : 0;
  }

  void read(const std::string& path, std::uint64_t at, void* out, std::size_t bytes) const {
    const IoResult result = readBytesAt(file_.get(), at, out, bytes);
    if (result.bytes < bytes)
      throw ResumableError(
          "cannot read '" + path + "' " + ioFailureText(at, result) + "; check the disk",
          {.path = path, .offset = at});
  }

  GltfJson json;
  std::uint64_t data_at = 0, data_bytes = 0;  // the chunk of data

 private:
  OpenDescriptor file_;
};

// The JSON of all parts, whose numbers count on from part to part.
class JoinedGltf {
 public:
  void add(GltfJson part, const MeshObject& object, std::uint64_t data_at) {
    if (json_.is_null()) {
      json_["asset"] = part["asset"];
      json_["scene"] = 0;
      json_["scenes"] = GltfJson::array({GltfJson::object()});
      for (const char* name : {"extensionsUsed", "extensionsRequired"})
        if (part.contains(name)) json_[name] = part[name];
    }
    if (!part.contains("meshes")) return;
    if (!json_["scenes"][0].contains("nodes")) {
      json_["scenes"][0]["nodes"] = GltfJson::array();
      // The first is of the data, the others are those that readers unpack it to.
      json_["buffers"].push_back({{"byteLength", 0}});
    }
    const std::size_t accessors = json_["accessors"].size(), views = json_["bufferViews"].size(),
                      buffers = json_["buffers"].size() - 1, materials = json_["materials"].size();
    for (GltfJson& view : part["bufferViews"]) {
      GltfJson& of_data =
          view.contains("extensions") ? view["extensions"]["EXT_meshopt_compression"] : view;
      move(of_data["byteOffset"], data_at);
      if (view["buffer"] != 0) move(view["buffer"], buffers);
    }
    for (GltfJson& accessor : part["accessors"]) move(accessor["bufferView"], views);
    for (GltfJson& primitive : part["meshes"][0]["primitives"]) {
      for (GltfJson& attribute : primitive["attributes"]) move(attribute, accessors);
      move(primitive["indices"], accessors);
      move(primitive["material"], materials);
    }
    for (GltfJson& material : part["materials"]) {
      const bool is_cap = material.value("name", "") == "cap";
      material["name"] = is_cap ? object.name + " cap" : object.name;
      if (object.color && !is_cap)
        // glTF computes with linear light.
        material["pbrMetallicRoughness"]["baseColorFactor"] = {linearFromSrgb(object.color->r),
                                                               linearFromSrgb(object.color->g),
                                                               linearFromSrgb(object.color->b), 1};
    }
    part["buffers"].erase(std::size_t{0});
    const std::size_t number = json_["nodes"].size();
    json_["scenes"][0]["nodes"].push_back(number);
    part["nodes"][0]["mesh"] = number;
    part["nodes"][0]["name"] = part["meshes"][0]["name"] = object.name;
    for (const char* name : {"nodes", "meshes", "materials", "accessors", "bufferViews", "buffers"})
      for (GltfJson& element : part[name]) json_[name].push_back(std::move(element));
  }

  std::string text(std::uint64_t data_bytes) {
    if (json_.contains("buffers")) json_["buffers"][0]["byteLength"] = data_bytes;
    std::string text = json_.dump();
    text.resize((text.size() + 3) & ~std::size_t{3}, ' ');
    return text;
  }

 private:
  static void move(GltfJson& number, std::uint64_t by) {
    number = number.get<std::uint64_t>() + by;
  }
  GltfJson json_;
};

class GlbCollection : public MeshCollection {
 public:
  GlbCollection(const std::string& path, const MeshFileOptions& options)
      : options_(options), file_(path) {}
  ~GlbCollection() override {
    for (std::size_t i = 0; i < objects_.size(); ++i) ::unlink(partPath(i).c_str());
  }

  std::unique_ptr<MeshFileSink> add(const MeshObject& object) override {
    objects_.push_back(object);
    return makeGlbSink(partPath(objects_.size() - 1), options_);
  }

  void finish() override {
    std::vector<GlbPart> parts;
    JoinedGltf gltf;
    std::uint64_t bytes = 0;
    for (std::size_t i = 0; i < objects_.size(); ++i) {
      parts.emplace_back(partPath(i));
      gltf.add(parts.back().json, objects_[i], bytes);
      bytes += parts.back().data_bytes;
    }
    const std::string json = gltf.text(bytes);
    if (glbHeaderBytes(json.size()) + bytes > kMostGlbBytes)
      throw glbTooLarge(file_.path(), !options_.meshopt);
    const std::string header = glbHeader(json, json.size(), bytes);
    file_.write(header.data(), header.size());
    std::vector<std::byte> buffer(std::size_t{1} << 20);
    for (const GlbPart& part : parts)
      for (std::uint64_t at = 0; at < part.data_bytes; at += buffer.size()) {
        if (options_.cancel != nullptr) options_.cancel->check();
        const auto step =
            static_cast<std::size_t>(std::min<std::uint64_t>(part.data_bytes - at, buffer.size()));
        part.read(file_.path(), part.data_at + at, buffer.data(), step);
        file_.write(buffer.data(), step);
      }
    file_.commit(options_.cancel);
  }

 private:
  // No user's file has such a name.
  std::string partPath(std::size_t object) const {
    return file_.temporaryPath() + "." + std::to_string(object);
  }

  const MeshFileOptions options_;
  AtomicFile file_;
  std::vector<MeshObject> objects_;
};

}  // namespace

std::unique_ptr<MeshCollection> makeGlbCollection(const std::string& path,
                                                  const MeshFileOptions& options) {
  return std::make_unique<GlbCollection>(path, options);
}

}  // namespace isobrick
