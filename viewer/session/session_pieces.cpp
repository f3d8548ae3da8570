// The pieces of the active surface, for ViewSession.
#include <set>
#include <utility>

#include "isobrick/viewer/session/view_session.h"

namespace isobrick {
namespace {

ComponentSeed seedOf(const SurfaceComponent& piece) { return {piece.point, piece.area}; }

}  // namespace

void ViewSession::listPieces(const std::optional<glm::dvec3>& point) {
  hides_no_more_ = false;
  pieces_.request(activeSurface(state_).isovalue, point);
}

bool ViewSession::piecesAreCurrent() const {
  return pieces_.listed() && pieces_.listed()->isovalue() == activeSurface(state_).isovalue;
}

void ViewSession::keepSelectedPiece() {
  if (const SurfaceComponent* const piece = pieces_.selectedPiece())
    keepOnly(seedOf(*piece), activeSurface(state_).pieces);
}

void ViewSession::hideSelectedPiece() {
  const SurfaceComponent* const piece = pieces_.selectedPiece();
  if (piece == nullptr) return;
  hides_no_more_ = !hide(seedOf(*piece), activeSurface(state_).pieces);
  if (!hides_no_more_) pieces_.select(std::nullopt);
}

void ViewSession::measureSelectedPiece() {
  const SurfaceComponent* const piece = pieces_.selectedPiece();
  if (piece == nullptr || state_.piece_measures.size() >= kMostPieceMeasures) return;
  const ListedComponents& listed = *pieces_.listed();
  state_.piece_measures.push_back(
      measureOf(*piece, listed.isovalue(), listed.level() + shown_.firstLevel()));
}

// Asks for the lists that the surfaces are coloured by, and takes those that are there.
void ViewSession::updatePieces(double seconds) {
  std::set<double> isovalues;
  if (state_.coloring == ViewColoring::kComponent)
    for (const ViewSurface& surface : state_.surfaces)
      if (surface.visible) isovalues.insert(surface.isovalue);
  pieces_.want(isovalues, seconds);
  pieces_.update();
  colored_by_.resize(isovalues.empty() ? 0 : state_.surfaces.size());
  for (std::size_t s = 0; s < colored_by_.size(); ++s)
    colored_by_[s] = pieces_.wanted(state_.surfaces[s].isovalue);
}

std::vector<ColoredPieces> ViewSession::coloredPieces() const {
  std::vector<ColoredPieces> colored;
  for (std::size_t s = 0; s < colored_by_.size(); ++s) {
    const ViewSurface& surface = state_.surfaces[s];
    const StreamedSurface* const shown = requests_.shown().surface(s);
    const auto listed = pieces_.wanted(surface.isovalue);
    if (!surface.visible || !(surface.opacity > 0.0) || !listed || shown == nullptr) continue;
    ColoredPieces& pieces = colored.emplace_back();
    pieces.isovalue = surface.isovalue;
    pieces.count = shown->pieces;
    for (const std::size_t place : shown->largest)
      if (place < listed->list().size())
        pieces.largest.emplace_back(place, listed->list()[place].area);
  }
  return colored;
}

}  // namespace isobrick
