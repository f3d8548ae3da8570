#include "isobrick/viewer/session/wish_guard.h"

#include <sys/stat.h>

#include <utility>

#include "isobrick/storage/file_system.h"

namespace isobrick {
namespace {

std::string stampOf(const std::string& path) {
  struct stat status = {};
  if (stat(path.c_str(), &status) != 0) return {};
  return path + '\n' + std::to_string(status.st_mtim.tv_sec) + '.' +
         std::to_string(status.st_mtim.tv_nsec) + '\n' + std::to_string(status.st_size);
}

}  // namespace

Wishes WishGuard::pass(Wishes wishes, const Stakes& stakes) {
  const bool is_safe = held_ == Held::kSave ? stakes.other_view.empty()
                                            : held_ == Held::kClose && stakes.unwritten() == 0;
  const bool agrees =
      is_safe || wishes.answer.value_or(false) || (held_ == Held::kClose && wishes.close);
  if (held_ != Held::kNothing && (agrees || wishes.answer)) {
    const Held held = std::exchange(held_, Held::kNothing);
    question_.reset();
    if (agrees) {
      (held == Held::kSave ? wishes.save_state : wishes.close) = true;
      return wishes;
    }
  }
  if (wishes.close && stakes.unwritten() > 0) {
    wishes.close = false;
    const bool several = stakes.unwritten() > 1;
    const std::string kind = stakes.unwritten_pictures == 0 ? "mesh"
                             : stakes.unwritten_meshes == 0 ? "picture"
                                                            : "file";
    hold(Held::kClose, {(several ? std::to_string(stakes.unwritten()) + " " + kind +
                                       (kind == "mesh" ? "es are" : "s are")
                                 : "A " + kind + " is") +
                            " not written yet. Leave without " + (several ? "them?" : "it?"),
                        "leave", "stay"});
  }
  if (wishes.save_state && !stakes.other_view.empty()) {
    wishes.save_state = false;
    if (held_ == Held::kNothing)
      hold(Held::kSave, {stakes.other_view + " exists. Replace it?", "replace", "keep"});
  }
  return wishes;
}

void WishGuard::hold(Held held, UserQuestion question) {
  held_ = held;
  question_ = std::move(question);
}

void OwnViewFile::noteWritten(const std::string& path) { stamp_ = stampOf(path); }

bool OwnViewFile::isOther(const std::string& path) const {
  return isPresent(path) && (stamp_.empty() || stamp_ != stampOf(path));
}

}  // namespace isobrick
