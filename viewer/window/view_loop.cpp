#include "isobrick/viewer/window/view_loop.h"

#include <algorithm>
#include <chrono>
#include <deque>
#include <filesystem>
#include <memory>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid_file.h"
#include "isobrick/viewer/clock_seconds.h"
#include "isobrick/viewer/image.h"
#include "isobrick/viewer/session/folder_listing.h"
#include "isobrick/viewer/session/frame_report.h"
#include "isobrick/viewer/session/mesh_queue.h"
#include "isobrick/viewer/session/output_names.h"
#include "isobrick/viewer/session/script_recording.h"
#include "isobrick/viewer/session/view_script.h"
#include "isobrick/viewer/session/view_session.h"
#include "isobrick/viewer/session/volume_show.h"
#include "isobrick/viewer/session/wish_guard.h"
#include "isobrick/viewer/state/view_file.h"
#include "isobrick/viewer/view_picture.h"
#include "isobrick/viewer/window/egl_target.h"
#include "isobrick/viewer/window/gl_window.h"
#include "isobrick/viewer/window/view_panel.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kFrameTimes = 240;
constexpr double kIdleSeconds = 0.1;       // between updates if nothing moves
constexpr double kHiddenSeconds = 0.02;    // likewise, if things move and no picture is there
constexpr double kStayAwakeSeconds = 0.5;  // after the last event: panels fade and blink

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

class ViewLoop {
 public:
  explicit ViewLoop(const ViewOptions& options)
      : options_(options),
        path_(options.path),
        recent_(readRecentFiles(options.recent_path)),
        show_({options.threads, options.gpu_budget_bytes}),
        opener_(options.build, options.memory_bytes, options.remote),
        meshes_(options.threads) {
    if (!options.state_path.empty()) first_view_ = readView(options.state_path);
    if (path_.empty() && first_view_) path_ = first_view_->volume;
    std::optional<OpenedVolume> first;
    const bool opens_beside = !path_.empty() && isOpenedBeside(path_);
    if (!path_.empty() && !opens_beside) first = openPyramid(path_, options.memory_bytes);
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
    panel_ = std::make_unique<ViewPanel>(target_->scale(), *target_);
    if (first)
      show(std::move(*first));
    else if (opens_beside)
      opener_.open(path_);
    else if (!player_)
      panel_->toggleOpening();
  }

  void run() {
    begin_ = last_frame_ = clockSeconds();
    while (!closing_) {
      if (options_.cancel != nullptr) options_.cancel->check();
      takeEvents();
      const bool works = opener_.status().busy || meshes_.unwritten() > 0;
      if (!closing_ && (awake() || works || !events_.empty())) frame();
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
    return player_ || clockSeconds() < awake_until_ || !show_.settled() ||
           (session() != nullptr && session()->interaction().flying);
  }
  // True if everything requested is shown.
  bool settled() const {
    return !opener_.status().busy && !outcome_ && show_.settled() && meshes_.unwritten() == 0;
  }
  ScriptSight whatIsThere() const { return {settled(), show_.showsPreview() && show_.settled()}; }
  SessionStatus status() const {
    return session() != nullptr ? session()->status() : SessionStatus{};
  }
  ViewState& state() { return session() != nullptr ? session()->state() : idle_state_; }
  // The window's, and the part of it that shows the scene.
  glm::dvec2 size() const { return {width_, height_}; }
  SceneArea area() const {
    const bool with_panel = session() != nullptr && session()->interaction().show_panel;
    return sceneArea(width_, height_, target_->scale(), with_panel);
  }

  // Gives the session the size of its area, and the cursor in it.
  void layOut() {
    if (session() == nullptr) return;
    const SceneArea now = area();
    const Interaction& interaction = session()->interaction();
    if (interaction.size != glm::dvec2(now.width, now.height)) {
      InputEvent resized;
      resized.kind = InputEvent::Kind::kResize;
      session()->apply(inScene(resized), last_frame_, false);
    }
    // The panel came or went under the cursor, which has not moved.
    const double shift = std::exchange(left_, now.left) - now.left;
    session()->interaction().pressed_at.x += shift;
    if (interaction.drag == Interaction::Drag::kNone || shift != 0.0)
      session()->interaction().cursor = cursor_ - glm::dvec2(now.left, 0.0);
  }

  // An event of the window, in the scene's pixels.
  InputEvent inScene(InputEvent event) const {
    const SceneArea now = area();
    if (event.kind == InputEvent::Kind::kMove) event.x -= now.left;
    if (event.kind == InputEvent::Kind::kResize) {
      event.x = now.width;
      event.y = now.height;
    }
    return event;
  }

  // Replaces the volume shown before.
  void show(OpenedVolume opened) {
    const bool is_preview = opened.preview_of.has_value();
    const std::string source = opened.source, pyramid = opened.pyramid;
    show_.take(std::move(opened), target_->renderer(), size(), target_->scale());
    nameAfter(source, is_preview ? " (preview)" : "");
    if (is_preview) return;
    message_ = source == pyramid ? "" : "the pyramid is " + shortPath(pyramid);
    std::error_code ignored;
    const bool is_file = fs::exists(source, ignored);  // no phantom
    recent_ =
        withRecent(std::move(recent_),
                   is_file ? fs::absolute(source, ignored).lexically_normal().string() : source);
    writeRecentFiles(options_.recent_path, recent_);
  }

  void nameAfter(const std::string& source, const char* what) {
    stem_ = stemOf(source);
    if (source != named_after_) own_view_.forget();
    named_after_ = source;
    // The view of `--state` is that of the volume that it was opened with.
    if (!first_source_) first_source_ = source;
    state_path_ = !options_.state_path.empty() && source == *first_source_ ? options_.state_path
                                                                           : stem_ + ".view.json";
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
  // made again from the shown state. A driver may need seconds until it makes another context.
  void renewContext() {
    if (++losses_ > kMostLosses)
      throw Error("the graphics driver was reset " + std::to_string(kMostLosses) +
                  " times without drawing a frame; 'isobrick render' draws pictures");
    show_.suspend();
    panel_.reset();
    constexpr int kMostTries = 20;
    for (int tries = 1;; ++tries) {
      try {
        target_->renew();
        break;
      } catch (const Error&) {
        if (tries == kMostTries) throw;
      }
      if (options_.cancel != nullptr) options_.cancel->check();
      std::this_thread::sleep_for(std::chrono::milliseconds(250));
    }
    panel_ = std::make_unique<ViewPanel>(target_->scale(), *target_);
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
    if (!outcome->volume && player_ && session() == nullptr && outcome->source == path_)
      throw Error(outcome->error);
    open_error_ = outcome->error;
    if (outcome->volume) show(std::move(*outcome->volume));
  }

  // False if there is no room for a picture. One that cannot be drawn, for want of memory, is
  // empty, and tried again with the next frame.
  bool draw() {
    if (width_ < 1 || height_ < 1) return false;
    try {
      drawScene();
      target_->presentNothing(width_, height_);
      target_->present(area().left, area().bottom);
      draw_error_.clear();
    } catch (const RendererLost&) {
      throw;
    } catch (const Error& error) {
      draw_error_ = error.what();
      target_->presentNothing(width_, height_);
    }
    return true;
  }

  void drawScene() {
    if (session() != nullptr) {
      session()->draw();
      return;
    }
    SceneFrame frame;
    frame.width = std::max(1, area().width);
    frame.height = std::max(1, area().height);
    frame.background_top = idle_state_.background_top;
    frame.background_bottom = idle_state_.background_bottom;
    target_->renderer().draw(frame);
  }

  // With the times between which they came: events that nobody looked for in a slow frame are
  // reported at its end.
  void takeEvents() {
    const double looked_last = std::exchange(looked_, clockSeconds());
    const double wait = !awake() ? kIdleSeconds : drawn_ ? 0.0 : kHiddenSeconds;
    std::vector<InputEvent> events = target_->takeEvents(wait);
    const double now = clockSeconds();
    if (!events.empty()) awake_until_ = now + kStayAwakeSeconds;
    for (InputEvent& event : events) {
      event.seconds = now;
      event.waited = std::max(0.0, looked_ - looked_last);
    }
    looked_ = now;
    events_.insert(events_.end(), events.begin(), events.end());
  }

  void frame() {
    const double begin = clockSeconds();
    takeOpened();
    ScriptFrame scripted;
    if (file_again_ && settled())
      scripted.file = std::exchange(file_again_, std::nullopt);
    else if (player_ && !file_again_)
      scripted = player_->next(begin - begin_, whatIsThere(), state());
    if (scripted.state) {
      state() = *scripted.state;
      if (session() != nullptr) session()->keepFocus();
    }
    if (scripted.size) target_->resize(scripted.size->width, scripted.size->height);
    events_.insert(events_.end(), scripted.events.begin(), scripted.events.end());
    try {
      if (scripted.lose_context || target_->renderer().isLost()) renewContext();
      showFrame(begin, scripted);
      losses_ = 0;
    } catch (const RendererLost&) {
      renewContext();
      file_again_ = scripted.file;
    }
    const bool ends = player_ && scripted.finished && !file_again_ && meshes_.unwritten() == 0;
    closing_ = closing_ || ends;
  }

  void showFrame(double begin, const ScriptFrame& scripted) {
    addWishes(takeInput(begin), wishes_);
    UploadAllowance allowance;
    show_.update(begin, allowance);
    const double idle = waitForSurface(allowance);
    uploaded_bytes_ = kUploadBytes - allowance.bytes;
    const double drawing = clockSeconds();
    drawn_ = draw();
    if (drawn_)
      panel_->draw();
    else
      panel_->discard();
    const double drawn_by = clockSeconds();
    if (scripted.file) writeScripted(*scripted.file, drawn_);  // from the frame shown next
    const double written = clockSeconds();
    if (drawn_) target_->show();
    const double draw_seconds = drawn_by - drawing + clockSeconds() - written;
    if (drawn_ && session() != nullptr)
      session()->noteDrawing(draw_error_.empty() ? std::optional(draw_seconds) : std::nullopt);
    remember({drawing - begin - idle, draw_seconds}, begin);
    Wishes wishes = std::exchange(wishes_, {});
    // A picture needs a frame.
    if (!drawn_) {
      wishes_.screenshot = std::exchange(wishes.screenshot, false);
      wishes_.screenshot_exr = std::exchange(wishes.screenshot_exr, false);
    }
    const Stakes at_stake = stakes(wishes);
    wishes = guard_.pass(std::move(wishes), at_stake);
    grant(wishes);
    grantOpening(wishes);
    closing_ = closing_ || wishes.close;
  }

  // Looks at the file only if it matters: a folder may be far away.
  Stakes stakes(const Wishes& wishes) const {
    const bool matters = wishes.save_state || guard_.question();
    return {meshes_.unwritten(),
            matters && own_view_.isOther(state_path_) ? state_path_ : std::string()};
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
      const double begin = clockSeconds();
      const std::uint64_t left = allowance.bytes;
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
      const double looked = clockSeconds();
      allowance.addWaited(looked - begin);
      show_.update(looked, allowance);
      const bool nothing_came = allowance.bytes == left && session()->waits().empty();
      idle += (nothing_came ? clockSeconds() : looked) - begin;
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
      if (recording_) recording_->add(event.seconds.value_or(seconds), event);
      if (event.kind == InputEvent::Kind::kResize) {
        width_ = static_cast<int>(event.x);
        height_ = static_cast<int>(event.y);
        if (!options_.record_path.empty() && !recording_ && width_ > 0 && height_ > 0)
          recording_.emplace(options_.record_path, width_, height_, target_->scale());
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
      if (event.kind == InputEvent::Kind::kMove) cursor_ = {event.x, event.y};
      addWishes(session() != nullptr
                    ? session()->apply(inScene(event), seconds, on_panel)
                    : applyEvent(event, seconds, on_panel, {}, idle_interaction_, idle_state_),
                wishes);
    }
    layOut();
    if (first_view_ && session() != nullptr && height_ > 0) {
      session()->show(first_view_->state);
      first_view_.reset();
    }
    while (const auto mesh = meshes_.poll()) {
      mesh_error_ = mesh->error;
      if (mesh->error.empty()) message_ = "wrote " + mesh->path;
    }
    const std::string& failure = draw_error_.empty() ? mesh_error_ : draw_error_;
    addWishes(panel_->build(session(),
                            {frames_, message_, target_->renderer().deviceName(), opener_.status(),
                             open_error_, recent_, meshes_.underWay(), failure, guard_.question()},
                            area()),
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
      if (wishes.export_mesh) {
        const auto isTaken = [&](const std::string& name) { return meshes_.willWrite(name); };
        orderMesh(freeName(stem_, ".ply", isTaken));
      }
      if (wishes.export_measurements) writeMeasurements(freeName(stem_, ".csv"));
      if (wishes.save_state) {
        writeView(state_path_, viewNow());
        own_view_.noteWritten(state_path_);
        message_ = "wrote " + state_path_;
      }
      if (wishes.load_state) {
        const SavedView view = readView(state_path_);
        session()->show(view.state);
        message_ = "read " + state_path_;
        if (!view.volume.empty() && !isSameVolume(view.volume, show_.opened()->source))
          message_ += ", a view of " + view.volume;
      }
    } catch (const RendererLost&) {
      message_ = "the graphics driver was reset, and no picture was written";
      throw;
    } catch (const Error& error) {
      message_ = error.what();
    }
  }

  SavedView viewNow() {
    return {show_.opened() != nullptr ? show_.opened()->source : std::string(), state()};
  }

  void writeMeasurements(const std::string& path) {
    const LengthUnit unit = session()->pyramid().spec().geometry.unit;
    const std::string csv =
        measurementsCsv(state().measurements, unit) +
        pieceMeasuresCsv(state().piece_measures, state().measurements.size() + 1, unit);
    AtomicFile file(path);
    file.write(csv.data(), csv.size());
    file.commit();
    message_ = "wrote " + path;
  }

  void orderMesh(const std::string& path) {
    mesh_error_.clear();
    meshes_.add(session()->meshOrder(path));
  }

  // The scene without panels. It is drawn anew, so the screen's is, too, before it is shown.
  void writePicture(const std::string& path) {
    const ImageFormat format = imageFormatOf(path);
    writeImage(path, session() != nullptr ? pictureOf(*session(), size(), state().pictures.times,
                                                      format == ImageFormat::kExr)
                                          : target_->renderer().picture());
    if (session() != nullptr) session()->draw();
    message_ = "wrote " + path;
  }

  void writeScripted(const ScriptFile& file, bool drawn) {
    const std::string path = (fs::path(options_.frames_folder) / file.name).string();
    switch (file.what) {
      case ScriptFile::What::kFrame:
        if (drawn) writeImage(path, target_->screen(width_, height_));
        break;
      case ScriptFile::What::kPicture:
        if (drawn) writePicture(path);
        break;
      case ScriptFile::What::kMesh:
        if (session() != nullptr) orderMesh(path);
        break;
      case ScriptFile::What::kShownMesh:
        if (session() != nullptr) session()->writeShownMesh(path);
        break;
      case ScriptFile::What::kMeasurements:
        if (session() != nullptr) writeMeasurements(path);
        break;
      case ScriptFile::What::kState:
        writeView(path, viewNow());
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

  static constexpr int kMostLosses = 10;

  const ViewOptions& options_;
  std::string path_;  // to begin with
  std::string stem_ = "isobrick", state_path_ = "isobrick.view.json";
  std::string named_after_;                  // the volume of these names
  std::optional<std::string> first_source_;  // the first of them
  std::vector<std::string> recent_;
  std::string open_error_;
  std::optional<ScriptPlayer> player_;
  // In this order: the context goes last.
  std::unique_ptr<ViewTarget> target_;
  std::unique_ptr<ViewPanel> panel_;
  VolumeShow show_;
  VolumeOpener opener_;  // its end waits for that of a build
  MeshQueue meshes_;
  std::optional<VolumeOpener::Outcome> outcome_;
  // While nothing is open.
  Interaction idle_interaction_;
  ViewState idle_state_;

  std::optional<SavedView> first_view_;
  std::deque<InputEvent> events_;
  int width_ = 0, height_ = 0;                // of the window
  int left_ = 0;                              // of the scene's area in it
  glm::dvec2 cursor_{0.0};                    // in it
  std::optional<ScriptRecording> recording_;  // from the first size on
  double begin_ = 0.0, last_frame_ = 0.0, awake_until_ = 0.0;
  double looked_ = 0.0;  // for events
  bool drawn_ = true;    // in the last frame
  bool closing_ = false;
  std::optional<ScriptFile> file_again_;  // that a loss kept from being written
  int losses_ = 0;                        // of the context, since a frame was whole
  Wishes wishes_;                         // that were not granted yet
  WishGuard guard_;
  OwnViewFile own_view_;
  std::string message_, draw_error_, mesh_error_;
  std::deque<FrameTimes> frames_;
  std::vector<ReportedFrame> reported_;
  // For the last frame.
  std::vector<SurfaceWait> waits_;
  std::uint64_t uploaded_bytes_ = 0;
};

}  // namespace

void runView(const ViewOptions& options) { ViewLoop(options).run(); }

}  // namespace isobrick
