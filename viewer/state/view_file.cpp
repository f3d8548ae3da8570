#include "isobrick/viewer/state/view_file.h"

#include <filesystem>
#include <nlohmann/json.hpp>

#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/remote_options.h"
#include "isobrick/viewer/state/text_file.h"
#include "isobrick/viewer/state/view_state_json.h"

namespace isobrick {
namespace {

using ViewJson = nlohmann::ordered_json;

bool isPathOfFile(const std::string& name) {
  return !name.empty() && !isRemotePath(name) && name.rfind("phantom:", 0) != 0;
}

std::filesystem::path folderOfView(const std::string& path) {
  return absolutePath(path).parent_path();
}

// As it stands in a view that lies in `folder`.
std::string writtenPath(const std::string& name, const std::filesystem::path& folder) {
  if (!isPathOfFile(name)) return name;
  const std::filesystem::path whole = absolutePath(name);
  const std::filesystem::path part = whole.lexically_relative(folder);
  return part.empty() || *part.begin() == ".." ? whole.string() : part.string();
}

std::string readPath(const std::string& name, const std::filesystem::path& folder) {
  return isPathOfFile(name) ? (folder / name).lexically_normal().string() : name;
}

std::string wholeName(const std::string& name) {
  return isPathOfFile(name) ? absolutePath(name).string() : name;
}

// Takes the fields that are not the state's.
std::string takeVolume(ViewJson& json) {
  if (!json.is_object()) return {};
  if (json.contains("version")) {
    const ViewJson& version = json["version"];
    if (!version.is_number_integer()) throw Error("the view's 'version' is not a whole number");
    if (version > kViewVersion)
      throw Error("the view's 'version' is later than " + std::to_string(kViewVersion) +
                  "; a newer isobrick reads it");
    json.erase("version");
  }
  if (!json.contains("volume")) return {};
  if (!json["volume"].is_string()) throw Error("the view's 'volume' is not a text");
  const std::string volume = json["volume"].get<std::string>();
  json.erase("volume");
  return volume;
}

SavedView viewFromJson(const std::string& text) {
  ViewJson json = ViewJson::parse(text, nullptr, false);
  if (json.is_discarded()) throw Error("the view is not JSON");
  const std::string volume = takeVolume(json);
  return {volume, viewStateFromJson(json.dump())};
}

}  // namespace

SavedView readView(const std::string& path) {
  const std::string text = readTextFile(path, "view");
  try {
    SavedView view = viewFromJson(text);
    const std::filesystem::path folder = folderOfView(path);
    view.volume = readPath(view.volume, folder);
    view.state.values.other = readPath(view.state.values.other, folder);
    return view;
  } catch (const Error& error) {
    throw Error("'" + path + "': " + error.what() + "; correct it or save the view anew", {path});
  }
}

void writeView(const std::string& path, const SavedView& view) {
  const std::filesystem::path folder = folderOfView(path);
  ViewState state = view.state;
  state.values.other = writtenPath(state.values.other, folder);
  ViewJson json = ViewJson::object();
  json["version"] = kViewVersion;
  json["volume"] = writtenPath(view.volume, folder);
  json.update(ViewJson::parse(viewStateToJson(state)));
  // A path may be no UTF-8, but JSON is always UTF-8.
  const std::string text = json.dump(2, ' ', false, ViewJson::error_handler_t::replace) + "\n";
  AtomicFile file(path);
  file.write(text.data(), text.size());
  file.commit();
}

bool isSameVolume(const std::string& a, const std::string& b) {
  return wholeName(a) == wholeName(b);
}

}  // namespace isobrick
