// The oracles of a query that know cells alone, and read nothing.
#pragma once

#include <optional>
#include <vector>

#include "isobrick/extract/oracles/focus_oracle.h"
#include "isobrick/extract/oracles/view_oracle.h"
#include "isobrick/extract/query.h"

namespace isobrick {

// Of one choice: a cell is refined where both refine it, and the oracles that read do too.
struct ChoiceOracles {
  const DetailChoice* choice;
  FocusOracle focus;
  std::optional<ViewOracle> view;
};

// Of the query's own choice, then of the further ones. Made once a query, which has to outlive it
// unchanged.
inline std::vector<ChoiceOracles> oraclesOf(const Lattice& lattice, const GridGeometry& geometry,
                                            const Query& query) {
  std::vector<ChoiceOracles> oracles;
  const auto add = [&](const DetailChoice& choice) {
    oracles.push_back({&choice, FocusOracle(lattice, choice), std::nullopt});
    if (choice.view) oracles.back().view.emplace(lattice, geometry, *choice.view);
  };
  add(query);
  for (const DetailChoice& choice : query.or_finer) add(choice);
  return oracles;
}

}  // namespace isobrick
