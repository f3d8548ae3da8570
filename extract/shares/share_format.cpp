#include "isobrick/extract/shares/share_format.h"

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <initializer_list>
#include <utility>

#include "isobrick/storage/pyramid_parts.h"

namespace isobrick {
namespace {

class FactLines {
 public:
  // All digits that a number needs to be read back as the same one.
  void add(const char* name, std::initializer_list<double> numbers) {
    text_ += name;
    char separator = '=';
    for (const double number : numbers) {
      char digits[32];
      text_ += separator;
      text_.append(digits, std::to_chars(digits, digits + sizeof digits, number).ptr);
      separator = ',';
    }
    text_ += '\n';
  }
  void add(const char* name, const glm::dvec3& point) { add(name, {point.x, point.y, point.z}); }
  // Whole numbers of 64 bits, which a double would round.
  void addWhole(const char* name, std::uint64_t number) {
    text_ += name;
    text_ += '=';
    text_ += std::to_string(number);
    text_ += '\n';
  }

  void addDetail(const DetailChoice& choice) {
    if (choice.focus) {
      add("focus", choice.focus->center);
      add("radius", {choice.focus->radius});
    }
    if (choice.uniform_level) add("level", {static_cast<double>(*choice.uniform_level)});
    if (choice.view) {
      add("eye", choice.view->eye);
      add("pixels", {choice.view->pixels_per_radian, choice.view->pixels});
      if (choice.view->pixels_per_unit) add("pixels_per_unit", {*choice.view->pixels_per_unit});
      if (const auto& field = choice.view->field) {
        add("direction", field->direction);
        add("field", {field->half_angle, field->radius});
      }
    }
    if (choice.curvature_tolerance) add("curvature_tolerance", {*choice.curvature_tolerance});
  }

  std::string take() { return std::move(text_); }

 private:
  std::string text_;
};

}  // namespace

std::string surfaceIdentity(const Pyramid& pyramid, const SurfaceChoice& choice) {
  FactLines lines;
  lines.add("mesh", {kMeshAlgorithm});
  // It covers the tables' checksums, the histogram's and the provenance's.
  const format::Header& header = pyramid.parts().tables().header();
  lines.addWhole("pyramid", header.header_checksum);
  lines.addWhole("pyramid_bytes", header.file_bytes);
  lines.add("isovalue", {static_cast<double>(pyramid.storedIsovalue(choice.isovalue))});
  lines.addDetail(choice);
  for (const DetailChoice& finer : choice.or_finer) {
    lines.add("or_finer", {});
    lines.addDetail(finer);
  }
  if (choice.box) {
    lines.add("box_min", choice.box->min);
    lines.add("box_max", choice.box->max);
  }
  if (choice.cap) lines.add("cap", {});
  if (choice.simplify) {
    lines.add("simplify", {choice.simplify->distance});
    lines.add("simplify_in_world", {choice.simplify->in_world ? 1.0 : 0.0});
    lines.add("drop_small", {choice.simplify->drop_small ? 1.0 : 0.0});
  }
  return lines.take();
}

std::string firstDifference(const std::string& identity, const std::string& other) {
  for (std::size_t at = 0, there = 0; at < identity.size() || there < other.size();) {
    const std::size_t end = std::min(identity.find('\n', at), identity.size());
    const std::size_t end_there = std::min(other.find('\n', there), other.size());
    const std::string line = identity.substr(at, end - at);
    const std::string line_there = other.substr(there, end_there - there);
    if (line != line_there)
      return (line.empty() ? "nothing more" : line) + " (and " +
             (line_there.empty() ? "nothing more" : line_there) + " in the other)";
    at = std::min(end + 1, identity.size());
    there = std::min(end_there + 1, other.size());
  }
  return "nothing";
}

}  // namespace isobrick
