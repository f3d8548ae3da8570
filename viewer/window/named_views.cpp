#include "isobrick/viewer/window/named_views.h"

#include <algorithm>
#include <filesystem>
#include <system_error>

#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/remote_options.h"
#include "isobrick/viewer/session/folder_listing.h"

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

}  // namespace isobrick
