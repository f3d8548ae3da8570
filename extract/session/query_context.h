// What the workers of one query share, and the report of their work.
#pragma once

#include <vector>

#include "isobrick/extract/query.h"
#include "isobrick/extract/session/mesh_context.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// Throws Error if a number is not finite or out of its range, if parts of the query exclude each
// other, and if the pyramid lacks what the query needs.
void checkQuery(const Pyramid& pyramid, const Query& query);

// The inputs of the workers of one query.
class QueryContext {
 public:
  // All outlive it; `residency` is that of a progressive query. Clears `log`.
  QueryContext(const Pyramid& pyramid, const Query& query, ReadLog& log,
               ResidencyOracle* residency = nullptr)
      : oracles_(oraclesOf(pyramid, query)),
        frame_(pyramid.spec().geometry, pyramid.valueRange(), query.inside),
        context_{pyramid,
                 query,
                 oracles_,
                 frame_,
                 pyramid.storedIsovalue(query.isovalue),
                 log,
                 pyramid.parts().edition(),
                 residency} {
    log.clear();
  }
  QueryContext(const QueryContext&) = delete;

  const MeshContext& operator*() const { return context_; }
  const MeshContext* operator->() const { return &context_; }

 private:
  const std::vector<ChoiceOracles> oracles_;
  const WorldFrame frame_;
  const MeshContext context_;
};

// Zero for each of the levels.
std::vector<LevelCounts> noCounts(int levels);

// Of the parts that `log` lists, and of what was counted.
ExtractionReport makeReport(const Pyramid& pyramid, const ReadLog& log,
                            const std::vector<LevelCounts>& levels);

}  // namespace isobrick
