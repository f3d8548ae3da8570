#include "isobrick/viewer/session/time_steps.h"

#include <algorithm>

namespace isobrick {

std::optional<OpenedVolume> TimeSteps::find(int step, int shown) {
  for (const OpenedVolume& opened : open_)
    if (opened.step == step) return opened;
  const auto stepsAhead = [&](const OpenedVolume& opened) {
    return (*opened.step - shown + count()) % count();
  };
  while (open_.size() >= most_open_) open_.erase(std::ranges::max_element(open_, {}, stepsAhead));
  return std::nullopt;
}

}  // namespace isobrick
