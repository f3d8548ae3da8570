#include "isobrick/viewer/window/output_files.h"

#include <algorithm>
#include <filesystem>
#include <utility>

#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/viewer/image.h"
#include "isobrick/viewer/session/output_names.h"
#include "isobrick/viewer/state/view_file.h"
#include "isobrick/viewer/view_picture.h"

namespace isobrick {
namespace {

SavedView viewOf(const OutputFiles::Sight& sight) {
  return {sight.opened != nullptr ? sight.opened->source : std::string(), sight.state};
}

// The scene with nothing over it, as large as a thumbnail. It is drawn anew, so the screen's is,
// too.
Image thumbnailOf(ViewSession& session) {
  const glm::dvec2 size = session.interaction().size;
  constexpr double kWidth = NamedViews::kThumbnailWidth;
  const double height = std::clamp(kWidth * size.y / std::max(1.0, size.x), 1.0, kWidth);
  ViewState& state = session.state();
  const ViewPictures pictures = std::exchange(state.pictures, {});
  try {
    Image image = pictureOf(session, {kWidth, height}, 1, false);
    state.pictures = pictures;
    session.draw();
    return image;
  } catch (...) {
    state.pictures = pictures;
    throw;
  }
}

}  // namespace

OutputFiles::OutputFiles(std::string state_path, std::string frames_folder, int threads)
    : first_state_path_(std::move(state_path)),
      frames_folder_(std::move(frames_folder)),
      meshes_(threads) {}

void OutputFiles::nameAfter(const std::string& source) {
  stem_ = stemOf(source);
  if (source != named_after_) own_view_.forget();
  views_.open(viewsFolderOf(source));
  named_after_ = source;
  // The view of `--state` is that of the volume that it was opened with.
  if (!first_source_) first_source_ = source;
  state_path_ = !first_state_path_.empty() && source == *first_source_ ? first_state_path_
                                                                       : stem_ + ".view.json";
}

Stakes OutputFiles::stakes(const Wishes& wishes, bool is_open) const {
  const bool matters = wishes.save_state || is_open;
  return {meshes_.unwritten(),
          matters && own_view_.isOther(state_path_) ? state_path_ : std::string()};
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
    if (wishes.screenshot) writePicture(freeName(stem_, ".png"), sight);
    if (wishes.screenshot_exr) writePicture(freeName(stem_, ".exr"), sight);
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
      if (sight.drawn) writePicture(path, sight);
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

// The scene without panels. It is drawn anew, so the screen's is, too, before it is shown.
void OutputFiles::writePicture(const std::string& path, const Sight& sight) {
  const bool layers = imageFormatOf(path) == ImageFormat::kExr;
  if (sight.session != nullptr) {
    writeImage(path, pictureOf(*sight.session, {sight.width, sight.height},
                               sight.state.pictures.times, layers));
    sight.session->draw();
  } else {
    writeImage(path, sight.target.renderer().picture());
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
      measurementsCsv(state.measurements, unit, session.paths().asked()) +
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
    views_.save(name, viewOf(sight), thumbnailOf(*sight.session));
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
