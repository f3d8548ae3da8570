// The files of a folder become slices by the numbers in their names.
#include "isobrick/preprocess/sources/slice_names.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <initializer_list>
#include <string>
#include <vector>

#include "tests/support/volume_files.h"

namespace isobrick::test {
namespace {

using Names = std::vector<std::string>;

class SliceNamesTest : public testing::Test {
 protected:
  // The names of the slices, or the error.
  Names slices(Names files, const OpenOptions& options = {}) {
    info_ = {};
    info_.source = "scan";
    std::sort(files.begin(), files.end(), numericNameLess);
    try {
      return chooseSlices(files, options, info_);
    } catch (const Error& error) {
      return {error.what()};
    }
  }
  void expectError(const Names& files, const std::string& part) {
    const Names result = slices(files);
    ASSERT_EQ(result.size(), 1u) << "no error";
    EXPECT_CONTAINS(result.front(), part);
  }
  VolumeInfo info_;
};

TEST_F(SliceNamesTest, NumbersCountSlices) {
  for (const Names& files :
       {Names{"img9.tif", "img10.tif", "img11.tif"},
        Names{"z-2.tif", "z-1.tif", "z+0.tif", "z+1.tif"}, Names{"z-2.tif", "z-1.tif", "z0.tif"},
        Names{"a-001.tif", "a-002.tif", "a-003.tif"}, Names{"2024-01-02-1.tif", "2024-01-02-2.tif"},
        Names{"REC0000.TIF", "REC0010.TIF"},
        Names{"scan2_0_of_3.tif", "scan2_1_of_3.tif", "scan2_2_of_3.tif"},
        Names{"t1_101502_z1.tif", "t1_101517_z2.tif", "t1_101539_z3.tif"},
        Names{"bottom.tif", "middle.tif", "top.tif"}, Names{"c0001.tif", "c0002.tif"},
        Names{"1.2.840.99999999999999999999.1.tif", "1.2.840.99999999999999999999.2.tif"}}) {
    EXPECT_EQ(slices(files), files);
    EXPECT_TRUE(info_.notes.empty());
  }
}

TEST_F(SliceNamesTest, GapsAreRefused) {
  expectError({"a0.tif", "a1.tif", "a2.tif", "a4.tif", "a5.tif"}, "between 'a2.tif' and 'a4.tif'");
  expectError({"a1.tif", "a01.tif", "a2.tif"}, "have the same number");
  expectError({"z0_ch0.tif", "z0_ch1.tif", "z1_ch0.tif"}, "have gaps: 3 files");
  expectError({"z0_ch0.tif", "z0_ch1.tif", "z2_ch0.tif", "z2_ch1.tif", "z3_ch0.tif", "z3_ch1.tif"},
              "between 'z0_ch0.tif' and 'z2_ch0.tif'");
}

TEST_F(SliceNamesTest, OddOnesAreLeftOutIfTheyAreFew) {
  const Names six{"rec0.tif", "rec1.tif", "rec2.tif", "rec3.tif", "rec4.tif", "rec5.tif"};
  Names files = six;
  files.push_back("rec_spr.tif");
  EXPECT_EQ(slices(files), six);
  ASSERT_EQ(info_.notes.size(), 1u);
  EXPECT_CONTAINS(info_.notes.front(), "'rec_spr.tif'");
  files.push_back("overview1.tif");
  expectError(files, "it has 'overview1.tif', 'rec_spr.tif'");
  expectError({"a1.tif", "a2.tif", "b1.tif", "b2.tif"}, "and 1 more like it");
}

TEST_F(SliceNamesTest, ChannelsAndTimesAreChosen) {
  Names files;
  for (const char* const time : {"_t1", "_t2"})
    for (const char* const z : {"_z007", "_z008", "_z009"})
      for (const char* const channel : {"_ch00", "_ch01"})
        files.push_back(std::string("x") + time + z + channel + ".tif");
  EXPECT_EQ(slices(files),
            (Names{"x_t1_z007_ch00.tif", "x_t1_z008_ch00.tif", "x_t1_z009_ch00.tif"}));
  ASSERT_EQ(info_.notes.size(), 2u);
  EXPECT_CONTAINS(info_.notes.front(), "of 2 channels, the first was taken");
  OpenOptions options;
  options.channel = 1;
  options.time = 1;
  EXPECT_EQ(slices(files, options),
            (Names{"x_t2_z007_ch01.tif", "x_t2_z008_ch01.tif", "x_t2_z009_ch01.tif"}));
  EXPECT_EQ(info_.encoding, "channel 1; time step 1");
  options.channel = 2;
  EXPECT_CONTAINS(slices(files, options).front(), "has the channels 0 to 1, and not 2");
  options.time.reset();
  EXPECT_CONTAINS(slices({"a1.tif", "a2.tif"}, options).front(), "channels 0 to 0, and not 2");
  expectError({"a1_1.tif", "a1_2.tif", "a2_1.tif", "a2_2.tif"}, "do not say which of them");
  expectError({"a_ch00.tif", "a_ch01.tif"}, "are channels of one slice");
  expectError({"t0_c0.tif", "t0_c1.tif", "t1_c0.tif", "t1_c1.tif"}, "do not say which of them");
}

}  // namespace
}  // namespace isobrick::test
