// Thousands of random events in the loop of the window, without a display: nothing is thrown, the
// view stays in its bounds, quiet ends in rest, and Home brings the surface back, whatever came
// before.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <filesystem>
#include <fstream>
#include <glm/geometric.hpp>
#include <thread>

#include "isobrick/viewer/stream/latest_worker.h"
#include "isobrick/viewer/window/gl_target.h"
#include "isobrick/viewer/window/view_loop.h"
#include "tests/support/driver_faults.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/random_numbers.h"
#include "tests/support/requirement.h"

namespace isobrick {
namespace {

using Kind = InputEvent::Kind;
using test::randomBelow;
using test::randomInt;
using test::randomReal;

constexpr int kLeastSide = 90, kMostWidth = 720, kMostHeight = 480;
constexpr double kPatience = 120.0;  // seconds, for rest

bool isFinite(const glm::dvec3& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

// Empty, or what is out of bounds.
std::string faultOf(const ViewState& state, const ViewVolume& volume) {
  const ViewState tame = bounded(state, volume);
  if (tame.focus != state.focus || wishOf(tame, volume, 100.0) != wishOf(state, volume, 100.0))
    return "the view asks for what is out of bounds";
  const ViewCamera& camera = state.camera;
  if (!isFinite(camera.pivot) || !std::isfinite(camera.azimuth) ||
      camera.elevation != tame.camera.elevation || camera.distance != tame.camera.distance ||
      camera.vertical_fov != tame.camera.vertical_fov)
    return "the camera is out of bounds";
  if (state.surfaces.empty() || state.active_surface != tame.active_surface)
    return "there is no active surface";
  if (state.clip_planes.size() > kMostClipPlanes) return "there are too many clip planes";
  for (const ViewClipPlane& plane : state.clip_planes)
    if (!(std::abs(glm::length(plane.normal) - 1.0) < 1e-9) || !std::isfinite(plane.offset))
      return "a clip plane is none";
  for (std::size_t axis = 0; axis < 3; ++axis)
    if (state.slices[axis].position != tame.slices[axis].position) return "a slice is outside";
  if (state.measurements.size() > kMostMeasurements) return "there are too many measurements";
  return {};
}

// A hand on mouse and keyboard that knows nothing, and one that tidies up after it.
class Hand {
 public:
  Hand(std::uint64_t seed, std::vector<std::string> paths)
      : random_(seed), paths_(std::move(paths)) {}

  InputEvent next() {
    if (!gesture_.empty()) {
      const InputEvent event = gesture_.front();
      gesture_.pop_front();
      return event;
    }
    if (randomBelow(random_, 12) == 0) clickPanel();
    if (randomBelow(random_, 40) == 0) useTool();
    InputEvent event;
    event.shift = randomBelow(random_, 5) == 0;
    event.control = randomBelow(random_, 5) == 0;
    switch (randomBelow(random_, 16)) {
      case 0:
      case 1:
      case 2:
        return button(event);
      case 3:
      case 4:
      case 5:
        return key(event);
      case 6:
        event.kind = Kind::kWheel;
        event.amount =
            randomReal(random_, -3.0, 3.0) * (randomBelow(random_, 10) == 0 ? 50.0 : 1.0);
        event.across = randomReal(random_, -1.0, 1.0);
        return event;
      case 7:
        event.kind = Kind::kText;
        event.character =
            static_cast<unsigned>(randomBelow(random_, 8) == 0 ? randomBelow(random_, 0x11000)
                                                               : randomInt(random_, 32, 126));
        return event;
      case 8:
        return randomBelow(random_, 4) == 0 ? drop(event) : move(event);
      default:
        return move(event);
    }
  }
  // Everything that is held is let go.
  std::vector<InputEvent> letGo() {
    std::vector<InputEvent> events;
    InputEvent event;
    event.kind = Kind::kRelease;
    for (const MouseButton button :
         {MouseButton::kLeft, MouseButton::kMiddle, MouseButton::kRight}) {
      event.button = button;
      events.push_back(event);
    }
    event.kind = Kind::kKeyRelease;
    for (std::size_t i = 1; i < kKeyCount; ++i) {
      event.key = static_cast<Key>(i);
      events.push_back(event);
    }
    return events;
  }
  test::Random& random() { return random_; }

 private:
  InputEvent move(InputEvent event) {
    event.kind = Kind::kMove;
    const bool is_far = randomBelow(random_, 20) == 0;
    x_ = is_far ? randomReal(random_, -500.0, 3000.0)
                : std::clamp(x_ + randomReal(random_, -90.0, 90.0), 0.0, 1.0 * kMostWidth);
    y_ = is_far ? randomReal(random_, -500.0, 3000.0)
                : std::clamp(y_ + randomReal(random_, -60.0, 60.0), 0.0, 1.0 * kMostHeight);
    event.x = x_;
    event.y = y_;
    return event;
  }
  // A click on a control, often with Ctrl, which makes a field of a slider, and a number typed.
  void clickPanel() {
    InputEvent event;
    x_ = event.x = randomReal(random_, 0.0, 340.0);
    y_ = event.y = randomReal(random_, 0.0, 1.0 * kMostHeight);
    gesture_.push_back(event);
    event.control = randomBelow(random_, 2) == 0;
    for (const Kind kind : {Kind::kPress, Kind::kRelease}) {
      event.kind = kind;
      gesture_.push_back(event);
    }
    event.control = false;
    event.kind = Kind::kText;
    for (std::uint64_t i = randomBelow(random_, 5); i > 0; --i) {
      event.character = static_cast<unsigned>("0123456789-.e"[randomBelow(random_, 13)]);
      gesture_.push_back(event);
    }
    event.key = Key::kEnter;
    for (const Kind kind : {Kind::kKeyPress, Kind::kKeyRelease}) {
      event.kind = kind;
      gesture_.push_back(event);
    }
  }
  // A measurement, or a piece that is picked, near the middle of the scene.
  void useTool() {
    constexpr Key kTools[] = {Key::kD, Key::kA, Key::kK};
    InputEvent event;
    event.kind = Kind::kKeyPress;
    event.key = kTools[randomBelow(random_, 3)];
    gesture_.push_back(event);
    for (int i = 0; i < 3; ++i) {
      event.kind = Kind::kMove;
      x_ = event.x = randomReal(random_, 200.0, 500.0);
      y_ = event.y = randomReal(random_, 80.0, 300.0);
      gesture_.push_back(event);
      for (const Kind kind : {Kind::kPress, Kind::kRelease}) {
        event.kind = kind;
        gesture_.push_back(event);
      }
    }
    event.kind = Kind::kKeyPress;
    event.key = randomBelow(random_, 2) == 0 ? Key::kEnter : Key::kDelete;
    gesture_.push_back(event);
  }
  InputEvent button(InputEvent event) {
    event.kind = randomBelow(random_, 2) == 0 ? Kind::kPress : Kind::kRelease;
    event.button = static_cast<MouseButton>(randomBelow(random_, 4) % 3);
    event.clicks = static_cast<int>(randomInt(random_, 0, 2));
    return event;
  }
  InputEvent key(InputEvent event) {
    event.kind = randomBelow(random_, 2) == 0 ? Kind::kKeyPress : Kind::kKeyRelease;
    event.key = static_cast<Key>(1 + randomBelow(random_, kKeyCount - 1));
    event.repeated = randomBelow(random_, 6) == 0;
    return event;
  }
  InputEvent drop(InputEvent event) {
    event.kind = Kind::kOpen;
    event.path = paths_[randomBelow(random_, paths_.size())];
    return event;
  }

  test::Random random_;
  const std::vector<std::string> paths_;
  double x_ = 100.0, y_ = 100.0;
  std::deque<InputEvent> gesture_;  // the rest of it
};

// Random frames; now and then quiet, then Home, and the look for the surface.
class Play {
 public:
  Play(std::uint64_t seed, int events, std::vector<std::string> paths, test::DriverFaults& driver)
      : hand_(seed, std::move(paths)), driver_(driver), left_(events) {}

  int left() const { return left_; }
  int checks() const { return checks_; }

  // For a frame of `target`.
  std::vector<InputEvent> events(EglTarget& target) {
    target_ = &target;
    if (phase_ != Phase::kRandom) {
      // The loop sleeps when all is shown and nothing comes, however few frames that took.
      if (orders_.empty()) return {restingMove()};
      std::vector<InputEvent> events = std::move(orders_.front());
      orders_.pop_front();
      return events;
    }
    test::Random& random = hand_.random();
    if (randomBelow(random, 60) == 0) resize(target);
    if (randomBelow(random, 250) == 0) driver_.reset(static_cast<int>(randomInt(random, 1, 6)));
    if (randomBelow(random, 8) == 0)
      std::this_thread::sleep_for(std::chrono::milliseconds(randomInt(random, 1, 30)));
    std::vector<InputEvent> events;
    for (std::uint64_t i = randomBelow(random, 5); i > 0; --i) events.push_back(hand_.next());
    left_ -= static_cast<int>(events.size());
    in_round_ += static_cast<int>(events.size());
    if (in_round_ >= kRound || left_ <= 0) rest(target);
    return events;
  }

  void look(ViewSession* session, bool settled) {
    if (session != nullptr) {
      // A view that was read comes at the end of a frame, and into its bounds in the next one.
      const std::string fault = faultOf(session->state(), session->volume());
      if (!fault.empty() && !last_fault_.empty()) throw Error(fault);
      last_fault_ = fault;
    }
    if (session != nullptr && phase_ == Phase::kRandom && randomBelow(hand_.random(), 25) == 0)
      change(*session);
    if (phase_ == Phase::kRandom || !orders_.empty()) return;
    if (clockSeconds() - since_ > kPatience)
      throw Error(std::string("there is no rest: ") +
                  (session == nullptr ? "nothing is open" : session->status().doing));
    if (!settled || ++still_frames_ < 4) return;
    advance(session);
  }

 private:
  enum class Phase { kRandom, kQuiet, kHome, kClose };
  static constexpr int kRound = 400;

  void resize(EglTarget& target) {
    test::Random& random = hand_.random();
    if (randomBelow(random, 6) == 0)
      target.resize(0, 0);
    else
      target.resize(static_cast<int>(randomInt(random, kLeastSide, kMostWidth)),
                    static_cast<int>(randomInt(random, kLeastSide, kMostHeight)));
  }
  // As the folded parts of the panel do, which clicks hardly find.
  void change(ViewSession& session) {
    test::Random& random = hand_.random();
    ViewState& state = session.state();
    const auto axis = static_cast<std::size_t>(randomBelow(random, 3));
    switch (randomBelow(random, 9)) {
      case 0:
        state.slices[axis].shown = !state.slices[axis].shown;
        break;
      case 1:
        state.slices[axis].position = randomReal(random, -10.0, 60.0);
        break;
      case 2:
        state.coloring = static_cast<ViewColoring>(randomBelow(random, 6));
        break;
      case 3:
        state.view_pixels = randomBelow(random, 2) == 0
                                ? std::nullopt
                                : std::optional(randomReal(random, 0.0, 20.0));
        break;
      case 4:
        state.curvature_tolerance = randomReal(random, 0.0, 0.1);
        break;
      case 5:
        if (state.surfaces.size() < 4) state.surfaces.push_back(state.surfaces[0]);
        state.surfaces.back().opacity = randomReal(random, 0.0, 1.0);
        break;
      case 6:
        session.listPieces(std::nullopt);
        break;
      case 7:
        session.pieces().select(0);
        session.keepSelectedPiece();
        break;
      default:
        state.focus.everywhere = false;
        state.focus.radius = randomReal(random, -1.0, 100.0);
    }
  }
  void begin(Phase phase) {
    phase_ = phase;
    since_ = clockSeconds();
    still_frames_ = 0;
  }
  // To a corner of the window, where nothing is.
  static InputEvent restingMove() {
    InputEvent move;
    move.x = 599.0;
    move.y = 5.0;
    return move;
  }
  static InputEvent keyPress(Key key) {
    InputEvent event;
    event.kind = Kind::kKeyPress;
    event.key = key;
    return event;
  }
  void press(Key key) {
    InputEvent release = keyPress(key);
    release.kind = Kind::kKeyRelease;
    orders_.push_back({keyPress(key)});
    orders_.push_back({release});
  }
  // The hand goes; a dialog, a tool, a flight and a field of text end.
  void rest(EglTarget& target) {
    begin(Phase::kQuiet);
    in_round_ = 0;
    target.resize(600, 400);
    for (const InputEvent& event : hand_.letGo()) orders_.push_back({event});
    orders_.push_back({restingMove()});
    for (int i = 0; i < 4; ++i) press(Key::kEscape);
  }
  void advance(ViewSession* session) {
    if (phase_ == Phase::kQuiet) {
      begin(Phase::kHome);
      press(Key::kHome);
    } else if (phase_ == Phase::kHome) {
      check(session);
      begin(left_ > 0 ? Phase::kRandom : Phase::kClose);
      // Beside a mesh that is not written yet a second one is a yes.
      InputEvent close;
      close.kind = Kind::kClose;
      if (left_ <= 0) orders_ = {{close}, {close}};
    }
  }
  void check(ViewSession* session) {
    ++checks_;
    if (session == nullptr) throw Error("nothing is open");
    const SessionStatus status = session->status();
    if (!status.error.empty()) throw Error("Home shows an error: " + status.error);
    if (status.triangles == 0) throw Error("Home shows no surface");
    const glm::ivec2 size(session->interaction().size);
    const SceneFrame frame = session->pictureFrame(size.x, size.y);
    const Image middle = target_->renderer().drawTile(frame, {size.x / 2, size.y / 2, 1, 1}, true);
    if (!std::isfinite(middle.depth[0])) throw Error("Home shows no surface in its middle");
  }

  Hand hand_;
  test::DriverFaults& driver_;
  EglTarget* target_ = nullptr;
  int left_, in_round_ = 0, checks_ = 0, still_frames_ = 0;
  Phase phase_ = Phase::kRandom;
  double since_ = 0.0;
  std::deque<std::vector<InputEvent>> orders_;
  std::string last_fault_;
};

class PlayedTarget : public EglTarget {
 public:
  PlayedTarget(Play& play, double scale) : EglTarget(600, 400, scale), play_(play) {}

  std::vector<InputEvent> takeEvents(double) override {
    const std::vector<InputEvent> played = play_.events(*this);
    std::vector<InputEvent> events = EglTarget::takeEvents(0.0);
    events.insert(events.end(), played.begin(), played.end());
    return events;
  }

 private:
  Play& play_;
};

class InFolder {
 public:
  explicit InFolder(const std::string& folder) { std::filesystem::current_path(folder); }
  ~InFolder() { std::filesystem::current_path(before_); }

 private:
  const std::filesystem::path before_ = std::filesystem::current_path();
};

// ISOBRICK_RANDOM_EVENTS and ISOBRICK_RANDOM_SEED set others.
TEST(RandomEventsTest, NothingThatAHandCanDoLosesTheSurface) {
  try {
    const EglContext probe;
  } catch (const Error& error) {
    SKIP_UNLESS_REQUIRED(error.what());
  }
  const int events = test::environmentOr("ISOBRICK_RANDOM_EVENTS", 1500);
  const int seed = test::environmentOr("ISOBRICK_RANDOM_SEED", 1);
  SCOPED_TRACE("ISOBRICK_RANDOM_SEED=" + std::to_string(seed));

  const test::TemporaryFolder folder;
  BuildOptions build;
  build.brick_cells = 16;
  const auto ball = [](double radius) {
    return [radius](const glm::dvec3& p) {
      return std::clamp(radius - glm::distance(p, glm::dvec3(20.0)), -3.0, 3.0);
    };
  };
  ViewOptions options;
  options.path = test::buildField(folder, Index3(40), ball(15.0), build);
  const std::string other = test::buildField(folder, Index3(40), ball(9.0), build, {}, "other.isb");
  std::ofstream(folder.file("noise.raw")) << "none of the formats";
  options.build = [](const std::string& input, const BuildListener&,
                     const CancelFlag&) -> std::string { throw Error(input + ": no volume"); };
  options.memory_bytes = options.gpu_budget_bytes = std::uint64_t{64} << 20;
  options.offscreen = true;
  const InFolder in_folder(folder.path());  // files go there

  // See DriverFaults.
  options.script_path = folder.file("script.json");
  std::ofstream(options.script_path)
      << R"({"size": [64, 64], "steps": [{"wait": "settled"}, {"picture": "found.png"}]})";
  options.frames_folder = folder.path();
  runView(options);
  options.script_path.clear();

  test::DriverFaults driver;
  Play play(static_cast<std::uint64_t>(seed), events,
            {options.path, other, folder.file("noise.raw"), folder.file("nothing"), folder.path()},
            driver);
  // A hand may close the window too: the play goes on in another one.
  for (int window = 0; play.left() > 0; ++window) {
    ViewHost host;
    host.target = std::make_unique<PlayedTarget>(play, window % 3 == 2 ? 2.5 : 1.0);
    host.after_frame = [&](ViewSession* session, bool settled) { play.look(session, settled); };
    ASSERT_NO_THROW(runView(options, std::move(host)))
        << play.left() << " of " << events << " events were left";
  }
  EXPECT_GT(play.checks(), events / 1000);
  EXPECT_GT(driver.resets(), 0);
}

}  // namespace
}  // namespace isobrick
