// The driver that draws: it is the one that was asked for, complains of nothing, and one that is
// too old is refused in a line.
#include <epoxy/gl.h>

#include <cstdlib>
#include <memory>
#include <string>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/egl_context.h"
#include "isobrick/viewer/render/gl_scene_renderer.h"
#include "tests/support/command_test.h"
#include "tests/support/driver_complaints.h"
#include "tests/support/requirement.h"

namespace isobrick {
namespace {

using namespace test;

class Driver : public CommandTest {
 protected:
  // Mesa's rasteriser in software of this name, for the program `isobrick` alone.
  Outcome runBy(const std::string& driver, const Words& words) {
    Words all{"/usr/bin/env",
              "-u",
              "MESA_LOADER_DRIVER_OVERRIDE",
              "-u",
              "ISOBRICK_GRAPHICS",
              "LIBGL_ALWAYS_SOFTWARE=1",
              "GALLIUM_DRIVER=" + driver,
              isobrickCommand()};
    all.insert(all.end(), words.begin(), words.end());
    return wait(start(std::move(all)));
  }
  // Mesa's rasterisers in software may be lacking beside a card's driver.
  bool hasMesa() {
    return runBy("llvmpipe", {"info", "--graphics"}).out.find("llvmpipe") != std::string::npos;
  }
  static constexpr char kNoMesa[] = "Mesa's drivers in software are not here";
  // A context, or none and the test ended.
  std::unique_ptr<EglContext> context() {
    try {
      return std::make_unique<EglContext>();
    } catch (const Error& error) {
      why_not_ = error.what();
      return nullptr;
    }
  }
  std::string why_not_;
};

// ISOBRICK_NAMED_DRIVER: a part of its name, of the tests that ask for one (tests/CMakeLists.txt).
TEST_F(Driver, IsTheOneThatIsNamed) {
  const auto egl = context();
  if (!egl) SKIP_UNLESS_REQUIRED(why_not_);
  const EglContext::CurrentScope current(*egl);
  const GlSceneRenderer renderer;
  const char* const wanted = std::getenv("ISOBRICK_NAMED_DRIVER");
  EXPECT_NE(renderer.deviceName().find(wanted == nullptr ? "" : wanted), std::string::npos)
      << renderer.deviceName();
  EXPECT_FALSE(renderer.deviceName().empty());
}

// An error of a call reaches the test that made it.
TEST_F(Driver, ComplaintsAreHeard) {
  const auto egl = context();
  if (!egl) SKIP_UNLESS_REQUIRED(why_not_);
  const EglContext::CurrentScope current(*egl);
  GlSceneRenderer renderer;
  const ExpectedComplaints complaints;
  EXPECT_TRUE(complaints.heard().empty());
  glEnable(GL_TRIANGLES);  // no capability
  ASSERT_EQ(complaints.heard().size(), 1u);
  EXPECT_EQ(complaints.heard()[0].find("error, high: "), 0u) << complaints.heard()[0];
}

// Every size has memory of its own.
TEST_F(Driver, FramesChangeTheirSize) {
  const auto egl = context();
  if (!egl) SKIP_UNLESS_REQUIRED(why_not_);
  const EglContext::CurrentScope current(*egl);
  GlSceneRenderer renderer;
  SceneFrame frame;
  frame.bounds = {glm::dvec3(-1.0), glm::dvec3(1.0)};
  frame.camera.eye = {0.0, -10.0, 0.0};
  frame.sphere = SphereOutline{{0.0, 0.0, 0.0}, 1.0};
  frame.ambient_occlusion = frame.shadow = true;
  for (const auto& [width, height] : {std::pair(1, 1), std::pair(640, 400), std::pair(3, 700),
                                      std::pair(1000, 2), std::pair(640, 400)}) {
    frame.width = width;
    frame.height = height;
    ASSERT_NO_THROW(renderer.draw(frame));
    const Image picture = renderer.picture();
    EXPECT_EQ(picture.width, width);
    EXPECT_EQ(picture.height, height);
    EXPECT_GT(picture.rgb[0], 0.0f);
  }
}

TEST_F(Driver, SoftpipeIsRefusedInOneLine) {
  if (!hasMesa()) SKIP_UNLESS_REQUIRED(kNoMesa);
  for (const Words& words : {Words{"render", "phantom:sphere:16", "--iso", "100", "-o", "x.png"},
                             Words{"info", "--graphics"}}) {
    const Outcome outcome = runBy("softpipe", words);
    EXPECT_EQ(outcome.status, 1);
    EXPECT_EQ(outcome.errorLines(), 1) << outcome.err;
    EXPECT_NE(outcome.err.find("OpenGL 4.5 is needed, and softpipe has 3.3"), std::string::npos)
        << outcome.err;
  }
}

TEST_F(Driver, LlvmpipeDrawsThePicturesOfTheCommandAndComplainsOfNothing) {
  if (!hasMesa()) SKIP_UNLESS_REQUIRED(kNoMesa);
  setenv("ISOBRICK_GL_DEBUG", "1", 1);
  const Outcome outcome = runBy("llvmpipe", {"render", "phantom:sphere:32", "--iso", "100",
                                             "--shadow", "--ambient-occlusion", "-o", "x.png"});
  unsetenv("ISOBRICK_GL_DEBUG");
  EXPECT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_NE(outcome.out.find("llvmpipe"), std::string::npos) << outcome.out;
  EXPECT_EQ(outcome.err.find("the OpenGL driver says"), std::string::npos) << outcome.err;
}

TEST_F(Driver, InfoSaysWhatDraws) {
  if (!hasMesa()) SKIP_UNLESS_REQUIRED(kNoMesa);
  const Outcome text = runBy("llvmpipe", {"info", "--graphics"});
  ASSERT_EQ(text.status, 0) << text.err;
  for (const char* part : {"device   llvmpipe", "(the processor draws)", "GL_MAX_TEXTURE_SIZE",
                           "GL_MAX_SAMPLES", "ISOBRICK_GRAPHICS"})
    EXPECT_NE(text.out.find(part), std::string::npos) << part << "\n" << text.out;
  const Outcome outcome = runBy("llvmpipe", {"info", "--graphics", "--json"});
  const Json json = Json::parse(outcome.out);
  EXPECT_EQ(json["software"], true);
  EXPECT_GE(json["limits"]["GL_MAX_TEXTURE_SIZE"]["value"].get<int>(), 4096);
  bool is_listed = false;
  for (const Json& place : json["places"]) is_listed = is_listed || place["name"] == json["place"];
  EXPECT_TRUE(is_listed) << json.dump();
  // A FILE's facts are another thing.
  EXPECT_EQ(run({"info", "--graphics", "x.isb"}).status, 2);
  EXPECT_EQ(run({"info"}).status, 2);
}

}  // namespace
}  // namespace isobrick
