#include "isobrick/viewer/window/view_loop.h"

#include <algorithm>
#include <chrono>
#include <memory>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/viewer/session/session_status.h"
#include "isobrick/viewer/session/view_script.h"
#include "isobrick/viewer/session/view_session.h"
#include "isobrick/viewer/session/wish_guard.h"
#include "isobrick/viewer/state/view_file.h"
#include "isobrick/viewer/stream/latest_worker.h"
#include "isobrick/viewer/window/gl_target.h"
#include "isobrick/viewer/window/gl_window.h"
#include "isobrick/viewer/window/input_router.h"
#include "isobrick/viewer/window/open_volumes.h"
#include "isobrick/viewer/window/output_files.h"
#include "isobrick/viewer/window/view_panel.h"

namespace isobrick {
namespace {

constexpr double kIdleSeconds = 0.1;       // between updates if nothing moves
constexpr double kHiddenSeconds = 0.02;    // likewise, if things move and no picture is there
constexpr double kStayAwakeSeconds = 0.5;  // after the last event: panels fade and blink

std::unique_ptr<ViewTarget> makeTarget(const ViewOptions& options,
                                       const std::optional<ScriptPlayer>& player) {
  const int width = player ? player->script().width : options.width;
  const int height = player ? player->script().height : options.height;
  if (options.offscreen)
    return std::make_unique<EglTarget>(width, height, player ? player->script().scale : 1.0);
  return std::make_unique<GlWindow>(width, height, "isobrick");
}

std::optional<ScriptPlayer> readScript(const ViewOptions& options) {
  if (options.script_path.empty()) return std::nullopt;
  ScriptPlayer player(readViewScript(options.script_path));
  if (const std::error_code failure = makeFolders(options.frames_folder))
    throw Error("cannot make the folder '" + options.frames_folder + "': " + failure.message() +
                    "; choose another one for the script's pictures",
                {.path = options.frames_folder});
  return player;
}

class ViewLoop {
 public:
  ViewLoop(const ViewOptions& options, ViewHost host)
      : options_(options),
        first_view_(options.state_path.empty() ? std::nullopt
                                               : std::optional(readView(options.state_path))),
        path_(options.path.empty() && first_view_ ? first_view_->volume : options.path),
        opens_beside_(!path_.empty() && isOpenedBeside(path_)),
        first_(path_.empty() || opens_beside_
                   ? std::nullopt
                   : std::optional(openPyramid(path_, options.memory_bytes))),
        player_(readScript(options)),
        target_(host.target ? std::move(host.target) : makeTarget(options, player_)),
        panel_(std::make_unique<ViewPanel>(target_->scale(), *target_)),
        sessions_{options.threads, options.gpu_budget_bytes, {},         options.region,
                  options.masks,   options.beside,           firstName()},
        files_(options.state_path, options.frames_folder, sessions_),
        volumes_(options, sessions_, *target_, files_),
        input_(*target_),
        log_(options.report_path),
        after_frame_(std::move(host.after_frame)) {
    if (first_view_) first_view_->state.region = options.region;
    if (first_) first_->source = firstName();
    if (first_)
      volumes_.show(*std::exchange(first_, std::nullopt), input_.size());
    else if (opens_beside_)
      volumes_.open(path_);
    else if (!player_)
      panel_->toggleOpening();
  }

  void run() {
    begin_ = clockSeconds();
    while (!closing_) {
      if (options_.cancel != nullptr) options_.cancel->check();
      takeEvents();
      const bool works = volumes_.busy() || unwritten() > 0;
      if (!closing_ && (awake() || works || !input_.empty())) frame();
    }
    log_.writeReport(target_->renderer().deviceName(), status());
  }

 private:
  // As the user named it.
  const std::string& firstName() const {
    return options_.step_names.empty() ? path_ : options_.step_names.front();
  }
  ViewSession* session() const { return volumes_.session(); }
  bool awaitsClick() const { return session() != nullptr && session()->awaitsClick(); }
  bool awake() const {
    return player_ || clockSeconds() < awake_until_ || files_.unwrittenPictures() > 0 ||
           !volumes_.shown().settled() || volumes_.goesOnInTime() ||
           (session() != nullptr && session()->interaction().flying);
  }
  bool settled() const { return volumes_.settled() && unwritten() == 0; }
  std::size_t unwritten() const { return files_.unwrittenMeshes() + files_.unwrittenPictures(); }
  ScriptSight whatIsThere() const {
    return {settled(), volumes_.showsPreview() && volumes_.shown().settled()};
  }
  SessionStatus status() const {
    return session() != nullptr ? session()->status() : SessionStatus{};
  }
  ViewState& state() { return session() != nullptr ? session()->state() : input_.idleState(); }
  SceneArea area() const { return input_.areas(session()).scene; }
  OutputFiles::Sight sight() {
    return {*target_,        session(), volumes_.opened(), state(), input_.width(),
            input_.height(), drawn_};
  }

  void takeEvents() {
    const double wait = !awake() ? kIdleSeconds : drawn_ ? 0.0 : kHiddenSeconds;
    if (input_.take(wait)) awake_until_ = clockSeconds() + kStayAwakeSeconds;
  }

  // After the loss of a context, by a driver that was reset or by a script: all its objects are
  // made again from the shown state. A driver may need seconds until it makes another context.
  void renewContext() {
    if (++losses_ > kMostLosses)
      throw Error("the graphics driver was reset " + std::to_string(kMostLosses) +
                  " times without drawing a frame; 'isobrick render' draws pictures");
    volumes_.shown().suspend();
    files_.suspend();
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
    volumes_.shown().resume(target_->renderer());
  }

  void frame() {
    const double begin = clockSeconds();
    volumes_.take(input_.size(), player_ && player_->keepsPreview(),
                  player_ ? std::optional(path_) : std::nullopt);
    ScriptFrame scripted;
    if (file_again_ && settled())
      scripted.file = std::exchange(file_again_, std::nullopt);
    else if (player_ && !file_again_ && !awaitsClick())
      scripted = player_->next(begin - begin_, whatIsThere(), state());
    if (scripted.state) {
      state() = *scripted.state;
      if (session() != nullptr) session()->keepFocus();
    }
    if (scripted.size) target_->resize(scripted.size->width, scripted.size->height);
    input_.add(scripted.events);
    refuseUnchosen(scripted);
    try {
      if (scripted.lose_context || target_->renderer().isLost()) renewContext();
      showFrame(begin, scripted);
      losses_ = 0;
    } catch (const RendererLost&) {
      renewContext();
      file_again_ = scripted.file;
    }
    const bool ends = player_ && scripted.finished && !file_again_ && unwritten() == 0;
    closing_ = closing_ || ends;
  }

  // A script that goes on without a volume, since it chooses none of several.
  void refuseUnchosen(const ScriptFrame& scripted) const {
    const bool needs_volume =
        scripted.file ? scripted.file->what != ScriptFile::What::kFrame : scripted.finished;
    if (player_ && session() == nullptr && needs_volume && volumes_.asks())
      throw Error(volumes_.status().refusal);
  }

  void showFrame(double begin, const ScriptFrame& scripted) {
    addWishes(takeInput(begin), wishes_);
    ReportedFrame report;
    UploadAllowance allowance;
    volumes_.shown().update(begin, allowance);
    files_.goOn(begin, target_->renderer(), allowance);
    const double idle = waitForSurface(allowance, report.waits);
    const double drawing = clockSeconds();
    drawn_ = draw();
    if (drawn_)
      panel_->draw();
    else
      panel_->discard();
    const double drawn_by = clockSeconds();
    if (scripted.file) files_.write(*scripted.file, sight());  // from the frame shown next
    const double written = clockSeconds();
    if (drawn_) target_->show();
    const double draw_seconds = drawn_by - drawing + clockSeconds() - written;
    if (drawn_ && session() != nullptr)
      session()->noteDrawing(draw_error_.empty() ? std::optional(draw_seconds) : std::nullopt);
    report.seconds = begin - begin_;
    report.times = {drawing - begin - idle, draw_seconds};
    report.uploaded_bytes = kUploadBytes - allowance.bytes;
    remember(std::move(report));
    grantWishes();
    if (after_frame_) after_frame_(session(), settled());
  }

  Wishes takeInput(double seconds) {
    panel_->setScale(target_->scale());  // the window may have moved to another screen
    Wishes wishes = input_.pass(*panel_, session(), seconds);
    if (first_view_ && session() != nullptr && input_.height() > 0) {
      session()->show(first_view_->state);
      first_view_.reset();
    }
    files_.takeDone();
    if (player_ && !files_.meshError().empty()) throw Error(files_.meshError());
    const std::string& failure = draw_error_.empty() ? files_.meshError() : draw_error_;
    addWishes(panel_->build(
                  session(),
                  {log_.latest(), files_.message(), target_->renderer().deviceName(),
                   volumes_.status(), volumes_.error(), volumes_.recent(), files_.meshUnderWay(),
                   failure, guard_.question(), files_.views(), volumes_.steps()},
                  input_.areas(session())),
              wishes);
    return wishes;
  }

  // While the frame may upload more bytes. Returns the seconds in which nothing was done.
  double waitForSurface(UploadAllowance& allowance, std::vector<SurfaceWait>& waits) {
    double idle = 0.0;
    const auto note = [&] {
      waits.insert(waits.end(), session()->waits().begin(), session()->waits().end());
    };
    if (session() == nullptr) return idle;
    for (note(); session()->drawsBetterLater() && allowance.bytes > 0; note()) {
      const double begin = clockSeconds();
      const std::uint64_t left = allowance.bytes;
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
      const double looked = clockSeconds();
      allowance.addWaited(looked - begin);
      volumes_.shown().update(looked, allowance);
      const bool nothing_came = allowance.bytes == left && session()->waits().empty();
      idle += (nothing_came ? clockSeconds() : looked) - begin;
    }
    return idle;
  }

  // False if there is no room for a picture. One that cannot be drawn, for want of memory, is
  // empty, and tried again with the next frame.
  bool draw() {
    if (input_.width() < 1 || input_.height() < 1) return false;
    try {
      scene_drawn_ = drawScene();
      target_->presentNothing(input_.width(), input_.height());
      target_->present(area().left, area().bottom);
      draw_error_.clear();
    } catch (const RendererLost&) {
      throw;
    } catch (const Error& error) {
      scene_drawn_ = true;
      draw_error_ = error.what();
      target_->presentNothing(input_.width(), input_.height());
    }
    return true;
  }

  // False if the renderer still has the scene's picture.
  bool drawScene() {
    if (session() != nullptr) return session()->draw();
    SceneFrame frame;
    frame.width = std::max(1, area().width);
    frame.height = std::max(1, area().height);
    frame.background_top = input_.idleState().background_top;
    frame.background_bottom = input_.idleState().background_bottom;
    target_->renderer().draw(frame);
    return true;
  }

  void grantWishes() {
    Wishes wishes = std::exchange(wishes_, {});
    // A picture needs a frame.
    if (!drawn_) {
      wishes_.screenshot = std::exchange(wishes.screenshot, false);
      wishes_.screenshot_exr = std::exchange(wishes.screenshot_exr, false);
    }
    const Stakes at_stake = files_.stakes(wishes, guard_.question().has_value());
    wishes = guard_.pass(std::move(wishes), at_stake);
    files_.grant(wishes, sight());
    if (wishes.browse) panel_->toggleOpening();
    volumes_.grant(wishes, input_.size());
    closing_ = closing_ || wishes.close;
  }

  void remember(ReportedFrame frame) {
    if (!options_.report_path.empty()) {
      const SessionStatus now = status();
      frame.scene_drawn = drawn_ && scene_drawn_;
      frame.surface_age = now.surface_age;
      frame.shown_radius = now.shown_radius;
      frame.triangles = now.triangles;
      frame.triangles_made = now.triangles_made;
    }
    log_.add(std::move(frame));
  }

  static constexpr int kMostLosses = 10;

  const ViewOptions& options_;
  std::optional<SavedView> first_view_;
  const std::string path_;  // to begin with
  const bool opens_beside_;
  std::optional<OpenedVolume> first_;
  std::optional<ScriptPlayer> player_;
  // In this order: the context goes last.
  std::unique_ptr<ViewTarget> target_;
  std::unique_ptr<ViewPanel> panel_;
  const SessionOptions sessions_;  // with one budget
  OutputFiles files_;
  OpenVolumes volumes_;
  InputRouter input_;
  FrameLog log_;
  const std::function<void(ViewSession*, bool)> after_frame_;

  double begin_ = 0.0, awake_until_ = 0.0;
  bool drawn_ = true;        // in the last frame
  bool scene_drawn_ = true;  // the same, not only shown again
  bool closing_ = false;
  std::optional<ScriptFile> file_again_;  // that a loss kept from being written
  int losses_ = 0;                        // of the context, since a frame was whole
  Wishes wishes_;                         // that were not granted yet
  WishGuard guard_;
  std::string draw_error_;
};

}  // namespace

void runView(const ViewOptions& options, ViewHost host) {
  ViewLoop(options, std::move(host)).run();
}

}  // namespace isobrick
