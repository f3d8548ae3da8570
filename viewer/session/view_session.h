// A volume in view: events in, frames out, with extraction beside it. No window. A preview comes
// first while its pyramid is built.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/storage/pyramid.h"
#include "isobrick/viewer/picture_notes.h"
#include "isobrick/viewer/render/scene_renderer.h"
#include "isobrick/viewer/session/beside_volume.h"
#include "isobrick/viewer/session/drawn_scene.h"
#include "isobrick/viewer/session/mesh_queue.h"
#include "isobrick/viewer/session/opening_view.h"
#include "isobrick/viewer/session/piece_list.h"
#include "isobrick/viewer/session/plane_set.h"
#include "isobrick/viewer/session/scene_of_view.h"
#include "isobrick/viewer/session/session_status.h"
#include "isobrick/viewer/session/shown_volume.h"
#include "isobrick/viewer/session/surface_requests.h"
#include "isobrick/viewer/session/volume_opener.h"
#include "isobrick/viewer/state/interaction.h"
#include "isobrick/viewer/state/view_history.h"
#include "isobrick/viewer/stream/surface_set.h"
#include "isobrick/viewer/stream/value_histogram.h"

namespace isobrick {

struct SessionOptions {
  int threads = 1;                                 // of the extraction
  ChunkBudget gpu_budget{std::uint64_t{1} << 30};  // of the renderer
  // Given if the pyramid is a preview. It is then shown as fine as it is, whatever the view's
  // settings; view and volume() are those of the volume, but for the range of its values.
  std::optional<PreviewOf> preview_of = {};
  ViewRegion region = {};  // to begin with
  OpenMasks masks = {};    // of it, and of views that are shown later
  // Shown in the same world, each with a surface to begin with. They share the budget.
  std::vector<OpenedVolume> beside = {};
  std::string first = {};  // the source that these are for; others are shown as they are
  bool is_step = false;    // one of several in time; the region is that of all

  // Of a session that shows `opened`.
  SessionOptions of(const OpenedVolume& opened) const {
    SessionOptions options = *this;
    options.preview_of = opened.preview_of;
    options.is_step = opened.step.has_value();
    if (opened.source == first) return options;
    if (!options.is_step) options.region = {};
    options.beside.clear();
    return options;
  }
};

// Belongs to one thread, that of the renderer, which outlives it. Time is the caller's: seconds
// that run on. For each frame: apply() all events, change state() by the user's input, update()
// once or more often, draw().
class ViewSession {
 public:
  // Reads the histogram. Throws Error for a damaged one.
  ViewSession(std::shared_ptr<const Pyramid> pyramid, SceneRenderer& renderer,
              const SessionOptions& options);
  ViewSession(std::shared_ptr<const Pyramid> pyramid, ValueHistogram histogram,
              SceneRenderer& renderer, const SessionOptions& options);
  ~ViewSession();

  // May be changed between frames; update() brings it into its bounds. Until the user changes them,
  // focus and camera follow from what is shown (OpeningView).
  ViewState& state() { return state_; }
  // A view from a file, which is shown as it is.
  void show(const ViewState& state);
  // The state's focus is meant, however long its surface takes.
  void keepFocus() { opening_.keepFocus(); }
  const ViewState& state() const { return state_; }
  Interaction& interaction() { return interaction_; }
  const Interaction& interaction() const { return interaction_; }
  const ViewVolume& volume() const { return shown_.volume(); }
  const ValueHistogram& histogram() const { return histogram_; }
  // The same of the volume that the active surface is of.
  const ViewVolume& activeVolume() const { return activeShown().volume(); }
  const ValueHistogram& activeHistogram() const;
  // As the user named them.
  const std::vector<std::string>& besideSources() const { return beside_sources_; }
  const Pyramid& pyramid() const { return *shown_.pyramid(); }
  // About how many triangles the isosurface has at the detail that is shown; 0: not known.
  double predictedTriangles(double isovalue) const;

  // Nothing if the volume itself is shown.
  const std::optional<PreviewOf>& previewOf() const { return shown_.previewOf(); }
  // Goes on from `other`, which shows a preview of the same volume: with the current drag, the
  // camera, and all of the view that the user changed since it was opened. Or from another step of
  // time, with all of its view.
  void follow(const ViewSession& other);
  // True if something was shown, or there is nothing to show.
  bool hasShown() const { return requests_.hasShown(); }

  // The event's wishes to the caller; those about the view have been granted already.
  Wishes apply(const InputEvent& event, double seconds, bool on_panel);

  // Requests surfaces for the state and takes those that have come, within the frame's `allowance`.
  void update(double seconds, UploadAllowance& allowance);
  void update(double seconds) {
    UploadAllowance allowance;
    update(seconds, allowance);
  }
  // Gives back all that the renderer keeps, which may end then. Until resume(), which makes it
  // again, nothing else is called.
  void suspend();
  void resume(SceneRenderer& renderer);

  // Draws the chunks so far, with the size of the interaction; false if that size is 0, or the
  // renderer still has this very picture.
  bool draw();

  // The scene of a picture of this size, of which all is kept until the next update(). Surfaces and
  // slices are those of the window.
  SceneFrame pictureFrame(int width, int height) const;
  // A picture of this height has the surfaces and slices that the window has.
  bool showsTheSameAt(int height) const;
  PictureNotes notes() const;

  // How long the last frame took, with drawing and showing it: a slow picture gets coarser surfaces
  // during drags. None: it could not be drawn. Without effect if draw() did not have to.
  void noteDrawing(std::optional<double> seconds);
  // The scene draws slowly, and the surface of the latest request will soon be there: call update()
  // and this again before it is drawn once more.
  bool drawsBetterLater() const { return requests_.drawsBetterLater(); }

  // True if the scene is the one of the state, as fine as it will get, slices included.
  bool isFine() const;
  // Surfaces are coloured by their pieces, which are not all known yet.
  bool waitsForPieces() const { return pieces_.waits(); }
  // The card, or the budget, has no room for surfaces as fine as the view asks for.
  bool isOverBudget() const;
  // And the pieces are known, and the view is found that the volume opens with, for which frames
  // are drawn and noted.
  bool settled() const;
  // A click waits for the place that it hit, which the card says some moments later. Other events
  // come after its effect.
  bool awaitsClick() {
    takePoints();
    return !clicks_.empty();
  }
  SessionStatus status() const;
  // The values of the first and the last colour, if the shown surface is coloured by values.
  std::optional<std::array<double, 2>> valueWindow() const {
    return valueWindowOf(state_, valueRange());
  }
  // The least and the greatest possible value, likewise; both 0 if there are none.
  std::array<double, 2> valueRange() const {
    return valueRangeOf(state_, volume(), requests_.shown().pass().values);
  }
  // For the surfaces that the last update() began to show.
  const std::vector<SurfaceWait>& waits() const { return requests_.waits(); }

  // The flat views of the slices; update() samples what is wanted there.
  SliceViews& sliceViews() { return slice_views_; }

  // The pieces of the active surface, for a list; the user's choice of them is in the state.
  PieceList& pieces() { return pieces_; }
  const PieceList& pieces() const { return pieces_; }
  // Lists them as they are now. With a point, the piece there is selected when the list is there.
  void listPieces(const std::optional<glm::dvec3>& point);
  // False: the list is of another isovalue than the active surface has now.
  bool piecesAreCurrent() const;
  // Of the active surface only the selected piece stays, or this one is hidden too. No effect
  // without a piece; if kMostSeeds are hidden already, the status says so.
  void keepSelectedPiece();
  void hideSelectedPiece();
  // Its measures go into the state, if there is room.
  void measureSelectedPiece();
  // The volume that a listed piece encloses on the active surface's inner side; none: it is open.
  std::optional<double> volumeOf(const SurfaceComponent& piece) const;

  // The lists of pieces that are known, whoever asked for them.
  const KnownComponents& known() const { return *known_; }

  // The surface under the cursor, for the line at the foot, if the view is at rest; none if there
  // is background. It is read back, for which no frame waits, once for a place and a frame that
  // stay the same; until then it is what was read last of that frame.
  std::optional<glm::dvec3> surfaceUnderCursor();

  // The active surface, as fine as the view's settings, for a MeshQueue. Throws Error if its volume
  // is not open.
  MeshOrder meshOrder(const std::string& path) const;
  // Writes the mesh that is on the screen now, all surfaces, as it was drawn; to look for faults.
  // Waits for it. Throws Error.
  void writeShownMesh(const std::string& path) const;

 private:
  void grantView(const Wishes& wishes);
  // Clicks on a surface, which are granted when its place is read back.
  enum class ClickedFor { kFocus, kMeasure, kPiece };
  void ask(ClickedFor what, const glm::dvec2& pixel);
  void takePoints();
  void grant(ClickedFor what, const glm::dvec3& point);
  void updateOpening();
  void updatePieces(double seconds);
  SurfaceWish wish() const;
  SurfaceWish wishOf(const BesideVolume& beside) const {
    return beside.wishOf(state_, volume(), interaction_.size.y);
  }
  // The volume beside that the active surface is of; null: it is of the session's own.
  const BesideVolume* activeBeside() const;
  const ShownVolume& activeShown() const;
  ViewVolume volumeOfKeys() const;
  std::vector<ColoredPieces> coloredPieces() const;
  std::optional<WorldBox> shownBox() const;
  SceneFrame sceneNow(int width, int height) const;

  const ShownVolume shown_;
  const ValueHistogram histogram_;
  const OpenMasks masks_;
  SceneRenderer* renderer_;
  ViewState state_;
  OpeningView opening_;
  ViewHistory history_;
  Interaction interaction_;
  double last_update_ = 0.0;
  DrawnScene scene_;
  std::optional<ViewState> drawn_state_;        // of the last draw()
  bool drew_ = false;                           // the renderer, in the last draw()
  std::map<std::uint64_t, ClickedFor> clicks_;  // by question, until its answer
  // What was read last under the cursor, of the frame drawn last.
  struct UnderCursor {
    glm::dvec2 cursor{0.0};
    std::uint64_t question = 0;  // the latest; it has its answer if 0
    std::optional<glm::dvec3> point;
  };
  std::optional<UnderCursor> under_cursor_;
  // By surface; null until it is there. Empty: no colours of pieces.
  std::vector<std::shared_ptr<const ListedComponents>> colored_by_;
  bool hides_no_more_ = false;  // the last piece to be hidden was one too many

  const std::shared_ptr<KnownComponents> known_;
  // Last: their threads use the pyramid.
  SurfaceRequests requests_;
  PlaneSet planes_;
  SliceViews slice_views_;
  PieceList pieces_;
  std::vector<std::string> beside_sources_;
  std::vector<std::unique_ptr<BesideVolume>> beside_;
};

// Belongs to one thread, that of the renderer, which outlives it.
class VolumeShow {
 public:
  explicit VolumeShow(const SessionOptions& options) : options_(options) {}

  // The session that is shown; null: nothing is open.
  ViewSession* session() const { return shown_ ? shown_->session.get() : nullptr; }
  // The pyramid that it was made of; null likewise.
  const OpenedVolume* opened() const { return shown_ ? &shown_->opened : nullptr; }
  bool showsPreview() const { return shown_ && shown_->opened.preview_of; }

  static constexpr double kStepSeconds = 0.1;  // for which a step of time is shown at least

  // A window of `size` pixels, or 0 while there is none, shows it: at once, or, after a preview of
  // the same volume or another step of time, once it is as fine as it gets, or the user changes
  // the surface. A step that plays is then that of the view.
  void take(OpenedVolume opened, SceneRenderer& renderer, const glm::dvec2& size);
  // What would follow the shown volume does not.
  void dropNext() { next_.reset(); }
  // No volume will follow the previews: shows again the volume before them.
  void giveUpPreview(SceneRenderer& renderer, const glm::dvec2& size);

  // As those of ViewSession; the shown session and the next one share `allowance`.
  void update(double seconds, UploadAllowance& allowance);
  void suspend();
  void resume(SceneRenderer& renderer);
  // True if nothing is about to replace the shown volume, and that is as fine as it gets.
  bool settled() const { return !next_ && (!shown_ || shown_->session->settled()); }

 private:
  struct Showing {
    OpenedVolume opened;
    std::unique_ptr<ViewSession> session;
  };
  struct Aside {
    OpenedVolume opened;
    ViewState state;
  };
  Showing showingOf(OpenedVolume opened, SceneRenderer& renderer) const;
  void close();
  void open(OpenedVolume opened, SceneRenderer& renderer, const glm::dvec2& size);

  const SessionOptions options_;
  double shown_since_ = 0.0;
  std::optional<Showing> shown_, next_;
  std::optional<Aside> aside_;  // the volume shown before the previews
};

}  // namespace isobrick
