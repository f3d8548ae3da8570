#include "isobrick/viewer/window/view_loop.h"

#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <deque>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/viewer/image_writer.h"
#include "isobrick/viewer/session/view_script.h"
#include "isobrick/viewer/session/view_session.h"
#include "isobrick/viewer/state/view_state_json.h"
#include "isobrick/viewer/window/egl_target.h"
#include "isobrick/viewer/window/gl_window.h"
#include "isobrick/viewer/window/view_panel.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kFrameTimes = 240;
constexpr double kIdleSeconds = 0.1;       // between looks where nothing moves
constexpr double kStayAwakeSeconds = 0.5;  // after the last event: panels fade and blink

double secondsNow() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// What a script's report has of a frame.
struct ReportedFrame {
  double seconds = 0.0;  // since the begin
  FrameTimes times;
  double surface_age = 0.0;
  double shown_radius = 0.0;
  std::uint64_t triangles = 0;
  std::uint64_t uploaded_bytes = 0;
};

nlohmann::ordered_json spreadOf(std::vector<double> values) {
  nlohmann::ordered_json spread;
  std::sort(values.begin(), values.end());
  const auto at = [&](double share) {
    return values.empty()
               ? 0.0
               : values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
  };
  spread["median"] = at(0.5);
  spread["p95"] = at(0.95);
  spread["max"] = at(1.0);
  return spread;
}

std::string reportOf(const std::vector<ReportedFrame>& frames, const std::string& device,
                     const SessionStatus& status) {
  nlohmann::ordered_json report;
  report["device"] = device;
  report["frames"] = frames.size();
  report["seconds"] = frames.empty() ? 0.0 : frames.back().seconds;
  const auto spread = [&](auto&& value) {
    std::vector<double> values;
    for (const ReportedFrame& frame : frames) values.push_back(value(frame));
    return spreadOf(std::move(values));
  };
  report["interface_ms"] = spread([](const auto& f) { return 1e3 * f.times.interface; });
  report["draw_ms"] = spread([](const auto& f) { return 1e3 * f.times.draw; });
  report["surface_age_ms"] = spread([](const auto& f) { return 1e3 * f.surface_age; });
  report["uploaded_bytes"] =
      spread([](const auto& f) { return static_cast<double>(f.uploaded_bytes); });
  report["passes"] = status.passes;
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  report["peak_rss_bytes"] = std::uint64_t{1024} * static_cast<std::uint64_t>(usage.ru_maxrss);
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const ReportedFrame& f : frames)
    list.push_back({{"seconds", f.seconds},
                    {"interface_ms", 1e3 * f.times.interface},
                    {"draw_ms", 1e3 * f.times.draw},
                    {"surface_age_ms", 1e3 * f.surface_age},
                    {"radius", f.shown_radius},
                    {"triangles", f.triangles}});
  report["each_frame"] = std::move(list);
  return report.dump(1) + "\n";
}

std::unique_ptr<ViewTarget> makeTarget(const ViewOptions& options, int width, int height) {
  if (options.offscreen) return std::make_unique<EglTarget>(width, height);
  return std::make_unique<GlWindow>(width, height,
                                    fs::path(options.path).filename().string() + " - isobrick");
}

// The first name STEM-0001.png, STEM-0002.png, ... that is free.
std::string freeName(const std::string& stem, const char* extension) {
  for (int number = 1; number < 10000; ++number) {
    std::array<char, 16> digits{};
    std::snprintf(digits.data(), digits.size(), "-%04d", number);
    const std::string name = stem + digits.data() + extension;
    if (!fs::exists(name)) return name;
  }
  throw Error("all names from '" + stem + "-0001" + extension + "' on are taken; move some away");
}

class ViewLoop {
 public:
  explicit ViewLoop(const ViewOptions& options)
      : options_(options),
        stem_(fs::path(options.path).stem().string()),
        state_path_(options.state_path.empty() ? stem_ + ".view.json" : options.state_path),
        pyramid_(std::make_shared<const Pyramid>(options.path, options.memory_bytes)) {
    std::optional<ViewState> state;
    if (!options.state_path.empty()) state = readViewState(options.state_path);
    int width = options.width, height = options.height;
    if (!options.script_path.empty()) {
      ViewScript script = readViewScript(options.script_path);
      width = script.width;
      height = script.height;
      player_.emplace(std::move(script));
      fs::create_directories(options.frames_folder);
    }
    target_ = makeTarget(options, width, height);
    panel_ = std::make_unique<ViewPanel>(target_->scale());
    session_ = std::make_unique<ViewSession>(
        pyramid_, target_->renderer(), SessionOptions{options.threads, options.gpu_budget_bytes});
    if (state) first_state_ = *state;
  }

  void run() {
    begin_ = last_frame_ = secondsNow();
    while (!closing_) {
      if (options_.cancel != nullptr) options_.cancel->check();
      takeEvents();
      if (!closing_ && (awake() || !events_.empty())) frame();
    }
    if (!options_.record_path.empty()) {
      const std::string script = recorder_.json(first_width_, first_height_);
      AtomicFile file(options_.record_path);
      file.write(script.data(), script.size());
      file.commit();
    }
    if (!options_.report_path.empty()) {
      const std::string report =
          reportOf(reported_, target_->renderer().deviceName(), session_->status());
      AtomicFile file(options_.report_path);
      file.write(report.data(), report.size());
      file.commit();
    }
  }

 private:
  bool awake() const {
    return player_ || !session_->settled() || secondsNow() < awake_until_ ||
           session_->interaction().flying;
  }

  void takeEvents() {
    const std::vector<InputEvent> events = target_->takeEvents(awake() ? 0.0 : kIdleSeconds);
    if (!events.empty()) awake_until_ = secondsNow() + kStayAwakeSeconds;
    events_.insert(events_.end(), events.begin(), events.end());
  }

  void frame() {
    const double begin = secondsNow();
    ScriptFrame scripted;
    if (player_) scripted = player_->next(begin - begin_, session_->settled(), session_->state());
    if (scripted.state) session_->state() = *scripted.state;
    if (scripted.size) target_->resize(scripted.size->width, scripted.size->height);
    events_.insert(events_.end(), scripted.events.begin(), scripted.events.end());

    const Wishes wishes = hands(begin);
    session_->update(begin);
    const double drawing = secondsNow();
    const bool drawn = session_->draw();
    if (drawn) {
      target_->renderer().present(target_->framebuffer());
      panel_->draw();
    } else {
      panel_->discard();
    }
    const double drawn_by = secondsNow();
    if (scripted.file) writeScripted(*scripted.file, drawn);  // from what is about to be shown
    const double written = secondsNow();
    if (drawn) target_->show();
    const double draw_seconds = drawn_by - drawing + secondsNow() - written;
    if (drawn) session_->noteDrawing(draw_seconds);
    remember({drawing - begin, draw_seconds}, begin);
    if (drawn) grant(wishes);
    closing_ = closing_ || wishes.close || (player_ && scripted.finished);
  }

  // Events to panel and session, at most one of a button, so that none is lost in a frame.
  Wishes hands(double seconds) {
    std::vector<InputEvent> now;
    while (!events_.empty()) {
      now.push_back(events_.front());
      events_.pop_front();
      const InputEvent::Kind kind = now.back().kind;
      if (kind == InputEvent::Kind::kPress || kind == InputEvent::Kind::kRelease) break;
    }
    for (const InputEvent& event : now) {
      panel_->feed(event);
      if (first_width_ > 0) recorder_.add(seconds, event);
      if (event.kind == InputEvent::Kind::kResize) {
        width_ = static_cast<int>(event.x);
        height_ = static_cast<int>(event.y);
        if (first_width_ == 0) first_width_ = width_, first_height_ = height_;
      }
    }
    panel_->begin(width_, height_, seconds - last_frame_);
    last_frame_ = seconds;
    Wishes wishes;
    for (const InputEvent& event : now) {
      const bool of_keyboard = event.kind == InputEvent::Kind::kKeyPress ||
                               event.kind == InputEvent::Kind::kKeyRelease ||
                               event.kind == InputEvent::Kind::kText;
      add(session_->apply(event, seconds,
                          of_keyboard ? panel_->wantsKeyboard() : panel_->wantsMouse()),
          wishes);
    }
    if (first_state_ && height_ > 0) {
      session_->state() = *first_state_;
      first_state_.reset();
    }
    if (const auto written = session_->takeExported()) message_ = "wrote " + *written;
    add(panel_->build(*session_, {frames_, message_, target_->renderer().deviceName()}), wishes);
    return wishes;
  }

  static void add(const Wishes& more, Wishes& wishes) {
    wishes.screenshot = wishes.screenshot || more.screenshot;
    wishes.save_state = wishes.save_state || more.save_state;
    wishes.load_state = wishes.load_state || more.load_state;
    wishes.export_mesh = wishes.export_mesh || more.export_mesh;
    wishes.close = wishes.close || more.close;
  }

  // What fails is said in the window, and the rest goes on.
  void grant(const Wishes& wishes) {
    try {
      if (wishes.screenshot) {
        const std::string name = freeName(stem_, ".png");
        writeImage(name, target_->renderer().picture());
        message_ = "wrote " + name;
      }
      if (wishes.export_mesh) session_->exportMesh(freeName(stem_, ".ply"));
      if (wishes.save_state) {
        writeViewState(state_path_, session_->state());
        message_ = "wrote " + state_path_;
      }
      if (wishes.load_state) {
        session_->state() = readViewState(state_path_);
        message_ = "read " + state_path_;
      }
    } catch (const Error& error) {
      message_ = error.what();
    }
  }

  void writeScripted(const ScriptFile& file, bool drawn) {
    const std::string path = (fs::path(options_.frames_folder) / file.name).string();
    switch (file.what) {
      case ScriptFile::What::kFrame:
        if (drawn) writeImage(path, readScreen(target_->framebuffer(), width_, height_));
        break;
      case ScriptFile::What::kPicture:
        if (drawn) writeImage(path, target_->renderer().picture());
        break;
      case ScriptFile::What::kMesh:
        session_->exportMesh(path);
        break;
      case ScriptFile::What::kState:
        writeViewState(path, session_->state());
        break;
    }
  }

  void remember(const FrameTimes& times, double begin) {
    frames_.push_back(times);
    if (frames_.size() > kFrameTimes) frames_.pop_front();
    if (options_.report_path.empty()) return;
    const SessionStatus status = session_->status();
    reported_.push_back({begin - begin_, times, status.surface_age, status.shown_radius,
                         status.triangles, session_->uploadedBytes()});
  }

  const ViewOptions& options_;
  std::string stem_, state_path_;
  std::shared_ptr<const Pyramid> pyramid_;
  std::optional<ScriptPlayer> player_;
  // In this order: the context goes last.
  std::unique_ptr<ViewTarget> target_;
  std::unique_ptr<ViewPanel> panel_;
  std::unique_ptr<ViewSession> session_;

  std::optional<ViewState> first_state_;
  std::deque<InputEvent> events_;
  int width_ = 0, height_ = 0;
  int first_width_ = 0, first_height_ = 0;
  ScriptRecorder recorder_;
  double begin_ = 0.0, last_frame_ = 0.0, awake_until_ = 0.0;
  bool closing_ = false;
  std::string message_;
  std::deque<FrameTimes> frames_;
  std::vector<ReportedFrame> reported_;
};

}  // namespace

void runView(const ViewOptions& options) { ViewLoop(options).run(); }

}  // namespace isobrick
