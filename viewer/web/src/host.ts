// What controls and gestures see of the page.
import type { Place } from './camera';
import type { Vec3 } from './vector';
import type { ViewState, ViewVolume } from './view_state';

// Of the page, for buttons and keys alike.
export type Action =
  | 'undo' | 'redo' | 'frame' | 'first' | 'full' | 'help' | 'hide' | 'link'
  | 'save-png' | 'save-glb' | 'save-stl' | 'save-view' | 'distance' | 'angle' | 'back' | 'end';

export interface Host {
  readonly state: ViewState;
  readonly volume: ViewVolume;
  readonly aspect: number;
  readonly tool: 'distance' | 'angle' | undefined;
  readonly picked: readonly Vec3[];
  // The next view; it is drawn with the next frame, and what it lacks is asked for.
  change(next: ViewState): void;
  // A drag begins or ends: all of it is one step of undo.
  hold(is_held: boolean): void;
  // The point of the surface at a place: the tool takes it or, if there is none, the view turns about it.
  take(place: Place): void;
  act(action: Action): void;
}

export function element<T extends HTMLElement>(id: string): T {
  return document.getElementById(id) as T;
}
