// Views one after the other, for undo and redo: viewer/state/view_history.h by the same rules. A
// view is remembered whenever it rests; all of a drag is one step.
import type { ViewState } from './view_state';

const kRestSeconds = 0.4;
const kMostViews = 200;

export class ViewHistory {
  private readonly views: ViewState[];
  private at = 0;
  private changing: ViewState | undefined;
  private changed = 0;

  constructor(first: ViewState) {
    this.views = [first];
  }

  // The view of this moment; `is_held`: the user drags. True: come back, as it is not remembered yet.
  note(view: ViewState, is_held: boolean, seconds: number): boolean {
    if (view === this.views[this.at]) {
      this.changing = undefined;
      return false;
    }
    if (is_held || view !== this.changing) {
      this.changing = view;
      this.changed = seconds;
    } else if (seconds - this.changed >= kRestSeconds) {
      this.remember(view);
      return false;
    }
    return true;
  }

  // Changes nothing that can be undone: the page chose it.
  replace(view: ViewState): void {
    this.views[this.at] = view;
  }

  undo(now: ViewState): ViewState {
    if (now !== this.views[this.at]) this.remember(now);
    this.at = Math.max(0, this.at - 1);
    return this.views[this.at]!;
  }

  redo(now: ViewState): ViewState {
    if (now !== this.views[this.at]) return now;
    this.at = Math.min(this.views.length - 1, this.at + 1);
    return this.views[this.at]!;
  }

  private remember(view: ViewState): void {
    this.changing = undefined;
    this.views.splice(this.at + 1, Infinity, view);
    if (this.views.length > kMostViews) this.views.shift();
    this.at = this.views.length - 1;
  }
}
