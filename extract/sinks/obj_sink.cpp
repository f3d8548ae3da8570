// Wavefront OBJ.
#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <string>

#include "isobrick/extract/sinks/mesh_formats.h"
#include "isobrick/extract/sinks/numbered_sink.h"

namespace isobrick {
namespace {

// Characters of the longest float and double that read back as the same number.
constexpr std::size_t kFloatWidth = 15, kDoubleWidth = 24;
// Of a share of 255 with four digits behind the point.
constexpr std::size_t kColorWidth = 6;

// Writes text of a known length into memory.
class TextPointer {
 public:
  explicit TextPointer(std::byte* at) : at_(reinterpret_cast<char*>(at)) {}

  void put(std::string_view text) {
    std::memcpy(at_, text.data(), text.size());
    at_ += text.size();
  }
  // A space, and the number at the right of so many characters.
  template <typename Number>
  void putNumber(Number number, std::size_t width) {
    char digits[kDoubleWidth + 1];
    const char* end = std::to_chars(digits, digits + sizeof digits, number).ptr;
    putRight({digits, static_cast<std::size_t>(end - digits)}, width);
  }
  // " 12//12" if width is 6.
  void putCorner(std::uint64_t number, std::size_t width) {
    char digits[48];
    char* end = std::to_chars(digits, digits + 20, number).ptr;
    const auto count = static_cast<std::size_t>(end - digits);
    *end++ = '/';
    *end++ = '/';
    std::memcpy(end, digits, count);
    putRight({digits, 2 * count + 2}, width);
  }

 private:
  void putRight(std::string_view text, std::size_t width) {
    const std::size_t blanks = 1 + width - text.size();
    std::memset(at_, ' ', blanks);
    at_ += blanks;
    put(text);
  }
  char* at_;
};

std::size_t digitsOf(std::uint64_t number) { return std::to_string(number).size(); }

// Vertices and faces go batch by batch: a face needs only vertices of its batch and earlier ones.
// Numbers are padded, so that place() computes the length of a batch's text, and threads write
// their batches side by side.
class ObjSink : public NumberedSink {
 public:
  using NumberedSink::NumberedSink;

  void begin(const MeshFrame& frame) override {
    NumberedSink::begin(frame);
    has_groups_ = has_groups_ || frame_.has_caps;
    const std::string header = makeHeader();
    file_.write(header.data(), header.size());
    next_byte_ = header.size();
  }
  void beginObject(const std::string& name) override {
    NumberedSink::beginObject(name);
    std::string group = name;
    std::ranges::replace(group, ' ', '_');  // a space parts names
    surface_group_ = "g " + group + "\n";
    cap_group_ = "g " + group + "_cap\n";
    has_groups_ = true;
  }
  void place(PlacedBatch& placed) override {
    NumberedSink::place(placed);
    placed.first_byte = next_byte_;
    next_byte_ += textBytes(placed);
  }
  void write(PlacedBatch& placed) override {
    findVertices(placed);
    findNumbers(placed);
    placed.bytes.resize(textBytes(placed));
    TextPointer to(placed.bytes.data());
    for (std::size_t i = 0; i < placed.world.size(); ++i) {
      const glm::dvec3& p = placed.world[i];
      to.put("v");
      for (int axis = 0; axis < 3; ++axis) {
        if (double_precision_)
          to.putNumber(p[axis], kDoubleWidth);
        else
          to.putNumber(static_cast<float>(p[axis]), kFloatWidth);
      }
      if (options_.colors) {
        const glm::vec3 color = colorOf(placed, i);
        for (int axis = 0; axis < 3; ++axis)
          to.putNumber(std::round(color[axis] * 10000) / 10000, kColorWidth);
      }
      to.put("\n");
    }
    forEachNew(placed, [&](std::size_t v) {
      to.put("vn");
      for (int axis = 0; axis < 3; ++axis) to.putNumber(placed.batch.normals[v][axis], kFloatWidth);
      to.put("\n");
    });
    const std::vector<std::uint32_t>& numbers = placed.numbers;
    const auto& corners = placed.batch.triangles;
    for (std::size_t i = 0; i < corners.size(); i += 3) {
      if (has_groups_ && i == firstCapIndex(placed.batch))
        to.put(cap_group_);
      else if (has_groups_ && i == 0)
        to.put(surface_group_);
      to.put("f");
      for (std::size_t c = i; c < i + 3; ++c)
        to.putCorner(std::uint64_t{numbers[corners[c]]} + 1, cornerWidth(placed));
      to.put("\n");
    }
    file_.pwrite(placed.bytes.data(), placed.bytes.size(), placed.first_byte);
  }
  void finish() override {
    file_.continueFrom(next_byte_);
    publish(makeHeader());
  }

 private:
  // Always as long.
  std::string makeHeader() const {
    const auto padded = [](std::uint64_t count) {
      const std::string text = std::to_string(count);
      return std::string(20 - text.size(), ' ') + text;
    };
    const bool is_above = frame_.inside == InsideOf::kAbove;
    return "# isobrick\n# units: " + unitText(frame_) + "\n# space: " + spaceText(frame_) +
           shiftLine("\n# shift: ", "") + "\n# normals: towards " +
           (is_above ? "lower" : "higher") + " values\n# vertices:  " + padded(vertices()) +
           "\n# triangles: " + padded(triangles_) + "\n";
  }
  // "n//n" of the greatest number that a face of the batch can have.
  static std::size_t cornerWidth(const PlacedBatch& placed) {
    return 2 * digitsOf(placed.first_vertex + newVertices(placed)) + 2;
  }
  std::size_t textBytes(const PlacedBatch& placed) const {
    const std::size_t color = options_.colors ? 3 * (1 + kColorWidth) : 0;
    const std::size_t position =
        3 * (1 + (double_precision_ ? kDoubleWidth : kFloatWidth)) + color + 2;
    const std::size_t normal = 3 * (1 + kFloatWidth) + 3;
    const std::size_t face = 3 * (1 + cornerWidth(placed)) + 2;
    std::size_t groups = 0;
    if (has_groups_) {
      groups += firstCapIndex(placed.batch) > 0 ? surface_group_.size() : 0;
      groups += placed.batch.cap_indices > 0 ? cap_group_.size() : 0;
    }
    return newVertices(placed) * (position + normal) + placed.batch.triangles.size() / 3 * face +
           groups;
  }

  std::uint64_t next_byte_ = 0;
  // Lines before caps and before other triangles, if there are caps or objects.
  bool has_groups_ = false;
  std::string cap_group_ = "g cap\n", surface_group_ = "g surface\n";
};

}  // namespace

std::unique_ptr<MeshFileSink> makeObjSink(const std::string& path, const MeshFileOptions& options) {
  return std::make_unique<ObjSink>(path, options);
}

}  // namespace isobrick
