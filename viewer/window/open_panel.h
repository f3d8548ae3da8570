// Where volumes to open are chosen: what was opened last, and a folder. Knows Dear ImGui, with its
// source.
#pragma once

#include <string>
#include <vector>

#include "isobrick/viewer/session/folder_listing.h"
#include "isobrick/viewer/state/interaction.h"
#include "isobrick/viewer/stream/latest_worker.h"

namespace isobrick {

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

}  // namespace isobrick
