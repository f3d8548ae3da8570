// A sweep over isovalues of a real scan, at half of what it takes.
#include <gtest/gtest.h>

#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "tests/support/isovalue_sweep.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/test_paths.h"

namespace isobrick::test {
namespace {

// Properties in --gtest_output=json:FILE have the figures.
TEST(RealSweep, ReadsLittleMoreThanTheOptimumAtHalfTheWorkingSet) {
  const TemporaryFolder folder;
  const std::string path = folder.file("head.isb");
  BuildOptions options;
  options.codec = format::Codec::kStored;
  buildPyramid(*openVolume(sharedData() + "/vhf_head_ct/vhf_head.nrrd"), path, options);
  const IsovalueSweep sweep{300, 2000};
  const TakeTrace trace = traceOf(path, sweep);
  const std::uint64_t all = workingSetBytes(trace);
  const std::uint64_t optimum = bytesReadByBelady(trace, all / 2);
  const std::uint64_t read = bytesReadByPager(path, trace, all / 2);
  const std::uint64_t lru = bytesReadByLru(trace, all / 2);
  const std::uint64_t queries = bytesReadByQueries(path, sweep, all / 2);
  RecordProperty("working_set", std::to_string(all));
  RecordProperty("optimum", std::to_string(optimum));
  RecordProperty("policy", std::to_string(bytesReadByPolicy(trace, all / 2)));
  RecordProperty("pager", std::to_string(read));
  RecordProperty("queries", std::to_string(queries));
  RecordProperty("lru", std::to_string(lru));
  EXPECT_LE(static_cast<double>(read), 1.3 * static_cast<double>(optimum));
  EXPECT_LE(static_cast<double>(queries), 1.3 * static_cast<double>(optimum));
  EXPECT_LT(read, lru);
}

}  // namespace
}  // namespace isobrick::test
