#include <imgui.h>

#include <algorithm>
#include <string>

#include "isobrick/viewer/window/panel_controls.h"
#include "isobrick/viewer/window/panel_tools.h"

namespace isobrick {
namespace {

// A list with more has its largest; the least area deals with the rest.
constexpr std::size_t kMostRows = 200;

void pickAndList(ViewSession& session) {
  PieceList& pieces = session.pieces();
  Interaction& interaction = session.interaction();
  bool picks = interaction.tool == Interaction::Tool::kPiece;
  if (ImGui::Checkbox("pick", &picks))
    chooseTool(picks ? Interaction::Tool::kPiece : Interaction::Tool::kNone, interaction);
  explain(
      "Click a piece in the scene to select it (K). Enter then keeps only that one, Delete hides "
      "it. Esc ends it.");
  ImGui::SameLine();
  if (pieces.busy()) {
    if (ImGui::Button("cancel")) pieces.cancel();
    explain("Ends the search for pieces.");
    ImGui::SameLine();
    ImGui::ProgressBar(pieces.progress());
    return;
  }
  if (ImGui::Button("list pieces")) session.listPieces(std::nullopt);
  explain("Finds the connected pieces of the active surface, all of it, the largest first.");
  if (!pieces.error().empty()) ImGui::TextWrapped("%s", pieces.error().c_str());
}

void chosenPieces(ViewSession& session, float scale) {
  ViewState& state = session.state();
  PieceChoice& choice = activeSurface(state).pieces;
  bool drops = choice.least_area > 0.0;
  if (ImGui::Checkbox("without small pieces", &drops)) choice.least_area = drops ? 10.0 : 0.0;
  explain("Leaves out the pieces that have less area than this.");
  if (drops) {
    const bool is_mm = session.pyramid().spec().geometry.unit == LengthUnit::kMillimetre;
    ImGui::SameLine();
    ImGui::SetNextItemWidth(110.0f * scale);
    double area = choice.least_area;
    sliderOf("##least", area, 0.1, 1e5, is_mm ? "below %.4g mm\u00b2" : "below %.4g",
             ImGuiSliderFlags_Logarithmic);
    choice.least_area = std::max(area, 1e-6);
  }
  if (choice.keep.empty() && choice.hide.empty()) return;
  if (!choice.keep.empty())
    ImGui::Text("%zu kept, no other piece is shown", choice.keep.size());
  else
    ImGui::Text("%zu hidden", choice.hide.size());
  ImGui::SameLine();
  if (ImGui::Button("show all")) choice.keep.clear(), choice.hide.clear();
  explain("Ends 'only this' and 'hide'.");
}

void selectedPieceRow(ViewSession& session) {
  const SurfaceComponent* const piece = session.pieces().selectedPiece();
  if (piece == nullptr) return;
  const glm::dvec3 extent = piece->upper - piece->lower;
  const std::optional<double> volume = session.volumeOf(*piece);
  ImGui::TextWrapped("%s; %.4g x %.4g x %.4g, centre %.4g %.4g %.4g",
                     volume ? text("encloses %.5g", *volume).c_str() : "open", extent.x, extent.y,
                     extent.z, piece->center.x, piece->center.y, piece->center.z);
  explain(
      "Enclosed volume (below 0 for the wall of a hollow), extent along x, y and z, centre of the "
      "surface, in world units.");
  if (ImGui::Button("only this")) session.keepSelectedPiece();
  explain("Shows this piece alone; meshes have it alone, too (Enter, while picking).");
  ImGui::SameLine();
  if (ImGui::Button("measure")) session.measureSelectedPiece();
  explain("Adds its area and volume to the measures.");
  ImGui::SameLine();
  if (ImGui::Button("hide")) session.hideSelectedPiece();
  explain("Leaves this piece out, of meshes too (Delete, while picking). At most 64 are hidden.");
}

void frame(ViewSession& session, const SurfaceComponent& piece) {
  WorldBox box = emptyWorldBox();
  box.include(piece.lower);
  box.include(piece.upper);
  session.state().camera = framed(session.state().camera, box, session.interaction().aspect());
}

void pieceRows(ViewSession& session, float scale) {
  PieceList& pieces = session.pieces();
  if (!pieces.listed()) return;
  const ListedComponents& listed = *pieces.listed();
  const std::vector<SurfaceComponent>& list = listed.list();
  std::string title = std::to_string(list.size()) + " pieces";
  if (!session.piecesAreCurrent()) title += text(" at isovalue %.6g", listed.isovalue());
  if (listed.level() > 0) title += text(", at level %d: level 0 is too much", listed.level());
  ImGui::TextWrapped("%s", title.c_str());
  selectedPieceRow(session);
  if (list.empty()) return;
  const bool is_mm = session.pyramid().spec().geometry.unit == LengthUnit::kMillimetre;
  const char* const unit = is_mm ? " mm\u00b2" : "";
  const std::size_t rows = std::min(list.size(), kMostRows);
  const bool is_colored =
      session.piecesAreCurrent() && session.state().coloring == ViewColoring::kComponent;
  ImGui::BeginChild("pieces", {0.0f, 150.0f * scale}, true);
  for (std::size_t i = 0; i < rows; ++i) {
    const SurfaceComponent& piece = list[i];
    const bool is_selected = pieces.selected() == i;
    if (is_colored) patchOf(componentColor(i));
    const std::string row = text("%zu   %.5g%s   %llu triangles##%zu", i, piece.area, unit,
                                 static_cast<unsigned long long>(piece.triangles), i);
    if (ImGui::Selectable(row.c_str(), is_selected)) {
      pieces.select(i);
      frame(session, piece);
    }
    explain("Its area and triangles. Click to frame it.");
  }
  if (rows < list.size()) ImGui::TextDisabled("and %zu smaller ones", list.size() - rows);
  ImGui::EndChild();
}

}  // namespace

void pieceControls(ViewSession& session, float scale) {
  if (!ImGui::CollapsingHeader("pieces")) return;
  if (&session.activeVolume() != &session.volume())
    return ImGui::TextWrapped("Only surfaces of the first volume have a list of their pieces.");
  pickAndList(session);
  chosenPieces(session, scale);
  pieceRows(session, scale);
}

}  // namespace isobrick
