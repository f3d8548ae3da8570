#include "isobrick/viewer/state/wishes.h"

namespace isobrick {

void addWishes(const Wishes& more, Wishes& wishes) {
  const auto join = [](bool one, bool& other) { other = other || one; };
  if (more.focus_at) wishes.focus_at = more.focus_at;
  if (more.measure_at) wishes.measure_at = more.measure_at;
  if (more.piece_at) wishes.piece_at = more.piece_at;
  if (more.open) wishes.open = more.open;
  if (more.answer) wishes.answer = more.answer;
  if (more.save_named_view) wishes.save_named_view = more.save_named_view;
  if (more.show_named_view) wishes.show_named_view = more.show_named_view;
  if (more.remove_named_view) wishes.remove_named_view = more.remove_named_view;
  join(more.keep_piece, wishes.keep_piece);
  join(more.hide_piece, wishes.hide_piece);
  join(more.frame_surfaces, wishes.frame_surfaces);
  join(more.first_view, wishes.first_view);
  join(more.undo, wishes.undo);
  join(more.redo, wishes.redo);
  join(more.screenshot, wishes.screenshot);
  join(more.screenshot_exr, wishes.screenshot_exr);
  join(more.save_state, wishes.save_state);
  join(more.load_state, wishes.load_state);
  join(more.export_mesh, wishes.export_mesh);
  join(more.export_measurements, wishes.export_measurements);
  join(more.close, wishes.close);
  join(more.browse, wishes.browse);
  join(more.stop_opening, wishes.stop_opening);
}

}  // namespace isobrick
