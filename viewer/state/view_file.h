// A saved view: the state as JSON text, and the volume that it was saved of. Ctrl+S writes the
// file,
// `--state` opens it.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "isobrick/viewer/state/view_state.h"

namespace isobrick {

// `what` it is, for the error: "view". Throws Error if it cannot be read.
std::string readTextFile(const std::string& path, const char* what);

// Every field of ViewState under its own name; doubles come back to the bit.
std::string viewStateToJson(const ViewState& state);

// Fields that the text lacks keep their defaults, but a camera without a distance is not placed:
// isPlaced(). Throws Error, in one line that names the field,
// for text that is no JSON, an unknown field, and a value of another type or out of its range.
ViewState viewStateFromJson(const std::string& text);

inline constexpr int kViewVersion = 1;
inline constexpr std::size_t kMostVolumes = 8;  // of a scene

struct SavedView {
  // As the user named it: a path, a URL, a phantom; empty: the file does not say it.
  std::string volume;
  ViewState state;
  std::vector<std::string> beside = {};  // the volumes 1, 2, ... of its surfaces
};

// JSON with `version`, `volume`, `beside` and every field of the state. Files without these are
// read too. Paths below the folder of the file are relative to it there, so that both can be moved;
// other paths are absolute. Those that come back are absolute, whatever the current folder is.
//
// Throws Error, in one line that names the file, and the field if one is wrong.
SavedView readView(const std::string& path);
// The file appears, in the place of an older one, when it is complete.
void writeView(const std::string& path, const SavedView& view);

// As a view that is read has it: a path is absolute.
std::string wholeName(const std::string& name);
// True for two names of one volume, by path.
bool isSameVolume(const std::string& a, const std::string& b);

}  // namespace isobrick
