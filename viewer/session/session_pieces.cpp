// The pieces of the active surface, for ViewSession.
#include "isobrick/viewer/session/view_session.h"

namespace isobrick {
namespace {

ComponentSeed seedOf(const SurfaceComponent& piece) { return {piece.point, piece.area}; }

}  // namespace

void ViewSession::listPieces(const std::optional<glm::dvec3>& point) {
  pieces_.request(state_.surfaces[static_cast<std::size_t>(state_.active_surface)].isovalue, point);
}

bool ViewSession::piecesAreCurrent() const {
  return pieces_.listed() &&
         pieces_.listed()->isovalue ==
             state_.surfaces[static_cast<std::size_t>(state_.active_surface)].isovalue;
}

void ViewSession::keepSelectedPiece() {
  if (const SurfaceComponent* const piece = pieces_.selectedPiece())
    keepOnly(seedOf(*piece),
             state_.surfaces[static_cast<std::size_t>(state_.active_surface)].pieces);
}

void ViewSession::hideSelectedPiece() {
  const SurfaceComponent* const piece = pieces_.selectedPiece();
  if (piece == nullptr) return;
  hide(seedOf(*piece), state_.surfaces[static_cast<std::size_t>(state_.active_surface)].pieces);
  pieces_.select(std::nullopt);
}

void ViewSession::measureSelectedPiece() {
  const SurfaceComponent* const piece = pieces_.selectedPiece();
  if (piece == nullptr || state_.piece_measures.size() >= kMostPieceMeasures) return;
  const PieceList::Listed& listed = *pieces_.listed();
  state_.piece_measures.push_back(
      measureOf(*piece, listed.isovalue, listed.level + shown_.firstLevel()));
}

}  // namespace isobrick
