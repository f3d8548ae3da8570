// A choice among the components of a surface that holds for other queries of the same volume too:
// components are named by points on them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/query.h"
#include "isobrick/extract/sinks/surface_components.h"

namespace isobrick {

// A component, as it was when it was chosen.
struct ComponentSeed {
  glm::dvec3 point{0.0};  // on it, world units
  double area = 0.0;      // world units^2

  bool operator==(const ComponentSeed&) const = default;  // equal in both
};

// Components named in `keep` stay. If there are any, all others go; else those go that are named in
// `hide` or have less than the least area.
struct PieceChoice {
  std::vector<ComponentSeed> keep;  // these, and no other
  std::vector<ComponentSeed> hide;  // all but these
  double least_area = 0.0;          // world units^2

  // All stay.
  bool isAll() const { return keep.empty() && hide.empty() && !(least_area > 0.0); }
  bool operator==(const PieceChoice&) const = default;  // equal in all
};

// The components that a choice leaves of one query's surface.
struct ChosenComponents {
  std::vector<std::uint8_t> is_kept;  // an entry for each of the list, 0 or 1
  // Seeds without a component: none is within 4 cells, or, of `hide`, the one there has more than 4
  // times the area, as a piece that is joined to a larger one at this isovalue or level. They have
  // no effect.
  std::size_t lost = 0;
};

// For a ComponentFinder, whose components chosenAmong() needs.
ComponentPoints pointsOf(const PieceChoice& choice);
// Finds the components that the choice names.
ChosenComponents chosenAmong(const SurfaceComponents& components, const PieceChoice& choice);
// The same of a list, if `found` are the places in it of pointsOf(), none for those without one.
ChosenComponents chosenAmong(const std::vector<SurfaceComponent>& list,
                             const std::vector<std::optional<std::size_t>>& found,
                             const PieceChoice& choice);

// The triangles are too many.
struct TooManyTriangles {
  std::uint64_t triangles = 0;  // so far
};
// The result of extractChosen().
struct ChosenExtraction {
  ExtractionReport report;  // of the second pass
  std::size_t lost = 0;     // see ChosenComponents
};
// The query's surface without the components that the choice leaves out, in two passes over one
// plan; the memory of the first grows with the number of components in bricks. A progressive query
// waits for its bricks. `most_triangles`: throws TooManyTriangles if the first pass has more; 0:
// any number. `numbers`: those of the vertices (ComponentFilter). Throws as Extractor::execute()
// does.
ChosenExtraction extractChosen(Extractor& extractor, Query query, const PieceChoice& choice,
                               TriangleSink& sink, std::uint64_t most_triangles = 0,
                               const ComponentNumbers* numbers = nullptr);

}  // namespace isobrick
