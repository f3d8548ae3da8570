// The interface over the picture, and the context of Dear ImGui that it is drawn with.
#pragma once

#include <imgui.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/viewer/render/gl_handle.h"
#include "isobrick/viewer/session/folder_listing.h"
#include "isobrick/viewer/session/plane_set.h"
#include "isobrick/viewer/session/session_status.h"
#include "isobrick/viewer/session/view_session.h"
#include "isobrick/viewer/session/volume_opener.h"
#include "isobrick/viewer/session/wish_guard.h"
#include "isobrick/viewer/state/interaction.h"
#include "isobrick/viewer/stream/latest_worker.h"
#include "isobrick/viewer/stream/plane_sampler.h"
#include "isobrick/viewer/window/output_files.h"
#include "isobrick/viewer/window/view_target.h"

namespace isobrick {

// In pixels of an ordinary screen.
inline constexpr double kPanelWidth = 330.0;
inline constexpr double kStatusHeight = 28.0;  // of the line at the foot

// The scene, in pixels of the window from its left and its lower edge.
struct SceneArea {
  int left = 0, bottom = 0, width = 0, height = 0;
};

// The panel's width, pixels; in a small window half is left for the scene.
inline double panelWidth(double window_width, double scale) {
  return std::max(1.0, std::min(scale * kPanelWidth, 0.5 * window_width));
}

// The scene and, if they are shown, the flat views of the slices along x, y and z of the world.
struct WindowAreas {
  SceneArea scene;
  std::array<SceneArea, 3> slices = {};
};

// Beside the panel, if that is shown, and over the line at the foot; with slices the scene is the
// upper right quarter, axial, coronal and sagittal slices (across z, y and x) are at the upper
// left, the lower left and the lower right. Areas are empty if the window is.
inline WindowAreas windowAreas(int window_width, int window_height, double scale, bool with_panel,
                               bool with_slices) {
  WindowAreas areas;
  SceneArea& all = areas.scene;
  all.left = with_panel ? static_cast<int>(panelWidth(window_width, scale)) : 0;
  all.bottom = std::min(static_cast<int>(scale * kStatusHeight), window_height / 2);
  all.width = std::max(0, window_width - all.left);
  all.height = std::max(0, window_height - all.bottom);
  if (!with_slices) return areas;
  const int gap = std::max(1, static_cast<int>(2.0 * scale));
  const int width = std::max(0, (all.width - gap) / 2),
            height = std::max(0, (all.height - gap) / 2);
  const int right = all.left + all.width - width, top = all.bottom + all.height - height;
  areas.slices = {SceneArea{right, all.bottom, width, height},
                  SceneArea{all.left, all.bottom, width, height},
                  SceneArea{all.left, top, width, height}};
  areas.scene = {right, top, width, height};
  return areas;
}

// A picture on the graphics card, for ImGui::Image(). One at a time on the thread of the current
// context, which outlives it.
class PanelTexture {
 public:
  // The pixels of a picture that has at least one. Its size may change from call to call.
  void set(const PictureBytes& picture);
  ImTextureID id() const;
  bool isEmpty() const { return width_ == 0; }

 private:
  GlTexture texture_;
  int width_ = 0, height_ = 0;
};

// With Dear ImGui, between its begin and its end of a frame. `hovers`: the cursor is over the
// scene, which is in `area` of the window.
void buildOverlay(ViewSession& session, float scale, bool hovers, const SceneArea& area);

// Used by ViewPanel between its begin() and draw(). Folders are listed in the background.
class OpenPanel {
 public:
  OpenPanel();

  bool visible = false;

  // `recent`: absolute paths, latest first.
  Wishes build(double scale, const std::vector<std::string>& recent);

 private:
  void goTo(const std::string& folder);
  void takeListing();
  Wishes entries(float width);

  FolderListing listing_;
  bool listed_ = false;
  std::string error_;
  std::string typed_;
  LatestWorker<std::string, FolderListing> lister_;
};

// Lists the volumes in what is being opened, to choose one with the mouse, or with the arrow keys
// and Enter; Esc opens none.
class ChoicePanel {
 public:
  Wishes build(const VolumeOpener::Status& opening, double scale);

 private:
  int at_ = 0;  // the marked line
};

// Builds the part of the panel with the named views of the volume.
class ViewsPanel {
 public:
  Wishes build(const NamedViews& views, float scale);

 private:
  Wishes line(const std::string& view);

  std::array<char, 128> typed_{};  // the name of the next one
  std::string removing_;           // the view that the user was asked about
};

// Builds the flat views of the slices beside the scene, each a window of Dear ImGui.
class SlicesPanel {
 public:
  // Applies the user's changes to the session's state. `areas`: of the views along x, y and z of
  // the world, in pixels of the window.
  void build(ViewSession& session, float scale, const std::array<SceneArea, 3>& areas);

 private:
  struct Look {
    std::uint64_t number = 0;  // SliceViews::Shown::number
    std::array<double, 2> window{};
    std::vector<SliceContour> contours;

    bool operator==(const Look&) const = default;
  };
  struct Picture {
    Look look;
    PanelTexture texture;
  };
  const PanelTexture& pictureOf(int view, const SliceViews::Shown& shown, const ViewState& state,
                                float scale);
  void input(ViewSession& session, const SliceFrame& frame, const ImVec2& corner);
  void notes(const ViewSession& session, const SliceFrame& frame, const SliceViews::Shown* shown,
             const ImVec2& corner, const ImVec2& size, float scale) const;

  std::array<Picture, kSliceViews> pictures_;
  int first_ = 0;           // view of this frame, so that each has its turn
  bool has_drawn_ = false;  // a picture in this frame
};

struct PanelFacts {
  const std::deque<FrameTimes>& frames;  // the last ones
  std::string message;                   // the last result: a file that was written
  std::string device;                    // that draws
  VolumeOpener::Status opening;
  std::string open_error;  // why the last opening ended without a volume; empty: it did not
  const std::vector<std::string>& recent;  // volumes opened last
  std::string writing;                     // the mesh under way; empty: none
  std::string failure;                     // beside the session's: of a mesh, of the drawing
  const std::optional<UserQuestion>& question;
  const NamedViews& views;
  int steps = 0;  // of time; 0: there are none
};

// Asks in the middle of the window; Enter is a yes, Esc a no. The answer is a wish.
Wishes buildQuestion(const std::optional<UserQuestion>& question);

// Figures, into the window of Dear ImGui that is being built.
void buildStatistics(const ViewSession& session, const PanelFacts& facts, float scale);

// Builds the line at the foot and, above it, why the last opening ended without a volume.
class StatusPanel {
 public:
  // `session`: null: nothing is open. `hovers`: the cursor is over the scene.
  Wishes build(ViewSession* session, const PanelFacts& facts, float scale, bool hovers);

 private:
  void sessionLine(ViewSession& session, const PanelFacts& facts, float scale, bool hovers);

  std::string hover_;  // the position under the cursor
};

// One at a time, on the thread of the current context, while that context lives. For each frame:
// feed() its events, begin(), build(), draw().
class ViewPanel {
 public:
  // `clipboard` outlives it. Throws Error if ImGui cannot use the context.
  ViewPanel(double scale, Clipboard& clipboard);
  ~ViewPanel();
  ViewPanel(const ViewPanel&) = delete;
  ViewPanel& operator=(const ViewPanel&) = delete;

  // Of the screen that the window is on now. Between two frames.
  void setScale(double scale);
  void feed(const InputEvent& event);
  void begin(int width, int height, double seconds);
  // Whether events of the mouse, and this one of the keyboard, are the panel's in this frame: a
  // field has its keys, and a question that is shown all of them.
  bool wantsMouse() const;
  bool wants(const InputEvent& key) const;
  // Applies the user's changes to the session's state; null if no volume is open.
  Wishes build(ViewSession* session, const PanelFacts& facts, const WindowAreas& areas);
  // The list of volumes to open, on and off.
  void toggleOpening() { open_panel_.visible = !open_panel_.visible; }
  // Into the framebuffer that is bound.
  void draw();
  // Call it instead of draw() if there is no picture.
  void discard();

 private:
  Wishes panel(ViewSession& session, const PanelFacts& facts);

  double scale_;
  double still_seconds_ = 0.0;  // of the mouse (panel_tools.h)
  bool asks_ = false;           // a question or a choice, in the last frame
  Clipboard& clipboard_;
  std::string pasted_;  // for ImGui, until the next call
  // Of this frame: ImGui looks at keys once in a frame, so a tap is shown to it in two of them.
  std::vector<Key> pressed_, released_;
  StatusPanel status_;
  OpenPanel open_panel_;
  ChoicePanel choice_panel_;
  ViewsPanel views_panel_;
  SlicesPanel slices_panel_;
};

}  // namespace isobrick
