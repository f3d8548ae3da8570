// Which of a machine's displays draws, and how a user chooses another one.
#include <gtest/gtest.h>

#include <cstdlib>
#include <string>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/egl_context.h"
#include "tests/support/requirement.h"

namespace isobrick {
namespace {

std::vector<std::string> namesOf(const std::vector<EglPlace>& places) {
  std::vector<std::string> names;
  for (const EglPlace& place : places) names.push_back(place.name);
  return names;
}

// A server with two cards, whose driver lists the one in software first.
std::vector<EglPlace> serverPlaces() {
  return inOrderOfTrial({{"device:0", "software", true, EGL_NO_DEVICE_EXT},
                         {"device:1", "/dev/dri/card0", false, EGL_NO_DEVICE_EXT},
                         {"device:2", "/dev/dri/card1", false, EGL_NO_DEVICE_EXT}},
                        true);
}

TEST(EglPlacesTest, CardsComeFirstAndSoftwareLast) {
  EXPECT_EQ(
      namesOf(serverPlaces()),
      (std::vector<std::string>{"device:1", "device:2", "surfaceless", "display", "device:0"}));
  EXPECT_EQ(namesOf(inOrderOfTrial({}, false)), std::vector<std::string>{"display"});
}

TEST(EglPlacesTest, AUserChoosesAnotherOne) {
  const std::vector<EglPlace> places = serverPlaces();
  EXPECT_EQ(chosenPlaces(places, ""), places);
  EXPECT_EQ(namesOf(chosenPlaces(places, "device:2")), std::vector<std::string>{"device:2"});
  EXPECT_EQ(namesOf(chosenPlaces(places, "software")), std::vector<std::string>{"device:0"});
  try {
    chosenPlaces(places, "device:3");
    FAIL() << "there is no such device";
  } catch (const Error& error) {
    const std::string text = error.what();
    EXPECT_NE(text.find("ISOBRICK_GRAPHICS is 'device:3'"), std::string::npos) << text;
    EXPECT_NE(text.find("software, device:1, device:2, surfaceless, display, device:0"),
              std::string::npos)
        << text;
  }
}

// The environment as it was, at the end.
class ChosenPlace {
 public:
  explicit ChosenPlace(const std::string& name) {
    if (const char* const before = std::getenv(kVariable)) before_ = before;
    setenv(kVariable, name.c_str(), 1);
  }
  ~ChosenPlace() {
    if (before_.empty())
      unsetenv(kVariable);
    else
      setenv(kVariable, before_.c_str(), 1);
  }

 private:
  static constexpr char kVariable[] = "ISOBRICK_GRAPHICS";
  std::string before_;
};

// The first one that opens is taken, and each of those that open can be asked for.
TEST(EglPlacesTest, AContextIsMadeWhereItIsWanted) {
  std::string first;
  try {
    first = EglContext().placeName();
  } catch (const Error& error) {
    SKIP_UNLESS_REQUIRED(error.what());
  }
  const std::vector<EglPlace> places = eglPlaces();
  bool has_opened = false;
  int devices = 0;
  for (const EglPlace& place : places) {
    const ChosenPlace chosen(place.name);
    try {
      const EglContext context;
      EXPECT_EQ(context.placeName(), place.name);
      if (!has_opened) {
        EXPECT_EQ(first, place.name);
      }
      has_opened = true;
      if (place.device != EGL_NO_DEVICE_EXT) ++devices;
    } catch (const Error&) {
    }
  }
  EXPECT_TRUE(has_opened);
  if (devices == 0) SKIP_UNLESS_REQUIRED("EGL has no device that opens");
  const ChosenPlace nowhere("device:999");
  EXPECT_THROW(EglContext(), Error);
}

}  // namespace
}  // namespace isobrick
