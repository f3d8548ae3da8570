// The views of a volume that the user gave names to: files in a folder beside it.
#pragma once

#include <string>
#include <vector>

#include "isobrick/viewer/state/view_file.h"
#include "isobrick/viewer/stream/latest_worker.h"

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
  // Takes the list when it is there.
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

}  // namespace isobrick
