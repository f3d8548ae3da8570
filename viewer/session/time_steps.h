// The steps of a volume in time, a pyramid each, of which several stay open.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/viewer/session/volume_opener.h"

namespace isobrick {

// Belongs to one thread.
class TimeSteps {
 public:
  // `paths`: fewer than two: there are no steps. `most_open`: at a time, at least 2. `names`: as
  // the user named them; empty: by their paths.
  TimeSteps(std::vector<std::string> paths, std::size_t most_open,
            std::vector<std::string> names = {})
      : paths_(std::move(paths)),
        names_(names.empty() ? paths_ : std::move(names)),
        most_open_(most_open) {}

  int count() const { return paths_.size() > 1 ? static_cast<int>(paths_.size()) : 0; }
  const std::string& path(int step) const { return paths_[static_cast<std::size_t>(step)]; }
  const std::string& name(int step) const { return names_[static_cast<std::size_t>(step)]; }

  // A step that is open; none: it is to be opened, for which there is room now, and given to
  // keep(). `shown` stays open; those go first that play last after it.
  std::optional<OpenedVolume> find(int step, int shown);
  void keep(const OpenedVolume& opened) { open_.push_back(opened); }
  void closeAll() { open_.clear(); }
  std::size_t openCount() const { return open_.size(); }

 private:
  std::vector<std::string> paths_, names_;
  std::size_t most_open_;
  std::vector<OpenedVolume> open_;
};

}  // namespace isobrick
