#include "isobrick/viewer/window/named_views.h"

#include <algorithm>
#include <filesystem>
#include <system_error>
#include <utility>

#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/remote_options.h"
#include "isobrick/viewer/png_reader.h"
#include "isobrick/viewer/session/output_names.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kViewEnding = ".view.json";

std::string thumbnailPath(const std::string& folder, const std::string& name) {
  return (fs::path(folder) / (name + ".png")).string();
}

PictureBytes thumbnailOf(const std::string& path) {
  constexpr int kMostSide = 1024;
  try {
    return readPng(path, kMostSide);
  } catch (const Error&) {
    return {};  // the view counts without it
  }
}

std::vector<NamedView> viewsIn(const std::string& folder, const CancelFlag& cancel) {
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
  std::vector<NamedView> views;
  for (std::string& name : names) {
    cancel.check();
    PictureBytes thumbnail = thumbnailOf(thumbnailPath(folder, name));
    views.push_back({std::move(name), std::move(thumbnail), 0});
  }
  return views;
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
  views_.clear();
  error_.clear();
  lister_.request(folder);
}

void NamedViews::update() {
  auto outcome = lister_.poll();
  if (!outcome) return;
  error_ = outcome->error;
  if (!outcome->result) return;
  // What was saved while the folder was read is newer than what was read.
  for (NamedView& view : *outcome->result)
    if (!has(view.name)) add(std::move(view));
}

bool NamedViews::has(const std::string& name) const {
  return std::any_of(views_.begin(), views_.end(),
                     [&](const NamedView& view) { return view.name == name; });
}

std::string NamedViews::freeName() const {
  for (int number = 1;; ++number) {
    std::string name = "view " + std::to_string(number);
    if (!has(name)) return name;
  }
}

std::string NamedViews::nextTo(const std::string& name) const {
  if (views_.empty()) return {};
  const auto next = std::find_if(views_.begin(), views_.end(),
                                 [&](const NamedView& view) { return view.name > name; });
  return (next == views_.end() ? views_.front() : *next).name;
}

void NamedViews::save(const std::string& name, const SavedView& view, const Image& thumbnail) {
  if (const std::string bad = badViewName(name); !bad.empty()) throw Error(bad);
  if (const std::error_code failed = makeFolders(folder_))
    throw Error("cannot make the folder '" + folder_ + "' for views: " + failed.message() +
                    "; Ctrl+S writes the view into the current folder",
                {folder_});
  writeImage(thumbnailPath(folder_, name), thumbnail);
  writeView(pathOf(name), view);
  drop(name);
  add({name, thumbnailOf(thumbnailPath(folder_, name)), 0});
}

SavedView NamedViews::read(const std::string& name) const { return readView(pathOf(name)); }

void NamedViews::remove(const std::string& name) {
  if (const std::error_code failed = removeName(pathOf(name)))
    throw Error("cannot remove '" + pathOf(name) + "': " + failed.message(), {pathOf(name)});
  removeName(thumbnailPath(folder_, name));
  drop(name);
}

std::string NamedViews::pathOf(const std::string& name) const {
  return (fs::path(folder_) / (name + std::string(kViewEnding))).string();
}

void NamedViews::add(NamedView view) {
  view.number = ++last_number_;
  const auto after = std::find_if(views_.begin(), views_.end(),
                                  [&](const NamedView& other) { return other.name > view.name; });
  views_.insert(after, std::move(view));
}

void NamedViews::drop(const std::string& name) {
  std::erase_if(views_, [&](const NamedView& view) { return view.name == name; });
}

}  // namespace isobrick
