#include "isobrick/viewer/window/view_loop.h"

#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <deque>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid_file.h"
#include "isobrick/viewer/image.h"
#include "isobrick/viewer/session/folder_listing.h"
#include "isobrick/viewer/session/view_script.h"
#include "isobrick/viewer/session/view_session.h"
#include "isobrick/viewer/session/volume_show.h"
#include "isobrick/viewer/state/view_state_json.h"
#include "isobrick/viewer/window/egl_target.h"
#include "isobrick/viewer/window/gl_window.h"
#include "isobrick/viewer/window/view_panel.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kFrameTimes = 240;
constexpr double kIdleSeconds = 0.1;       // between updates if nothing moves
constexpr double kStayAwakeSeconds = 0.5;  // after the last event: panels fade and blink

double secondsNow() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// The figures of a frame in a script's report.
struct ReportedFrame {
  double seconds = 0.0;  // since the begin
  FrameTimes times;
  double surface_age = 0.0;
  double shown_radius = 0.0;
  std::uint64_t triangles = 0;
  std::uint64_t triangles_made = 0;
  std::uint64_t uploaded_bytes = 0;
  std::vector<SurfaceWait> waits;
};

nlohmann::ordered_json spreadOf(std::vector<double> values) {
  auto spread = nlohmann::ordered_json::object();
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

// The ages of surfaces when another one replaced them, and their parts.
void addWaits(const std::vector<ReportedFrame>& frames, nlohmann::ordered_json& report) {
  constexpr std::array<std::pair<const char*, double SurfaceWait::*>, 4> kParts{
      {{"before", &SurfaceWait::before},
       {"extraction", &SurfaceWait::extraction},
       {"uploads", &SurfaceWait::uploads},
       {"drawing", &SurfaceWait::drawing}}};
  std::map<std::string, std::vector<double>> values;
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const ReportedFrame& f : frames) {
    for (const SurfaceWait& wait : f.waits) {
      nlohmann::ordered_json& one = list.emplace_back();
      one["seconds"] = f.seconds;
      one["triangles_made"] = f.triangles_made;
      one["total_ms"] = 1e3 * wait.total();
      values["total"].push_back(1e3 * wait.total());
      for (const auto& [name, part] : kParts) {
        one[std::string(name) + "_ms"] = 1e3 * wait.*part;
        values[name].push_back(1e3 * wait.*part);
      }
    }
  }
  for (const char* name : {"total", "before", "extraction", "uploads", "drawing"})
    report["surface_wait_ms"][name] = spreadOf(values[name]);
  report["each_surface"] = std::move(list);
}

std::string reportOf(const std::vector<ReportedFrame>& frames, const std::string& device,
                     const SessionStatus& status) {
  auto report = nlohmann::ordered_json::object();
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
  addWaits(frames, report);
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
                    {"triangles", f.triangles},
                    {"triangles_made", f.triangles_made},
                    {"uploaded_bytes", f.uploaded_bytes}});
  report["each_frame"] = std::move(list);
  return report.dump(1) + "\n";
}

std::unique_ptr<ViewTarget> makeTarget(const ViewOptions& options, int width, int height,
                                       double scale) {
  if (options.offscreen) return std::make_unique<EglTarget>(width, height, scale);
  return std::make_unique<GlWindow>(width, height, "isobrick");
}

// A file or a folder that is there and is no pyramid, or the name of a phantom. Everything else is
// opened as a pyramid before the window exists; opening reports the errors. A build and a server
// take time, so they begin when the window is there.
bool isOpenedBeside(const std::string& source) {
  if (isRemotePath(source)) return true;
  std::error_code ignored;
  return source.rfind("phantom:", 0) == 0 ||
         (fs::exists(source, ignored) && !isPyramidFile(source));
}

// The name of its files: "scan" for "scans/scan.nii.gz", "head-256" for "phantom:head:256".
std::string stemOf(const std::string& source) {
  if (isRemotePath(source))
    return fs::path(source.substr(0, source.find_first_of("?#"))).stem().string();
  if (source.rfind("phantom:", 0) == 0) {
    std::string name = source.substr(source.find(':') + 1);
    std::replace(name.begin(), name.end(), ':', '-');
    return name;
  }
  fs::path path = source;
  if (!path.has_filename()) path = path.parent_path();
  if (path.extension() == ".gz") path = path.stem();
  return path.stem().string();
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
        state_path_(options.state_path),
        recent_(readRecentFiles(options.recent_path)),
        show_({options.threads, options.gpu_budget_bytes}),
        opener_(options.build, options.memory_bytes, options.remote) {
    std::optional<OpenedVolume> first;
    const bool opens_beside = !options.path.empty() && isOpenedBeside(options.path);
    if (!options.path.empty() && !opens_beside)
      first = openPyramid(options.path, options.memory_bytes);
    if (!options.state_path.empty()) first_state_ = readViewState(options.state_path);
    int width = options.width, height = options.height;
    double scale = 1.0;  // of a target without a window
    if (!options.script_path.empty()) {
      ViewScript script = readViewScript(options.script_path);
      width = script.width;
      height = script.height;
      scale = script.scale;
      player_.emplace(std::move(script));
      fs::create_directories(options.frames_folder);
    }
    target_ = makeTarget(options, width, height, scale);
    panel_ = std::make_unique<ViewPanel>(target_->scale());
    if (first)
      show(std::move(*first));
    else if (opens_beside)
      opener_.open(options.path);
    else if (!player_)
      panel_->toggleOpening();
  }

  void run() {
    begin_ = last_frame_ = secondsNow();
    while (!closing_) {
      if (options_.cancel != nullptr) options_.cancel->check();
      takeEvents();
      if (!closing_ && (awake() || opener_.status().busy || !events_.empty())) frame();
    }
    if (!options_.record_path.empty()) {
      const std::string script = recorder_.json(first_width_, first_height_, target_->scale());
      AtomicFile file(options_.record_path);
      file.write(script.data(), script.size());
      file.commit();
    }
    if (!options_.report_path.empty()) {
      const std::string report = reportOf(reported_, target_->renderer().deviceName(), status());
      AtomicFile file(options_.report_path);
      file.write(report.data(), report.size());
      file.commit();
    }
  }

 private:
  ViewSession* session() const { return show_.session(); }
  bool awake() const {
    return player_ || secondsNow() < awake_until_ || !show_.settled() ||
           (session() != nullptr && session()->interaction().flying);
  }
  // True if everything requested is shown.
  bool settled() const { return !opener_.status().busy && !outcome_ && show_.settled(); }
  ScriptSight whatIsThere() const { return {settled(), show_.showsPreview() && show_.settled()}; }
  SessionStatus status() const {
    return session() != nullptr ? session()->status() : SessionStatus{};
  }
  ViewState& state() { return session() != nullptr ? session()->state() : idle_state_; }
  glm::dvec2 size() const { return {width_, height_}; }

  // Replaces the volume shown before.
  void show(OpenedVolume opened) {
    const bool is_preview = opened.preview_of.has_value();
    const std::string source = opened.source, pyramid = opened.pyramid;
    show_.take(std::move(opened), target_->renderer(), size(), target_->scale());
    nameAfter(source, is_preview ? " (preview)" : "");
    if (is_preview) return;
    message_ = source == pyramid ? "" : "the pyramid is " + pyramid;
    std::error_code ignored;
    const bool is_file = fs::exists(source, ignored);  // no phantom
    recent_ =
        withRecent(std::move(recent_),
                   is_file ? fs::absolute(source, ignored).lexically_normal().string() : source);
    writeRecentFiles(options_.recent_path, recent_);
  }

  void nameAfter(const std::string& source, const char* what) {
    stem_ = stemOf(source);
    if (options_.state_path.empty()) state_path_ = stem_ + ".view.json";
    target_->setTitle(shownName(fs::path(source).filename().string()) + what + " - isobrick");
  }

  // The volume under way will not come.
  void giveUpPreview() {
    if (!show_.showsPreview()) return;
    show_.giveUpPreview(target_->renderer(), size(), target_->scale());
    if (show_.opened() != nullptr)
      nameAfter(show_.opened()->source, "");
    else
      target_->setTitle("isobrick");
  }

  // After the loss of a context, by a driver that was reset or by a script: all its objects are
  // made again from the shown state.
  void renewContext() {
    show_.suspend();
    panel_.reset();
    target_->renew();
    panel_ = std::make_unique<ViewPanel>(target_->scale());
    show_.resume(target_->renderer());
  }

  void takeOpened() {
    if (!outcome_) outcome_ = opener_.poll();
    if (auto preview = opener_.takePreview()) show(std::move(*preview));
    if (player_ && player_->keepsPreview() && show_.showsPreview()) return;
    auto outcome = std::exchange(outcome_, std::nullopt);
    if (!outcome) return;
    if (!outcome->volume) giveUpPreview();
    // The steps of a script.
    if (!outcome->volume && player_ && session() == nullptr && outcome->source == options_.path)
      throw Error(outcome->error);
    open_error_ = outcome->error;
    if (outcome->volume) show(std::move(*outcome->volume));
  }

  bool draw() {
    if (session() != nullptr) return session()->draw();
    if (width_ < 1 || height_ < 1) return false;
    SceneFrame frame;
    frame.width = width_;
    frame.height = height_;
    frame.background_top = idle_state_.background_top;
    frame.background_bottom = idle_state_.background_bottom;
    target_->renderer().draw(frame);
    return true;
  }

  void takeEvents() {
    const std::vector<InputEvent> events = target_->takeEvents(awake() ? 0.0 : kIdleSeconds);
    if (!events.empty()) awake_until_ = secondsNow() + kStayAwakeSeconds;
    events_.insert(events_.end(), events.begin(), events.end());
  }

  void frame() {
    const double begin = secondsNow();
    takeOpened();
    ScriptFrame scripted;
    if (player_) scripted = player_->next(begin - begin_, whatIsThere(), state());
    if (scripted.state) state() = *scripted.state;
    if (scripted.size) target_->resize(scripted.size->width, scripted.size->height);
    events_.insert(events_.end(), scripted.events.begin(), scripted.events.end());
    if (scripted.lose_context || target_->renderer().isLost()) renewContext();

    const Wishes wishes = takeInput(begin);
    UploadAllowance allowance;
    show_.update(begin, allowance);
    const double idle = waitForSurface(allowance);
    uploaded_bytes_ = kUploadBytes - allowance.bytes;
    const double drawing = secondsNow();
    const bool drawn = draw();
    if (drawn) {
      target_->renderer().present(target_->framebuffer());
      panel_->draw();
    } else {
      panel_->discard();
    }
    const double drawn_by = secondsNow();
    if (scripted.file) writeScripted(*scripted.file, drawn);  // from the frame shown next
    const double written = secondsNow();
    if (drawn) target_->show();
    const double draw_seconds = drawn_by - drawing + secondsNow() - written;
    if (drawn && session() != nullptr) session()->noteDrawing(draw_seconds);
    remember({drawing - begin - idle, draw_seconds}, begin);
    if (drawn) grant(wishes);
    grantOpening(wishes);
    closing_ = closing_ || wishes.close || (player_ && scripted.finished);
  }

  // While the frame may upload more bytes. Returns the seconds in which nothing was done.
  double waitForSurface(UploadAllowance& allowance) {
    waits_.clear();
    double idle = 0.0;
    const auto note = [&] {
      waits_.insert(waits_.end(), session()->waits().begin(), session()->waits().end());
    };
    if (session() == nullptr) return idle;
    for (note(); session()->drawsBetterLater() && allowance.bytes > 0; note()) {
      const double begin = secondsNow();
      const std::uint64_t left = allowance.bytes;
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
      const double looked = secondsNow();
      allowance.addWaited(looked - begin);
      show_.update(looked, allowance);
      const bool nothing_came = allowance.bytes == left && session()->waits().empty();
      idle += (nothing_came ? secondsNow() : looked) - begin;
    }
    return idle;
  }

  // Events to panel and session, at most one of a button, so that none is lost in a frame.
  Wishes takeInput(double seconds) {
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
      const bool on_panel = of_keyboard ? panel_->wantsKeyboard() : panel_->wantsMouse();
      addWishes(session() != nullptr
                    ? session()->apply(event, seconds, on_panel)
                    : applyEvent(event, seconds, on_panel, {}, idle_interaction_, idle_state_),
                wishes);
    }
    if (first_state_ && session() != nullptr && height_ > 0) {
      session()->state() = *first_state_;
      first_state_.reset();
    }
    if (session() != nullptr)
      if (const auto written = session()->takeExported()) message_ = "wrote " + *written;
    addWishes(panel_->build(session(), {frames_, message_, target_->renderer().deviceName(),
                                        opener_.status(), open_error_, recent_}),
              wishes);
    return wishes;
  }

  void grantOpening(const Wishes& wishes) {
    if (wishes.browse) panel_->toggleOpening();
    if (wishes.stop_opening || wishes.open) {
      open_error_.clear();
      outcome_.reset();
    }
    if (wishes.stop_opening) {
      opener_.cancel();
      giveUpPreview();
    }
    if (wishes.open) opener_.open(*wishes.open);
  }

  // A failure is shown in the window, and the rest goes on.
  void grant(const Wishes& wishes) {
    try {
      if (wishes.screenshot) writePicture(freeName(stem_, ".png"));
      if (wishes.screenshot_exr) writePicture(freeName(stem_, ".exr"));
      if (session() == nullptr) return;
      if (wishes.export_mesh) session()->exportMesh(freeName(stem_, ".ply"));
      if (wishes.save_state) {
        writeViewState(state_path_, session()->state());
        message_ = "wrote " + state_path_;
      }
      if (wishes.load_state) {
        session()->state() = readViewState(state_path_);
        message_ = "read " + state_path_;
      }
    } catch (const Error& error) {
      message_ = error.what();
    }
  }

  // The scene without panels. It is drawn anew, so the screen's is, too, before it is shown.
  void writePicture(const std::string& path) {
    const ImageFormat format = imageFormatOf(path);
    writeImage(path, session() != nullptr
                         ? session()->picture(state().pictures.times, format == ImageFormat::kExr)
                         : target_->renderer().picture());
    if (session() != nullptr) session()->draw();
    message_ = "wrote " + path;
  }

  void writeScripted(const ScriptFile& file, bool drawn) {
    const std::string path = (fs::path(options_.frames_folder) / file.name).string();
    switch (file.what) {
      case ScriptFile::What::kFrame:
        if (drawn) writeImage(path, readScreen(target_->framebuffer(), width_, height_));
        break;
      case ScriptFile::What::kPicture:
        if (drawn) writePicture(path);
        break;
      case ScriptFile::What::kMesh:
        if (session() != nullptr) session()->exportMesh(path);
        break;
      case ScriptFile::What::kShownMesh:
        if (session() != nullptr) session()->writeShownMesh(path);
        break;
      case ScriptFile::What::kState:
        writeViewState(path, state());
        break;
    }
  }

  void remember(const FrameTimes& times, double begin) {
    frames_.push_back(times);
    if (frames_.size() > kFrameTimes) frames_.pop_front();
    if (options_.report_path.empty()) return;
    const SessionStatus now = status();
    reported_.push_back({begin - begin_, times, now.surface_age, now.shown_radius, now.triangles,
                         now.triangles_made, uploaded_bytes_, waits_});
  }

  const ViewOptions& options_;
  std::string stem_ = "isobrick", state_path_;
  std::vector<std::string> recent_;
  std::string open_error_;
  std::optional<ScriptPlayer> player_;
  // In this order: the context goes last.
  std::unique_ptr<ViewTarget> target_;
  std::unique_ptr<ViewPanel> panel_;
  VolumeShow show_;
  VolumeOpener opener_;  // its end waits for that of a build
  std::optional<VolumeOpener::Outcome> outcome_;
  // While nothing is open.
  Interaction idle_interaction_;
  ViewState idle_state_;

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
  // For the last frame.
  std::vector<SurfaceWait> waits_;
  std::uint64_t uploaded_bytes_ = 0;
};

}  // namespace

void runView(const ViewOptions& options) { ViewLoop(options).run(); }

}  // namespace isobrick
