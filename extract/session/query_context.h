// What the workers of one query share, and the report of their work.
#pragma once

#include <memory>
#include <vector>

#include "isobrick/extract/query.h"
#include "isobrick/extract/region/region_field.h"
#include "isobrick/extract/region/region_solid.h"
#include "isobrick/extract/session/mesh_context.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// Throws Error if a number is not finite or out of its range, if parts of the query exclude each
// other, and if the pyramid lacks what the query needs. QueryContext checks the region.
void checkQuery(const Pyramid& pyramid, const Query& query);

// The inputs of the workers of one query. Their pyramid is that of the object within the region, if
// it is to be capped.
class QueryContext {
 public:
  // All outlive it; `residency` is that of a progressive query. Clears `log`.
  QueryContext(const Pyramid& pyramid, const Query& query, ReadLog& log,
               ResidencyOracle* residency = nullptr)
      : region_(query.region.isEverywhere()
                    ? nullptr
                    : std::make_unique<const RegionField>(query.region, pyramid)),
        solid_(region_ != nullptr && query.cap ? solidPyramid(pyramid, *region_, query) : nullptr),
        pyramid_(solid_ != nullptr ? *solid_ : pyramid),
        oracles_(oraclesOf(pyramid_, query)),
        frame_(pyramid_.spec().geometry, pyramid_.valueRange(), query.inside),
        context_{pyramid_,
                 query,
                 oracles_,
                 frame_,
                 pyramid_.storedIsovalue(query.isovalue),
                 log,
                 pyramid_.parts().edition(),
                 residency,
                 region_.get()} {
    log.clear();
  }
  QueryContext(const QueryContext&) = delete;

  const MeshContext& operator*() const { return context_; }
  const MeshContext* operator->() const { return &context_; }

 private:
  const std::unique_ptr<const RegionField> region_;
  const std::unique_ptr<const Pyramid> solid_;
  const Pyramid& pyramid_;
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
