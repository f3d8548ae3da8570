#include "isobrick/viewer/state/view_history.h"

namespace isobrick {

void ViewHistory::note(const ViewState& view, bool is_held, double seconds) {
  if (views_.empty()) return remember(view);
  if (view == views_[at_]) {
    changing_.reset();
    return;
  }
  if (is_held || !changing_ || view != *changing_) {
    changing_ = view;
    changed_ = seconds;
  } else if (seconds - changed_ >= kRestSeconds) {
    remember(view);
  }
}

std::optional<ViewState> ViewHistory::undo(const ViewState& now) {
  if (views_.empty()) return std::nullopt;
  if (now != views_[at_]) remember(now);
  if (at_ == 0) return std::nullopt;
  return views_[--at_];
}

std::optional<ViewState> ViewHistory::redo(const ViewState& now) {
  // After another change there is nothing to come back to.
  if (views_.empty() || now != views_[at_] || at_ + 1 == views_.size()) return std::nullopt;
  return views_[++at_];
}

void ViewHistory::remember(const ViewState& view) {
  changing_.reset();
  if (!views_.empty()) views_.resize(at_ + 1);
  views_.push_back(view);
  if (views_.size() > kMostViews) views_.pop_front();
  at_ = views_.size() - 1;
}

}  // namespace isobrick
