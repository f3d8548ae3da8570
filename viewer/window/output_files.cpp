#include "isobrick/viewer/window/output_files.h"

#include <algorithm>
#include <filesystem>
#include <system_error>
#include <utility>

#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/remote_options.h"
#include "isobrick/viewer/image.h"
#include "isobrick/viewer/session/folder_listing.h"
#include "isobrick/viewer/state/view_file.h"
#include "isobrick/viewer/view_picture.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kViewEnding = ".view.json";

std::vector<std::string> viewsIn(const std::string& folder, const CancelFlag& cancel) {
  std::vector<std::string> names;
  if (!isPresent(folder)) return {};
  const std::error_code failure = visitFolder(folder, [&](const FolderMember& member) {
    cancel.check();
    const std::string file = member.name();
    if (file.size() > kViewEnding.size() && file.ends_with(kViewEnding))
      names.push_back(file.substr(0, file.size() - kViewEnding.size()));
    return true;
  });
  if (failure)
    throw Error("cannot list the views in '" + folder + "': " + failure.message() +
                    "; check its permissions",
                {.path = folder});
  std::sort(names.begin(), names.end());
  if (names.size() > NamedViews::kMostViews) names.resize(NamedViews::kMostViews);
  return names;
}

SavedView viewOf(const OutputFiles::Sight& sight) {
  SavedView view{sight.opened != nullptr ? sight.opened->source : std::string(), sight.state};
  if (sight.session != nullptr) view.beside = sight.session->besideSources();
  return view;
}

}  // namespace

std::string viewsFolderOf(const std::string& source) {
  const std::string folder = stemOf(source) + ".views";
  if (isRemotePath(source) || !isPresent(source)) return folder;
  fs::path volume = absolutePath(source);
  if (!volume.has_filename()) volume = volume.parent_path();
  return (volume.parent_path() / folder).string();
}

std::string badViewName(const std::string& name) {
  constexpr std::size_t kMostBytes = 100;
  if (name.empty()) return "a view needs a name";
  if (name.size() > kMostBytes) return "this name is too long; take a shorter one";
  const bool is_file = name.front() != '.' && name.find('/') == std::string::npos &&
                       std::none_of(name.begin(), name.end(), [](char letter) {
                         return static_cast<unsigned char>(letter) < ' ';
                       });
  return is_file ? "" : "the name becomes that of a file: leave out '/' and a '.' in front";
}

NamedViews::NamedViews() : lister_(viewsIn) {}

void NamedViews::open(const std::string& folder) {
  if (folder == folder_) return;
  folder_ = folder;
  names_.clear();
  error_.clear();
  lister_.request(folder);
}

void NamedViews::update() {
  auto outcome = lister_.poll();
  if (!outcome) return;
  error_ = outcome->error;
  if (!outcome->result) return;
  // Some may have been saved while the folder was read.
  for (const std::string& name : *outcome->result) add(name);
}

bool NamedViews::has(const std::string& name) const {
  return std::binary_search(names_.begin(), names_.end(), name);
}

std::string NamedViews::freeName() const {
  for (int number = 1;; ++number) {
    std::string name = "view " + std::to_string(number);
    if (!has(name)) return name;
  }
}

std::string NamedViews::nextTo(const std::string& name) const {
  if (names_.empty()) return {};
  const auto next = std::upper_bound(names_.begin(), names_.end(), name);
  return next == names_.end() ? names_.front() : *next;
}

void NamedViews::save(const std::string& name, const SavedView& view) {
  if (const std::string bad = badViewName(name); !bad.empty()) throw Error(bad);
  if (const std::error_code failed = makeFolders(folder_))
    throw Error("cannot make the folder '" + folder_ + "' for views: " + failed.message() +
                    "; Ctrl+S writes the view into the current folder",
                {folder_});
  writeView(pathOf(name), view);
  add(name);
}

SavedView NamedViews::read(const std::string& name) const { return readView(pathOf(name)); }

void NamedViews::remove(const std::string& name) {
  if (const std::error_code failed = removeName(pathOf(name)))
    throw Error("cannot remove '" + pathOf(name) + "': " + failed.message(), {pathOf(name)});
  std::erase(names_, name);
}

std::string NamedViews::pathOf(const std::string& name) const {
  return (fs::path(folder_) / (name + std::string(kViewEnding))).string();
}

void NamedViews::add(const std::string& name) {
  const auto at = std::lower_bound(names_.begin(), names_.end(), name);
  if (at == names_.end() || *at != name) names_.insert(at, name);
}

bool PictureQueue::willWrite(const std::string& path) const {
  return std::any_of(waiting_.begin(), waiting_.end(),
                     [&](const PictureOrder& order) { return order.path == path; });
}

std::optional<PictureQueue::Outcome> PictureQueue::update(double seconds, SceneRenderer& renderer,
                                                          UploadAllowance& allowance) {
  if (waiting_.empty()) return std::nullopt;
  std::string error;
  try {
    if (!goOn(seconds, renderer, allowance)) return std::nullopt;
  } catch (const RendererLost&) {
    throw;
  } catch (const Error& failure) {
    error = failure.what();
  }
  end();
  const PictureOrder order = std::move(waiting_.front());
  waiting_.pop_front();
  return Outcome{order.path, error, order.must_be};
}

bool PictureQueue::goOn(double seconds, SceneRenderer& renderer, UploadAllowance& allowance) {
  const PictureOrder& order = waiting_.front();
  if (tiles_) {
    if (tiles_->done()) {
      tiles_.reset();
      session_.reset();
    } else if (writer_->hasRoom()) {
      if (auto rows = tiles_->drawNext()) writer_->add(std::move(*rows));
    }
    return false;
  }
  if (writer_) {
    if (!writer_->done()) return false;
    writer_->wait();
    return true;
  }
  if (!session_) {
    session_ = std::make_unique<ViewSession>(order.opened.file, order.opened.histogram, renderer,
                                             options_.of(order.opened));
    session_->apply(InputEvent::resized(order.width, order.height), seconds, false);
    session_->show(order.state);
  }
  session_->update(seconds, allowance);
  if (!session_->settled()) return false;
  const SessionStatus status = session_->status();
  if (!status.error.empty()) throw Error(status.error);
  if (session_->isOverBudget())
    throw Error(order.path +
                " is not written: its surfaces need more of the graphics card than those of the "
                "window leave; allow more ('isobrick view --gpu-memory SIZE'), or draw it alone "
                "('isobrick render --state')");
  const bool layers = imageFormatOf(order.path) == ImageFormat::kExr;
  tiles_.emplace(renderer, pictureSceneOf(*session_, order.width, order.height, layers));
  writer_ = std::make_unique<PictureWriter>(order.path, tiles_->shape());
  return false;
}

void PictureQueue::end() {
  tiles_.reset();
  session_.reset();
  writer_.reset();
}

void PictureQueue::suspend() {
  if (session_) session_->suspend();
  end();
}

OutputFiles::OutputFiles(std::string state_path, std::string frames_folder,
                         const SessionOptions& options)
    : first_state_path_(std::move(state_path)),
      frames_folder_(std::move(frames_folder)),
      meshes_(options.threads),
      pictures_(options) {}

void OutputFiles::nameAfter(const std::string& source, const std::string& views_of) {
  stem_ = stemOf(source);
  if (views_of != named_after_) own_view_.forget();
  views_.open(viewsFolderOf(views_of));
  named_after_ = views_of;
  // The view of `--state` is that of the volume that it was opened with.
  if (!first_source_) first_source_ = views_of;
  state_path_ = !first_state_path_.empty() && views_of == *first_source_
                    ? first_state_path_
                    : stemOf(views_of) + ".view.json";
}

Stakes OutputFiles::stakes(const Wishes& wishes, bool is_open) const {
  const bool matters = wishes.save_state || is_open;
  return {meshes_.unwritten(), pictures_.unwritten(),
          matters && own_view_.isOther(state_path_) ? state_path_ : std::string()};
}

void OutputFiles::goOn(double seconds, SceneRenderer& renderer, UploadAllowance& allowance) {
  if (pictures_.unwritten() == 0) return;
  const auto ended = pictures_.update(seconds, renderer, allowance);
  if (!ended) {
    message_ = "drawing " + pictures_.underWay() + ": " +
               std::to_string(static_cast<int>(100.0 * pictures_.share())) + " %";
    return;
  }
  if (ended->must_be && !ended->error.empty()) throw Error(ended->error);
  message_ = ended->error.empty() ? "wrote " + ended->path : ended->error;
}

void OutputFiles::takeDone() {
  views_.update();
  while (const auto mesh = meshes_.poll()) {
    mesh_error_ = mesh->error;
    if (mesh->error.empty()) message_ = "wrote " + mesh->path;
  }
}

void OutputFiles::grant(const Wishes& wishes, const Sight& sight) {
  try {
    const auto isOrdered = [&](const std::string& name) { return pictures_.willWrite(name); };
    if (wishes.screenshot) writePicture(freeName(stem_, ".png", isOrdered), sight, false);
    if (wishes.screenshot_exr) writePicture(freeName(stem_, ".exr", isOrdered), sight, false);
    if (sight.session == nullptr) return;
    if (wishes.export_mesh) {
      const auto isTaken = [&](const std::string& name) { return meshes_.willWrite(name); };
      orderMesh(freeName(stem_, ".ply", isTaken), *sight.session);
    }
    if (wishes.export_measurements) writeMeasurements(freeName(stem_, ".csv"), *sight.session);
    if (wishes.save_state) writeOwnView(sight);
    if (wishes.load_state) showSaved(readView(state_path_), state_path_, sight);
    grantViews(wishes, sight);
  } catch (const RendererLost&) {
    message_ = "the graphics driver was reset, and no picture was written";
    throw;
  } catch (const Error& error) {
    message_ = error.what();
  }
}

void OutputFiles::write(const ScriptFile& file, const Sight& sight) {
  const std::string path = (std::filesystem::path(frames_folder_) / file.name).string();
  switch (file.what) {
    case ScriptFile::What::kFrame:
      if (sight.drawn) writeImage(path, sight.target.screen(sight.width, sight.height));
      break;
    case ScriptFile::What::kPicture:
      if (sight.drawn) writePicture(path, sight, true);
      break;
    case ScriptFile::What::kMesh:
      if (sight.session != nullptr) orderMesh(path, *sight.session);
      break;
    case ScriptFile::What::kShownMesh:
      if (sight.session != nullptr) sight.session->writeShownMesh(path);
      break;
    case ScriptFile::What::kMeasurements:
      if (sight.session != nullptr) writeMeasurements(path, *sight.session);
      break;
    case ScriptFile::What::kState:
      writeView(path, viewOf(sight));
      break;
  }
}

// The scene without panels: at once if it is small and shows what the window shows.
void OutputFiles::writePicture(const std::string& path, const Sight& sight, bool must_be) {
  constexpr std::int64_t kMostAtOnce = 4'000'000;  // pixels
  if (sight.session == nullptr) {
    writeImage(path, sight.target.renderer().picture());
  } else {
    const std::string failure = sight.session->status().error;
    if (must_be && !failure.empty()) throw Error(failure);
    const int width = std::min(sight.state.pictures.times * sight.width, kMostPictureSide);
    const int height = std::min(sight.state.pictures.times * sight.height, kMostPictureSide);
    if (std::int64_t{width} * height > kMostAtOnce || !sight.session->showsTheSameAt(height))
      return pictures_.add({*sight.opened, sight.state, width, height, path, must_be});
    const bool layers = imageFormatOf(path) == ImageFormat::kExr;
    writeImage(path, drawWhole(sight.target.renderer(),
                               pictureSceneOf(*sight.session, width, height, layers)));
  }
  message_ = "wrote " + path;
}

void OutputFiles::orderMesh(const std::string& path, const ViewSession& session) {
  mesh_error_.clear();
  meshes_.add(session.meshOrder(path));
}

void OutputFiles::writeMeasurements(const std::string& path, const ViewSession& session) {
  const LengthUnit unit = session.pyramid().spec().geometry.unit;
  const ViewState& state = session.state();
  const std::string csv =
      measurementsCsv(state.measurements, unit) +
      pieceMeasuresCsv(state.piece_measures, state.measurements.size() + 1, unit);
  AtomicFile file(path);
  file.write(csv.data(), csv.size());
  file.commit();
  message_ = "wrote " + path;
}

void OutputFiles::writeOwnView(const Sight& sight) {
  writeView(state_path_, viewOf(sight));
  own_view_.noteWritten(state_path_);
  message_ = "wrote " + state_path_;
}

void OutputFiles::showSaved(const SavedView& view, const std::string& path, const Sight& sight) {
  sight.session->show(view.state);
  message_ = "read " + path;
  if (!view.volume.empty() && !isSameVolume(view.volume, sight.opened->source))
    message_ += ", a view of " + view.volume;
}

void OutputFiles::grantViews(const Wishes& wishes, const Sight& sight) {
  if (wishes.save_named_view) {
    const std::string name =
        wishes.save_named_view->empty() ? views_.freeName() : *wishes.save_named_view;
    views_.save(name, viewOf(sight));
    message_ = "wrote " + shortPath(views_.pathOf(name));
  }
  if (wishes.remove_named_view) {
    views_.remove(*wishes.remove_named_view);
    message_ = "removed " + shortPath(views_.pathOf(*wishes.remove_named_view));
  }
  if (!wishes.show_named_view) return;
  const bool is_next = wishes.show_named_view->empty();
  const std::string name = is_next ? views_.nextTo(shown_view_) : *wishes.show_named_view;
  if (name.empty()) {
    message_ = "no view has a name yet; Ctrl+Shift+S saves one";
    return;
  }
  shown_view_ = name;
  showSaved(views_.read(name), views_.pathOf(name), sight);
}

}  // namespace isobrick
