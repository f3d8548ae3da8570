// Several surfaces in one file: each is what it is alone. 3MF is read by other programs in
// python/tests/test_3mf.py.
#include "isobrick/extract/sinks/mesh_collection.h"

#include <gtest/gtest.h>

#include <cstring>
#include <nlohmann/json.hpp>

#include "isobrick/extract/extractor.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/file_bytes.h"

namespace isobrick::test {
namespace {

using Json = nlohmann::json;

struct GlbFile {
  Json json;
  std::string data;

  explicit GlbFile(const std::string& bytes) {
    std::uint32_t head[5] = {};
    std::memcpy(head, bytes.data(), sizeof head);
    EXPECT_EQ(head[0], 0x46546C67u);
    EXPECT_EQ(head[2], bytes.size());
    json = Json::parse(bytes.substr(20, head[3]));
    if (bytes.size() > 28 + head[3]) data = bytes.substr(28 + head[3]);
    EXPECT_EQ(data.size() % 4, 0u);
  }
  // The bytes of a view, packed if they are.
  std::string bytesOf(std::size_t number) const {
    Json view = json["bufferViews"][number];
    if (view.contains("extensions")) {
      view = view["extensions"]["EXT_meshopt_compression"];
    }
    EXPECT_EQ(view["buffer"], 0);
    return data.substr(view["byteOffset"], view["byteLength"]);
  }
  // All that is drawn of a mesh, in words that do not depend on the numbers of accessors.
  std::string contents(const Json& mesh) const {
    std::string all;
    const auto add = [&](const Json& number) {
      Json accessor = json["accessors"][number.get<std::size_t>()];
      all += bytesOf(accessor["bufferView"]);
      accessor.erase("bufferView");
      all += accessor.dump();
    };
    for (const Json& primitive : mesh["primitives"]) {
      for (const auto& [name, number] : primitive["attributes"].items()) {
        all += name;
        add(number);
      }
      add(primitive["indices"]);
    }
    return all;
  }
};

class MeshCollectionTest : public ::testing::Test {
 protected:
  void extract(MeshFileSink& sink, double isovalue) const {
    Query query;
    query.isovalue = isovalue;
    extractIsosurface(*pyramid_, query, sink);
  }
  std::size_t filesLeft() const {
    const std::filesystem::directory_iterator files(folder_.path()), end;
    return static_cast<std::size_t>(std::distance(files, end));
  }

  const TemporaryFolder folder_;
  const std::shared_ptr<const Pyramid> pyramid_ = openField(
      folder_, Index3(60), [](const glm::dvec3& p) { return 25 - glm::length(p - 29.4); });
};

TEST_F(MeshCollectionTest, AGlbHasANodeForEachSurface) {
  const double isovalues[] = {0, 100, 6, 15};  // at 100 there is none
  for (const bool meshopt : {false, true}) {
    const MeshFileOptions options{.meshopt = meshopt};
    {
      const auto all = makeMeshCollection(folder_.file("all.glb"), options);
      std::vector<std::unique_ptr<MeshFileSink>> sinks;
      for (const double isovalue : isovalues) {
        MeshObject object{.name = "isovalue " + std::to_string(isovalue)};
        if (isovalue == 6) object.color = glm::vec3(1, 0.5f, 0);
        sinks.push_back(all->add(object));
      }
      for (const std::size_t i : {2u, 0u, 3u, 1u}) extract(*sinks[i], isovalues[i]);
      all->finish();
    }
    const GlbFile all(readBytes(folder_.file("all.glb")));
    ASSERT_EQ(all.json["nodes"].size(), 3u);
    EXPECT_EQ(all.json["scenes"][0]["nodes"], Json({0, 1, 2}));
    EXPECT_EQ(all.json["buffers"][0]["byteLength"], all.data.size());
    std::size_t number = 0, bytes = 0;
    for (const double isovalue : isovalues) {
      const auto alone = makeMeshFileSink(folder_.file("one.glb"), options);
      extract(*alone, isovalue);
      const GlbFile one(readBytes(folder_.file("one.glb")));
      if (isovalue == 100) continue;
      const Json& node = all.json["nodes"][number];
      EXPECT_EQ(node["name"], "isovalue " + std::to_string(isovalue));
      EXPECT_EQ(node["mesh"], number);
      if (meshopt) {
        EXPECT_EQ(node["translation"], one.json["nodes"][0]["translation"]);
      }
      const Json& mesh = all.json["meshes"][number];
      EXPECT_TRUE(all.contents(mesh) == one.contents(one.json["meshes"][0])) << isovalue;
      for (const Json& primitive : mesh["primitives"]) EXPECT_EQ(primitive["material"], number);
      const Json& material = all.json["materials"][number]["pbrMetallicRoughness"];
      EXPECT_EQ(material.contains("baseColorFactor"), isovalue == 6);
      if (isovalue == 6) {
        EXPECT_NEAR(material["baseColorFactor"][1].get<double>(), 0.2140, 1e-4);
      }
      bytes += one.data.size();
      ++number;
    }
    EXPECT_EQ(bytes, all.data.size());
    EXPECT_EQ(filesLeft(), 3u);
  }
}

// One mesh, in which each label is what it is alone.
TEST_F(MeshCollectionTest, LabelsOfOneMeshAreExact) {
  const std::uint64_t labels[] = {16777217, 3, 4294967295};
  const auto isovalueOf = [&](std::uint64_t label) {
    return label == 3 ? 6.0 : label == 16777217 ? 0.0 : 15.0;
  };
  const auto writeAll = [&](const std::string& path) {
    const auto all = makeLabelCollection(path);
    for (const std::uint64_t label : labels) {
      const auto sink = all->add({.name = "label " + std::to_string(label), .label = label});
      extract(*sink, isovalueOf(label));
    }
    all->finish();
  };
  const auto dataOf = [](const std::string& bytes) {
    return bytes.substr(bytes.find("end_header\n") + 11);
  };
  writeAll(folder_.file("all.ply"));
  const std::string all = readBytes(folder_.file("all.ply"));
  EXPECT_NE(all.find("property uint label\n"), std::string::npos);
  const std::string data = dataOf(all);
  constexpr std::size_t kVertex = 24, kFace = 14;
  std::string vertices, faces;  // as they are alone
  std::uint32_t first = 0;
  for (const std::uint64_t label : labels) {
    const auto alone = makeMeshFileSink(folder_.file("one.ply"));
    extract(*alone, isovalueOf(label));
    const std::string one = dataOf(readBytes(folder_.file("one.ply")));
    const std::size_t count = alone->vertices();
    const auto id = static_cast<std::uint32_t>(label);
    for (std::size_t v = 0; v < count; ++v)
      vertices += one.substr(kVertex * v, kVertex) +
                  std::string(reinterpret_cast<const char*>(&id), sizeof id);
    for (std::size_t at = kVertex * count; at < one.size(); at += kFace) {
      std::uint32_t corners[3];
      std::memcpy(corners, &one[at + 1], sizeof corners);
      for (std::uint32_t& corner : corners) corner += first;
      faces += one[at];
      faces.append(reinterpret_cast<const char*>(corners), sizeof corners);
      faces += one[at + 13];
    }
    first += static_cast<std::uint32_t>(count);
  }
  EXPECT_TRUE(data == vertices + faces);

  writeAll(folder_.file("all.vtp"));
  EXPECT_NE(readBytes(folder_.file("all.vtp")).find("\"UInt32\" Name=\"label\""),
            std::string::npos);
  writeAll(folder_.file("all.obj"));
  const std::string text = readBytes(folder_.file("all.obj"));
  std::size_t place = 0;
  for (const std::uint64_t label : labels) {
    place = text.find("\ng label_" + std::to_string(label) + "\n", place);
    EXPECT_NE(place, std::string::npos) << label;
  }
  writeAll(folder_.file("all.glb"));
  EXPECT_EQ(GlbFile(readBytes(folder_.file("all.glb"))).json["materials"][0]["name"],
            "label 16777217");

  const MeshObject large{.name = "label 4294967296", .label = 4294967296};
  EXPECT_THROW(makeLabelCollection(folder_.file("large.ply"))->add(large), Error);
  EXPECT_NO_THROW(makeLabelCollection(folder_.file("large.obj"))->add(large));
  EXPECT_THROW(makeLabelCollection(folder_.file("all.stl")), Error);
}

TEST_F(MeshCollectionTest, NothingIsLeftOfOneThatEndsEarly) {
  for (const char* name : {"all.glb", "all.3mf"}) {
    {
      const auto all = makeMeshCollection(folder_.file(name));
      const auto first = all->add({.name = "first"});
      extract(*first, 0);
    }
    EXPECT_EQ(filesLeft(), 1u) << name;
  }
}

TEST_F(MeshCollectionTest, OtherFormatsAreRefusedWithAWayOut) {
  for (const char* name : {"all.ply", "all.stl", "all.obj", "all.vtp"}) {
    try {
      makeMeshCollection(folder_.file(name));
      ADD_FAILURE() << name;
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find("write .glb or .3mf"), std::string::npos);
    }
  }
  EXPECT_THROW(makeMeshCollection(folder_.file("all.glb"), {.zlib = true}), Error);
}

}  // namespace
}  // namespace isobrick::test
