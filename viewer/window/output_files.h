// The files that the window writes: pictures, meshes, tables of measurements, views, and those of
// them that the user gave names to.
#pragma once

#include <cstddef>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/viewer/picture_writer.h"
#include "isobrick/viewer/session/mesh_queue.h"
#include "isobrick/viewer/session/view_script.h"
#include "isobrick/viewer/session/view_session.h"
#include "isobrick/viewer/session/volume_opener.h"
#include "isobrick/viewer/session/wish_guard.h"
#include "isobrick/viewer/state/view_file.h"
#include "isobrick/viewer/stream/latest_worker.h"
#include "isobrick/viewer/view_picture.h"
#include "isobrick/viewer/window/view_target.h"

namespace isobrick {

// The folder for the named views of a volume: "scans/ct.views" for "scans/ct.nii.gz". For a volume
// that is no file here (a URL, a phantom) it is in the current folder.
std::string viewsFolderOf(const std::string& source);

// As the name of a view, `name` names a file. Empty: it can; else why not, and what to do.
std::string badViewName(const std::string& name);

// The views NAME.view.json of one folder: files as those of Ctrl+S, which `isobrick view` and
// `isobrick render` open with --state. The folder is made for the first view. It is read in the
// background, since it may be far away; files are written and removed at once. Used by one thread.
class NamedViews {
 public:
  static constexpr std::size_t kMostViews = 200;  // more in a folder are not shown

  NamedViews();

  // Shows the views of this folder, which need not exist.
  void open(const std::string& folder);
  void update();

  // In order.
  const std::vector<std::string>& names() const { return names_; }
  bool has(const std::string& name) const;
  // The first of "view 1", "view 2", ... that no view has.
  std::string freeName() const;
  // The name of the view after `name`, and after the last one the first; empty: there are none.
  std::string nextTo(const std::string& name) const;
  // Of the last reading of the folder; empty: it went well.
  const std::string& error() const { return error_; }

  // Replaces the view of that name. Throws Error.
  void save(const std::string& name, const SavedView& view);
  SavedView read(const std::string& name) const;
  // Throws Error.
  void remove(const std::string& name);

  std::string pathOf(const std::string& name) const;

 private:
  void add(const std::string& name);

  std::string folder_;
  std::vector<std::string> names_;
  std::string error_;
  LatestWorker<std::string, std::vector<std::string>> lister_;
};

struct PictureOrder {
  OpenedVolume opened;  // shared until its picture is written
  ViewState state;
  int width = 1, height = 1;  // pixels
  std::string path;
  bool must_be = false;  // the program ends if it cannot be written
};

// A picture has surfaces and slices of its own, extracted for its size, beside those of the window,
// so it is the one that `isobrick render --state` draws, whatever the user does meanwhile. A frame
// uploads some of them, or draws a tile; a thread writes. Used by the thread of the renderer.
class PictureQueue {
 public:
  struct Outcome {
    std::string path;
    std::string error;  // empty: the file is there
    bool must_be = false;
  };

  // `options`: of the window's sessions too, with which the pictures share the budget.
  explicit PictureQueue(const SessionOptions& options) : options_(options) {}

  void add(PictureOrder order) { waiting_.push_back(std::move(order)); }
  // For each frame, with its time and what it leaves of its allowance. Returns an order that ended.
  // Throws RendererLost.
  std::optional<Outcome> update(double seconds, SceneRenderer& renderer,
                                UploadAllowance& allowance);
  // Gives back all that the renderer keeps, which may end then; the picture begins again.
  void suspend();

  // Orders that have not ended.
  std::size_t unwritten() const { return waiting_.size(); }
  const std::string& underWay() const { return waiting_.front().path; }
  double share() const { return tiles_ ? tiles_->share() : writer_ ? 1.0 : 0.0; }
  bool willWrite(const std::string& path) const;

 private:
  // True if the first order has ended.
  bool goOn(double seconds, SceneRenderer& renderer, UploadAllowance& allowance);
  void end();

  const SessionOptions options_;
  std::deque<PictureOrder> waiting_;  // the first one is under way
  std::unique_ptr<ViewSession> session_;
  std::optional<PictureTiles> tiles_;  // goes before what it draws
  std::unique_ptr<PictureWriter> writer_;
};

// Names follow the volume that is shown. A file that cannot be written is told in message(), and
// the rest goes on; a script's ends the program.
class OutputFiles {
 public:
  // `state_path`: of the view of the volume that comes first; empty: named after it. Scripts write
  // into `frames_folder`. `options`: of the window's sessions.
  OutputFiles(std::string state_path, std::string frames_folder, const SessionOptions& options);

  struct Sight {
    ViewTarget& target;
    ViewSession* session = nullptr;        // null: nothing is open
    const OpenedVolume* opened = nullptr;  // likewise
    const ViewState& state;
    int width = 0, height = 0;  // of the window
    bool drawn = false;
  };

  // Another volume is shown, or a preview of it; `views_of`: the same or, of steps in time, which
  // share their views, the first one.
  void nameAfter(const std::string& source, const std::string& views_of);
  // What the user would lose by `wishes`. Looks at a file only if it matters, as a folder may be
  // far away: by these wishes, or since a question `is_open`.
  Stakes stakes(const Wishes& wishes, bool is_open) const;
  // Throws RendererLost.
  void grant(const Wishes& wishes, const Sight& sight);
  // Throws Error.
  void write(const ScriptFile& file, const Sight& sight);

  // For each frame: goes on with the pictures that are drawn beside the window. Throws
  // RendererLost, and Error if a script's cannot be written.
  void goOn(double seconds, SceneRenderer& renderer, UploadAllowance& allowance);
  // Gives back all that the renderer keeps of them, which may end then; they begin again.
  void suspend() { pictures_.suspend(); }
  std::size_t unwrittenPictures() const { return pictures_.unwritten(); }

  // Takes the meshes that were written since, and the list of views.
  void takeDone();
  std::size_t unwrittenMeshes() const { return meshes_.unwritten(); }
  // The mesh that is being written; empty: none.
  const std::string& meshUnderWay() const { return meshes_.underWay(); }
  // Of the last mesh; empty: it went well.
  const std::string& meshError() const { return mesh_error_; }

  const NamedViews& views() const { return views_; }

  const std::string& message() const { return message_; }
  void say(std::string message) { message_ = std::move(message); }

 private:
  // `must_be`: the program ends if it cannot be written.
  void writePicture(const std::string& path, const Sight& sight, bool must_be);
  void orderMesh(const std::string& path, const ViewSession& session);
  void writeMeasurements(const std::string& path, const ViewSession& session);
  void writeOwnView(const Sight& sight);
  void showSaved(const SavedView& view, const std::string& path, const Sight& sight);
  void grantViews(const Wishes& wishes, const Sight& sight);

  const std::string first_state_path_, frames_folder_;
  std::string stem_ = "isobrick", state_path_ = "isobrick.view.json";
  std::string named_after_;                  // the volume of the views
  std::optional<std::string> first_source_;  // the first of them
  OwnViewFile own_view_;
  NamedViews views_;
  std::string shown_view_;  // of these, the last one
  MeshQueue meshes_;
  PictureQueue pictures_;
  std::string message_, mesh_error_;
};

}  // namespace isobrick
