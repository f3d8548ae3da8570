// Wishes that would lose something wait for the user's word.
#pragma once

#include <cstddef>
#include <optional>
#include <string>

#include "isobrick/viewer/state/interaction.h"

namespace isobrick {

struct Stakes {
  std::size_t unwritten_meshes = 0;    // by leaving
  std::size_t unwritten_pictures = 0;  // likewise
  // By saving the view: this file, which the window has not written itself; empty: nothing.
  std::string other_view = {};

  std::size_t unwritten() const { return unwritten_meshes + unwritten_pictures; }
};

struct UserQuestion {
  std::string text;
  const char* yes = "";  // the names of the two answers
  const char* no = "";
};

// Asks one question at a time. It is withdrawn, and its wish granted, if nothing is at stake any
// longer.
class WishGuard {
 public:
  // The wishes of a frame, the answer among them; returns those to be granted now. A second wish to
  // leave is a yes.
  Wishes pass(Wishes wishes, const Stakes& stakes);
  const std::optional<UserQuestion>& question() const { return question_; }

 private:
  enum class Held { kNothing, kSave, kClose };
  void hold(Held held, UserQuestion question);

  Held held_ = Held::kNothing;
  std::optional<UserQuestion> question_;
};

// The view file that this window wrote last, and may replace.
class OwnViewFile {
 public:
  // Call it after the file was written.
  void noteWritten(const std::string& path);
  // Another volume is shown: its view is another one.
  void forget() { stamp_.clear(); }
  // There is a file of this name, and it is not as it was written here.
  bool isOther(const std::string& path) const;

 private:
  std::string stamp_;  // path, time and size; empty: none was written
};

}  // namespace isobrick
