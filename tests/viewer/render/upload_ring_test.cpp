// The ring's places, with fences that pass when a test says so.
#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "isobrick/viewer/render/gl_chunks.h"
#include "tests/support/random_numbers.h"

namespace isobrick {
namespace {

// A fence that the test holds.
struct Gate {
  bool passed = false;
  int asked_when_passed = 0;
};
UploadRing::Fence fenceOf(const std::shared_ptr<Gate>& gate) {
  return [gate] {
    gate->asked_when_passed += gate->passed;
    return gate->passed;
  };
}

TEST(UploadRingTest, WhatTheCardStillReadsIsNotGivenAgain) {
  UploadRing ring(1024);
  const auto first = std::make_shared<Gate>(), second = std::make_shared<Gate>();
  EXPECT_FALSE(ring.isOpen());
  EXPECT_EQ(ring.take(400), 0u);
  EXPECT_TRUE(ring.isOpen());
  ring.close(fenceOf(first));
  EXPECT_FALSE(ring.isOpen());
  EXPECT_EQ(ring.take(500), 400u);
  EXPECT_FALSE(ring.take(200));  // in one run: not 112 at the end and 88 at the beginning
  ring.close(fenceOf(second));
  EXPECT_EQ(ring.take(100), 912u);
  EXPECT_FALSE(ring.take(1));
  second->passed = true;  // what comes later does not free what is before it
  EXPECT_FALSE(ring.take(300));
  first->passed = true;
  EXPECT_EQ(ring.take(300), 0u);
  EXPECT_EQ(first->asked_when_passed, 1);
  EXPECT_EQ(second->asked_when_passed, 1);
}

TEST(UploadRingTest, AnEmptyRingTakesAsMuchAsItHas) {
  UploadRing ring(1024);
  const auto gate = std::make_shared<Gate>();
  EXPECT_EQ(ring.take(1000), 0u);
  EXPECT_FALSE(ring.take(1024));  // nobody was told to read yet
  ring.close(fenceOf(gate));
  EXPECT_FALSE(ring.take(1024));
  gate->passed = true;
  EXPECT_EQ(ring.take(1024), 0u);
  ring.close(fenceOf(gate));
  ring.close(fenceOf(gate));  // nothing was taken since
  EXPECT_EQ(ring.take(16), 0u);
}

// Whatever is taken, and whenever the card is done: places in flight never overlap, and everything
// finds a place in the end.
TEST(UploadRingTest, PlacesInFlightNeverOverlap) {
  constexpr std::size_t kBytes = 4096;
  test::Random random(5);
  UploadRing ring(kBytes);
  struct Frame {
    std::shared_ptr<Gate> gate = std::make_shared<Gate>();
    std::vector<std::pair<std::size_t, std::size_t>> places;  // begin, end
  };
  std::vector<Frame> flying(1);  // the last one is being filled
  int refused = 0;
  for (int i = 0; i < 5000; ++i) {
    const auto draw = [&](std::size_t below) { return static_cast<std::size_t>(random() % below); };
    const std::size_t bytes = 1 + draw(draw(20) == 0 ? kBytes : 600);
    std::optional<std::size_t> place;
    while (!(place = ring.take(bytes))) {
      ++refused;
      ring.close(fenceOf(flying.back().gate));
      flying.emplace_back();
      flying.front().gate->passed = true;
      flying.erase(flying.begin());
    }
    ASSERT_LE(*place + bytes, kBytes);
    ASSERT_EQ(*place % 16, 0u);
    for (const Frame& frame : flying)
      for (const auto& [begin, end] : frame.places)
        ASSERT_TRUE(*place + bytes <= begin || end <= *place);
    flying.back().places.emplace_back(*place, *place + bytes);
    if (draw(5) == 0) {
      ring.close(fenceOf(flying.back().gate));
      flying.emplace_back();
    }
    if (draw(4) == 0 && flying.size() > 1) {
      flying.front().gate->passed = true;
      flying.erase(flying.begin());
    }
  }
  EXPECT_GT(refused, 100);
}

}  // namespace
}  // namespace isobrick
