#include "tools/component_list.h"

#include <fmt/format.h>

#include <algorithm>

#include "tools/byte_size.h"

namespace isobrick {

Json jsonOfComponents(const SurfaceComponents& components) {
  Json json = Json::array();
  for (const SurfaceComponent& one : components.list())
    json.push_back({{"triangles", one.triangles},
                    {"area", one.area},
                    {"volume", one.volume ? Json(*one.volume) : Json()},
                    {"enclosed", one.enclosed ? Json(*one.enclosed) : Json()},
                    {"lower", {one.lower.x, one.lower.y, one.lower.z}},
                    {"upper", {one.upper.x, one.upper.y, one.upper.z}}});
  return json;
}

void printComponents(const SurfaceComponents& components, const std::vector<std::uint8_t>& is_kept,
                     const std::string& ranked_by) {
  constexpr std::size_t kMostLines = 20;
  const std::vector<SurfaceComponent>& list = components.list();
  const auto kept = static_cast<std::uint64_t>(std::ranges::count(is_kept, 1));
  fmt::print("{} components, {} of them kept{}\n", countText(list.size()), countText(kept),
             ranked_by.empty() ? "" : ", the largest by " + ranked_by);
  if (list.empty()) return;
  fmt::print("  {:>6} {:>14} {:>14} {:>14}  box\n", "number", "triangles", "area", "volume");
  for (std::size_t i = 0; i < std::min(list.size(), kMostLines); ++i) {
    const SurfaceComponent& one = list[i];
    fmt::print("  {:>6} {:>14} {:>14.6g} {:>14}  {:.6g},{:.6g},{:.6g} to {:.6g},{:.6g},{:.6g}\n", i,
               countText(one.triangles), one.area,
               one.volume ? fmt::format("{:.6g}", *one.volume) : "has a border", one.lower.x,
               one.lower.y, one.lower.z, one.upper.x, one.upper.y, one.upper.z);
  }
  if (list.size() > kMostLines)
    fmt::print("  and {} smaller ones; --json lists all\n", countText(list.size() - kMostLines));
}

}  // namespace isobrick
