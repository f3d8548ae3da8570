// 3MF: a zip archive of a model in XML. Neither Debian's library for it nor any other streams a
// model; here vertices and triangles wait as numbers in temporary files, and become packed text
// some blocks at a time, all threads side by side.
#include <tbb/task_arena.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <deque>
#include <limits>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/extract/sinks/gltf_text.h"
#include "isobrick/extract/sinks/mesh_collection.h"
#include "isobrick/extract/sinks/mesh_formats.h"
#include "isobrick/extract/sinks/numbered_sink.h"
#include "isobrick/extract/sinks/side_file.h"
#include "isobrick/extract/sinks/xml_text.h"
#include "isobrick/extract/sinks/zip_writer.h"
#include "isobrick/storage/isolated_loop.h"

namespace isobrick {
namespace {

// The format's own word for a unit; none if it has none.
const char* threeMfUnit(const std::string& unit) {
  static constexpr std::pair<const char*, const char*> kWords[] = {{"micrometres", "micron"},
                                                                   {"millimetres", "millimeter"},
                                                                   {"centimetres", "centimeter"},
                                                                   {"metres", "meter"},
                                                                   {"inches", "inch"},
                                                                   {"feet", "foot"},
                                                                   {"unknown", "millimeter"},
                                                                   {"voxels", "millimeter"}};
  for (const auto& [name, word] : kWords)
    if (unit == name) return word;
  return nullptr;
}

// What the model needs of an object, which outlives the object's sink.
struct ThreeMfObject {
  ThreeMfObject(const std::string& path, MeshObject with)
      : about(std::move(with)), vertices(path, "vertices"), corners(path, "corners") {}

  const MeshObject about;
  SideFile vertices, corners;  // three doubles a vertex, three numbers of 32 bits a triangle
  std::uint64_t vertex_count = 0, triangle_count = 0;
  MeshFrame frame;
  bool double_precision = false;
};

// Fills the files of an object.
class ThreeMfObjectSink : public NumberedMesh {
 public:
  ThreeMfObjectSink(const std::string& path, const MeshFileOptions& options, ThreeMfObject& object)
      : NumberedMesh(path, options), object_(object) {}

  void begin(const MeshFrame& frame) override {
    NumberedMesh::begin(frame);
    if (threeMfUnit(unitText(frame_)) == nullptr)
      throw meshError(path_, "a .3mf has no " + unitText(frame_) + "; choose another unit");
    object_.frame = frame_;
    object_.double_precision = double_precision_;
  }
  void place(PlacedBatch& placed) override {
    NumberedMesh::place(placed);
    if (vertices() > std::numeric_limits<std::int32_t>::max())
      throw meshError(path_,
                      "a .3mf holds at most 2,147,483,647 vertices; write .ply, or extract a "
                      "coarser level");
  }
  void write(PlacedBatch& placed) override {
    findVertices(placed);
    if (!placed.world.empty())
      object_.vertices.pwrite(placed.world.data(), placed.world.size() * kVertexBytes,
                              placed.first_vertex * kVertexBytes);
    findCorners(placed);
    object_.corners.pwrite(placed.bytes.data(), placed.bytes.size(),
                           placed.first_triangle * kTriangleBytes);
  }
  void finish() override {
    object_.vertex_count = vertices();
    object_.triangle_count = triangles_;
    if (file_ != nullptr) file_->finish();
  }
  // Of a file of this object alone.
  void finishWith(std::unique_ptr<MeshCollection> file) { file_ = std::move(file); }
  std::string loss() const override {
    if (!double_precision_) return {};
    return "most readers compute in single precision, which moves vertices so far from the origin";
  }
  std::string assumption() const override {
    const std::string unit = unitText(frame_);
    if (unit != "voxels" && unit != lengthUnitName(LengthUnit::kUnknown)) return {};
    return "the format knows no lengths without a unit, so they count as millimetres";
  }

  static constexpr std::uint64_t kVertexBytes = sizeof(glm::dvec3), kTriangleBytes = 12;

 private:
  ThreeMfObject& object_;
  std::unique_ptr<MeshCollection> file_;
};

// "#FF8000"
std::string colorText(const glm::vec3& color) {
  const auto byte = [](float part) {
    return static_cast<unsigned>(std::lround(255 * std::clamp(part, 0.0f, 1.0f)));
  };
  char text[32];
  std::snprintf(text, sizeof text, "#%02X%02X%02X", byte(color.r), byte(color.g), byte(color.b));
  return text;
}

template <typename Number>
void appendNumber(std::string& text, Number number) {
  char digits[32];
  text.append(digits, std::to_chars(digits, digits + sizeof digits, number).ptr);
}

class ThreeMfModel {
 public:
  ThreeMfModel(AtomicFile& file, const CancelFlag* cancel) : zip_(file), cancel_(cancel) {}

  void write(std::span<const ThreeMfObject* const> objects) {
    const std::string head = R"(<?xml version="1.0" encoding="UTF-8"?>)";
    addMember("[Content_Types].xml",
              joined(head, R"(<Types xmlns="http://schemas.openxmlformats.org/package/2006/)"
                           R"(content-types"><Default Extension="rels" ContentType="application/)"
                           R"(vnd.openxmlformats-package.relationships+xml"/><Default )"
                           R"(Extension="model" ContentType="application/)"
                           R"(vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>)"));
    addMember(
        "_rels/.rels",
        joined(head, R"(<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/)"
                     R"(relationships"><Relationship Target="/3D/3dmodel.model" Id="model" )"
                     R"(Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>)"
                     R"(</Relationships>)"));
    zip_.beginMember("3D/3dmodel.model");
    add(joined(head, modelBegin(*objects.front())));
    std::string items;
    for (std::size_t i = 0; i < objects.size(); ++i) {
      if (objects[i]->triangle_count == 0) continue;
      const std::string id = std::to_string(2 * i + 2);
      addObject(*objects[i], std::to_string(2 * i + 1), id);
      items += joined(R"(<item objectid=")", id, R"("/>)", "\n");
    }
    add(joined("</resources>\n<build>\n", items, "</build>\n</model>\n"));
    zip_.endMember();
    zip_.finish();
  }

 private:
  static constexpr std::uint64_t kBlockRows = 1 << 14;

  static std::string modelBegin(const ThreeMfObject& object) {
    const MeshFrame& frame = object.frame;
    const glm::dvec3 shift = shiftOf(frame);
    return joined(R"(<model unit=")", threeMfUnit(unitText(frame)),
                  R"(" xml:lang="en-US" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/)"
                  R"(2015/02">)",
                  "\n", R"(<metadata name="Application">isobrick</metadata>)", "\n",
                  R"(<metadata name="Description">units: )", unitText(frame),
                  "; space: ", spaceText(frame),
                  shift == glm::dvec3(0.0) ? "" : "; shift: " + shiftText(shift),
                  "</metadata>\n<resources>\n");
  }

  void addMember(const std::string& name, const std::string& text) {
    zip_.beginMember(name);
    add(text);
    zip_.endMember();
  }
  void add(const std::string& text) { zip_.add(packText(text)); }

  void addObject(const ThreeMfObject& object, const std::string& color_id, const std::string& id) {
    const MeshObject& about = object.about;
    const std::string name = xmlText(about.name);
    if (about.color)
      add(joined(R"(<basematerials id=")", color_id, R"("><base name=")", name,
                 R"(" displaycolor=")", colorText(*about.color), R"("/></basematerials>)", "\n"));
    add(joined(R"(<object id=")", id, R"(" type="model")",
               name.empty() ? "" : joined(R"( name=")", name, "\""),
               about.color ? joined(R"( pid=")", color_id, R"(" pindex="0")") : "",
               "><mesh>\n<vertices>\n"));
    addRows(object.vertex_count, [&](std::uint64_t first, std::size_t count, std::string& text) {
      std::vector<glm::dvec3> vertices(count);
      object.vertices.read(vertices.data(), count * sizeof vertices[0],
                           first * ThreeMfObjectSink::kVertexBytes);
      for (const glm::dvec3& vertex : vertices) {
        for (int axis = 0; axis < 3; ++axis) {
          constexpr const char* kNames[] = {"<vertex x=\"", "\" y=\"", "\" z=\""};
          text += kNames[axis];
          if (object.double_precision)
            appendNumber(text, vertex[axis]);
          else
            appendNumber(text, static_cast<float>(vertex[axis]));
        }
        text += "\"/>\n";
      }
    });
    add("</vertices>\n<triangles>\n");
    addRows(object.triangle_count, [&](std::uint64_t first, std::size_t count, std::string& text) {
      std::vector<std::uint32_t> corners(3 * count);
      object.corners.read(corners.data(), count * ThreeMfObjectSink::kTriangleBytes,
                          first * ThreeMfObjectSink::kTriangleBytes);
      for (std::size_t i = 0; i < corners.size(); ++i) {
        constexpr const char* kNames[] = {"<triangle v1=\"", "\" v2=\"", "\" v3=\""};
        text += kNames[i % 3];
        appendNumber(text, corners[i]);
        if (i % 3 == 2) text += "\"/>\n";
      }
    });
    add("</triangles>\n</mesh></object>\n");
  }

  // Calls write(first row, rows, text) for blocks of rows.
  template <typename Write>
  void addRows(std::uint64_t rows, const Write& write) {
    std::vector<PackedText> blocks(
        4 * static_cast<std::size_t>(tbb::this_task_arena::max_concurrency()));
    for (std::uint64_t first = 0; first < rows; first += blocks.size() * kBlockRows) {
      if (cancel_ != nullptr) cancel_->check();
      const auto count = static_cast<std::size_t>(
          std::min<std::uint64_t>(blocks.size(), (rows - first + kBlockRows - 1) / kBlockRows));
      isolatedFor(std::size_t{0}, count, [&](std::size_t i) {
        const std::uint64_t at = first + i * kBlockRows;
        std::string text;
        write(at, static_cast<std::size_t>(std::min(rows - at, kBlockRows)), text);
        blocks[i] = packText(text);
      });
      for (std::size_t i = 0; i < count; ++i) zip_.add(blocks[i]);
    }
  }

  ZipWriter zip_;
  const CancelFlag* const cancel_;
};

class ThreeMfFile : public MeshCollection {
 public:
  ThreeMfFile(const std::string& path, const MeshFileOptions& options)
      : options_(options), file_(path) {}

  std::unique_ptr<MeshFileSink> add(const MeshObject& object) override {
    return makeObject(object);
  }
  std::unique_ptr<ThreeMfObjectSink> makeObject(const MeshObject& object) {
    objects_.emplace_back(file_.path(), object);
    return std::make_unique<ThreeMfObjectSink>(file_.path(), options_, objects_.back());
  }
  void finish() override {
    std::vector<const ThreeMfObject*> objects;
    for (const ThreeMfObject& object : objects_) objects.push_back(&object);
    ThreeMfModel(file_, options_.cancel).write(objects);
    file_.commit(options_.cancel);
  }

 private:
  const MeshFileOptions options_;
  AtomicFile file_;
  std::deque<ThreeMfObject> objects_;
};

}  // namespace

std::unique_ptr<MeshFileSink> makeThreeMfSink(const std::string& path,
                                              const MeshFileOptions& options) {
  auto file = std::make_unique<ThreeMfFile>(path, options);
  auto object = file->makeObject({});
  object->finishWith(std::move(file));
  return object;
}

std::unique_ptr<MeshCollection> makeThreeMfCollection(const std::string& path,
                                                      const MeshFileOptions& options) {
  return std::make_unique<ThreeMfFile>(path, options);
}

}  // namespace isobrick
