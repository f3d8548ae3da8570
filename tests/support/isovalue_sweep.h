// A sweep over isovalues, as a viewer makes it: what it takes, and what the pager reads for it.
#pragma once

#include <tbb/global_control.h>

#include <cstdint>
#include <string>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/vertex_numbering.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/storage/pyramid_parts.h"
#include "tests/support/replacement.h"

namespace isobrick::test {

struct IsovalueSweep {
  double first = 0, last = 0;
  int count = 20;

  Query query(int n) const {
    Query query;
    query.isovalue = first + (last - first) * n / (count - 1);
    return query;
  }
};

// For a pyramid without packed parts: each costs the bytes that it has in the file.
inline TakeTrace traceOf(const std::string& path, const IsovalueSweep& sweep) {
  const Pyramid pyramid(path);
  const Extractor extractor(pyramid);
  TakeTrace trace;
  std::vector<std::uint8_t> crossed;
  for (int n = 0; n < sweep.count; ++n) {
    const ExtractionPlan plan = extractor.plan(sweep.query(n));
    std::vector<Take>& takes = trace.emplace_back();
    for (const BrickWork& work : plan.bricks()) {
      const std::uint64_t id = 2 * pyramid.parts().brickRow(work.level, work.brick);
      const std::uint64_t range_bytes =
          pyramid.parts().storedBytes(PartKind::kRanges, work.level, work.brick);
      if (range_bytes == 0) continue;
      takes.push_back({id, range_bytes});
      pyramid.parts().crossedTiles(work.level, work.brick,
                                   static_cast<float>(plan.query().isovalue), crossed);
      bool is_crossed = false;
      for (const std::uint8_t tile : crossed) is_crossed = is_crossed || tile != 0;
      if (is_crossed)
        takes.push_back(
            {id + 1, pyramid.parts().storedBytes(PartKind::kSamples, work.level, work.brick)});
    }
  }
  return trace;
}

// Bytes that the pager reads where the parts of the trace are taken one after the other, and none
// ahead of need: the same each time.
inline std::uint64_t bytesReadByPager(const std::string& path, const TakeTrace& trace,
                                      std::uint64_t budget_bytes) {
  const Pyramid pyramid(path, budget_bytes);
  std::vector<ValueRange> ranges;
  for (const std::vector<Take>& query : trace) {
    pyramid.parts().beginQuery();
    for (const Take& take : query) {
      const auto [level, brick] = pyramid.parts().brickAt(take.id / 2);
      if (take.id % 2 == 0)
        pyramid.tileRanges(level, brick, ranges);
      else
        pyramid.samples(level, brick);
    }
  }
  return pyramid.parts().counters().bytes_read;
}

// Bytes that it reads for the sweep's queries, ahead of need too: in an order that the threads'
// luck decides a little.
inline std::uint64_t bytesReadByQueries(const std::string& path, const IsovalueSweep& sweep,
                                        std::uint64_t budget_bytes) {
  const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
  const Pyramid pyramid(path, budget_bytes);
  Extractor extractor(pyramid);
  for (int n = 0; n < sweep.count; ++n) {
    CountingSink sink;
    extractor.extract(sweep.query(n), sink);
  }
  return pyramid.parts().counters().bytes_read;
}

}  // namespace isobrick::test
