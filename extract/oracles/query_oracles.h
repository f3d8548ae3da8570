// The oracles of a query that all its threads share.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "isobrick/extract/oracles/flat_blocks.h"
#include "isobrick/extract/oracles/focus_oracle.h"
#include "isobrick/extract/oracles/view_oracle.h"
#include "isobrick/extract/query.h"
#include "isobrick/storage/deviation_code.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// For one choice: a cell is refined if all of them refine it, and the curvature oracle does too.
struct ChoiceOracles {
  const DetailChoice* choice;
  FocusOracle focus;
  std::optional<ViewOracle> view;
  std::unique_ptr<FlatBlocks> flat;  // with a tolerance of curvature, if there is a level 1
};

// For the query's own choice, then of the further ones. Made once a query, which has to outlive it
// unchanged.
inline std::vector<ChoiceOracles> oraclesOf(const Pyramid& pyramid, const Query& query) {
  const Lattice& lattice = pyramid.lattice();
  std::vector<ChoiceOracles> oracles;
  const auto add = [&](const DetailChoice& choice) {
    oracles.push_back({&choice, FocusOracle(lattice, choice), std::nullopt, nullptr});
    if (choice.view) oracles.back().view.emplace(lattice, pyramid.spec().geometry, *choice.view);
    // A volume of one cell has no level 1 that could be near.
    if (choice.curvature_tolerance && lattice.levels() > 1)
      oracles.back().flat =
          std::make_unique<FlatBlocks>(deviationOfSphere(*choice.curvature_tolerance));
  };
  add(query);
  for (const DetailChoice& choice : query.or_finer) add(choice);
  return oracles;
}

}  // namespace isobrick
