// A choice among pieces, and measures of pieces, in a view.
#include <gtest/gtest.h>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/state/measurement.h"
#include "isobrick/viewer/state/view_file.h"
#include "isobrick/viewer/state/view_state.h"

namespace isobrick {
namespace {

TEST(ViewPiecesTest, OneIsKeptOrSomeAreHidden) {
  PieceChoice choice;
  EXPECT_TRUE(hide({{1, 2, 3}, 10}, choice));
  EXPECT_TRUE(hide({{4, 5, 6}, 20}, choice));
  EXPECT_EQ(choice.hide.size(), 2u);
  keepOnly({{7, 8, 9}, 30}, choice);
  EXPECT_EQ(choice, (PieceChoice{{{{7, 8, 9}, 30}}, {}, 0}));
  // The only one that is kept is hidden: the others come back.
  EXPECT_TRUE(hide({{7, 8, 9}, 30}, choice));
  EXPECT_EQ(choice, (PieceChoice{{}, {{{7, 8, 9}, 30}}, 0}));
  while (choice.hide.size() < kMostSeeds) EXPECT_TRUE(hide({{1, 2, 3}, 1}, choice));
  EXPECT_FALSE(hide({{1, 2, 3}, 1}, choice));
  EXPECT_EQ(choice.hide.size(), kMostSeeds);
}

TEST(ViewPiecesTest, AreAPartOfTheSavedView) {
  ViewState state;
  state.surfaces[0].pieces = {{{{1.5, 2, 3}, 10}}, {{{4, 5, 6}, 0.1}}, 7.25};
  state.piece_measures = {{300, 1, 12.5, -3.25, {1, 2, 3}, {4, 5, 6}, {2, 3, 4}, {1, 3, 5}},
                          {300, 0, 12.5, {}, {1, 2, 3}, {4, 5, 6}, {2, 3, 4}, {1, 3, 5}}};
  EXPECT_EQ(viewStateFromJson(viewStateToJson(state)), state);
  ViewState other = state;
  other.surfaces[0].pieces.keep[0].point.x = 9;
  EXPECT_NE(wishOf(state, ViewVolume(), 100.0), wishOf(other, ViewVolume(), 100.0));
}

TEST(ViewPiecesTest, HostileViewsAreRefused) {
  const auto surface = [](const std::string& pieces) {
    return R"({"surfaces": [{"isovalue": 1, "pieces": )" + pieces + "}]}";
  };
  const std::string seed = R"({"point": [1, 2, 3], "area": 4})";
  EXPECT_NO_THROW(viewStateFromJson(surface(R"({"keep": [)" + seed + "]}")));
  std::string many = seed;
  for (std::size_t i = 0; i < kMostSeeds; ++i) many += "," + seed;
  for (const std::string& pieces :
       {R"({"keep": [)" + many + "]}", R"({"hide": [)" + many + "]}", std::string("[]"),
        std::string(R"({"least_area": -1})"), std::string(R"({"least_area": "all"})"),
        std::string(R"({"keep": [{"point": [1, 2], "area": 4}]})"),
        std::string(R"({"keep": [{"point": [1, 2, 1e300], "area": 4}]})"),
        std::string(R"({"hide": [{"point": [1, 2, 3], "area": -4}]})")})
    EXPECT_THROW(viewStateFromJson(surface(pieces)), Error) << pieces;
}

TEST(ViewPiecesTest, TheTableHasAreaVolumeAndExtent) {
  const std::vector<ViewPieceMeasure> pieces{
      {300, 0, 12.5, 3.25, {1, 2, 3}, {4, 6, 8}, {2, 3, 4}, {1, 3, 5}},
      {300, 0, 2.5, {}, {0, 0, 0}, {1, 1, 1}, {0, 0, 0}, {0, 0, 0}}};
  const std::string at = ",2,3,4,1,2,3,4,6,8\n", other = ",0,0,0,0,0,0,1,1,1\n";
  EXPECT_EQ(pieceMeasuresCsv(pieces, 3, LengthUnit::kMillimetre),
            "3,piece_area,12.5,mm2" + at + "3,piece_volume,3.25,mm3" + at +
                "3,piece_extent_x,3,mm" + at + "3,piece_extent_y,4,mm" + at +
                "3,piece_extent_z,5,mm" + at + "4,piece_area,2.5,mm2" + other +
                "4,piece_volume,,mm3" + other + "4,piece_extent_x,1,mm" + other +
                "4,piece_extent_y,1,mm" + other + "4,piece_extent_z,1,mm" + other);
  EXPECT_EQ(pieceText(pieces[0], LengthUnit::kMillimetre), "12.5 mm\u00b2, 3.25 mm\u00b3");
  EXPECT_EQ(pieceText(pieces[1], LengthUnit::kUnknown), "2.5");
}

}  // namespace
}  // namespace isobrick
