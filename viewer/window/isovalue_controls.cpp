#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "isobrick/viewer/state/measurement.h"
#include "isobrick/viewer/state/view_keys.h"
#include "isobrick/viewer/window/panel_controls.h"
#include "isobrick/viewer/window/panel_tools.h"

namespace isobrick {
namespace {

constexpr ImU32 kGround = IM_COL32(14, 15, 18, 255);
constexpr ImU32 kCounts = IM_COL32(112, 136, 170, 255);
constexpr ImU32 kAreas = IM_COL32(148, 118, 170, 255);
constexpr ImU32 kActive = IM_COL32(255, 214, 102, 255);
constexpr ImU32 kOther = IM_COL32(210, 210, 210, 150);
constexpr ImU32 kSuggested = IM_COL32(120, 220, 160, 255);

// The logarithm of what each value has.
void bars(const std::vector<double>& counts, ImU32 color, const ImVec2& at, const ImVec2& size) {
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const double most = *std::max_element(counts.begin(), counts.end());
  const double highest = std::max(std::log1p(most), 1e-30);
  const float width = size.x / static_cast<float>(counts.size());
  for (std::size_t i = 0; i < counts.size(); ++i) {
    const auto height = static_cast<float>(std::log1p(counts[i]) / highest);
    const float x = at.x + width * static_cast<float>(i);
    list.AddRectFilled({x, at.y + size.y * (1.0f - height)}, {x + width, at.y + size.y}, color);
  }
}

// A strip of all values with something of each, in which a drag moves the isovalue. Returns the
// value under the cursor, or else that isovalue.
double valueStrip(ViewSession& session, const char* name, const std::vector<double>& counts,
                  ImU32 color, float height, float scale, const char* what) {
  ViewState& state = session.state();
  const ValueHistogram& histogram = session.activeHistogram();
  ViewSurface& active = activeSurface(state);
  const ImVec2 at = ImGui::GetCursorScreenPos();
  const ImVec2 size{std::max(1.0f, ImGui::GetContentRegionAvail().x), height * scale};
  ImGui::InvisibleButton(name, size);
  explain(what);
  const double span = std::max(histogram.greatest - histogram.least, 1e-30);
  double pointed = active.isovalue;
  if (ImGui::IsItemHovered() || ImGui::IsItemActive())
    pointed = histogram.least +
              span * std::clamp((ImGui::GetIO().MousePos.x - at.x) / size.x, 0.0f, 1.0f);
  if (ImGui::IsItemActive()) active.isovalue = pointed;
  const auto xOf = [&](double value) {
    return at.x + size.x * static_cast<float>((value - histogram.least) / span);
  };
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const ImVec2 end{at.x + size.x, at.y + size.y};
  list.AddRectFilled(at, end, kGround, 3.0f * scale);
  list.PushClipRect(at, end, true);
  bars(counts, color, at, size);
  for (const ViewSurface& surface : state.surfaces) {
    if (surface.volume != active.volume) continue;
    const bool is_active = &surface == &active;
    const float x = xOf(surface.isovalue);
    list.AddLine({x, at.y}, {x, end.y}, is_active ? kActive : kOther,
                 (is_active ? 2.0f : 1.0f) * scale);
  }
  for (const double suggested : session.activeVolume().isovalues) {
    const float x = xOf(suggested), half = 5.0f * scale;
    list.AddTriangleFilled({x - half, at.y}, {x + half, at.y}, {x, at.y + 1.6f * half}, kSuggested);
  }
  list.PopClipRect();
  return pointed;
}

// The pencil of isosurfaces: area, and triangles at the detail that is shown, of every isovalue.
void contourSpectrum(ViewSession& session, float scale) {
  const ValueHistogram& histogram = session.activeHistogram();
  if (histogram.edges.empty()) return;
  const double value = valueStrip(
      session, "areas", histogram.edges, kAreas, 40.0f, scale,
      "How large the isosurface of each value is, as a logarithm, found when the pyramid was "
      "built. The line below says its area, and how many triangles it has as fine as surfaces are "
      "shown now. Drag to move the isovalue.");
  const GridGeometry& geometry = session.activeVolume().geometry;
  const glm::dvec3 per_unit = 1.0 / geometry.spacing;
  // Of a surface in all directions, half of the area is seen along each axis.
  const double edges_per_area =
      0.5 * (per_unit.y * per_unit.z + per_unit.x * per_unit.z + per_unit.x * per_unit.y);
  const double area = histogram.edgesAt(value) / edges_per_area;
  const char* const unit = geometry.unit == LengthUnit::kMillimetre ? " mm\u00b2" : "";
  ImGui::TextDisabled("at %.5g: area %s%s, %s triangles", value, shortNumber(area).c_str(), unit,
                      shortNumber(std::round(session.predictedTriangles(value))).c_str());
}

// Digits of values: six of their range, however far that is from 0.
int digitsOf(const ViewVolume& volume) {
  const double most = std::max(std::abs(volume.least_value), std::abs(volume.greatest_value));
  const double span = volume.greatest_value - volume.least_value;
  const double more = span > 0 ? std::ceil(std::log10(most / span)) : 0.0;
  return 6 + static_cast<int>(std::clamp(more, 0.0, 11.0));
}

void suggestions(ViewSession& session) {
  if (session.activeVolume().isovalues.empty()) return;
  ViewState& state = session.state();
  double& isovalue = activeSurface(state).isovalue;
  ImGui::AlignTextToFramePadding();
  ImGui::TextDisabled("suggested");
  int number = 0;
  for (const double suggested : session.activeVolume().isovalues) {
    ImGui::SameLine();
    ImGui::PushID(number++);
    if (ImGui::Button(text("%.*g", digitsOf(session.activeVolume()), suggested).c_str()))
      isovalue = suggested;
    explain("This isovalue. R steps through those that are suggested.");
    ImGui::PopID();
  }
}

}  // namespace

void isovalueControls(ViewSession& session, float scale) {
  valueStrip(session, "histogram", session.activeHistogram().counts, kCounts, 90.0f, scale,
             "How many voxels have each value, as a logarithm. Drag to move the isovalue; green "
             "marks are the values that are suggested.");
  ViewState& state = session.state();
  double& isovalue = activeSurface(state).isovalue;
  const double step = isovalueStep(session.activeVolume());
  const std::string format = text("%%.%dg", digitsOf(session.activeVolume()));
  ImGui::InputDouble("isovalue", &isovalue, step, 10.0 * step, format.c_str());
  explain("Of the active surface. The left and right arrows move it, with Shift faster.");
  InsideOf& inside = activeSurface(state).inside;
  bool is_below = inside == InsideOf::kBelow;
  if (ImGui::Checkbox("inside below", &is_below))
    inside = is_below ? InsideOf::kBelow : InsideOf::kAbove;
  explain("The inside is where values are below the isovalue: a dark object, or a level set.");
  ImGui::SameLine();
  ImGui::Checkbox("caps", &state.capped);
  explain("Surfaces are closed at the border of the volume, in mesh files too.");
  contourSpectrum(session, scale);
  suggestions(session);
}

}  // namespace isobrick
