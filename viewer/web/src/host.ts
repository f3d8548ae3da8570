// What controls and gestures see of the page.
import type { Vec3 } from './vector';
import type { ViewState, ViewVolume } from './view_state';

export type Place = readonly [number, number]; // normalised device coordinates

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
  // On the surface at a place: the view turns about it, or a tool takes it.
  focusAt(place: Place): void;
  pickAt(place: Place): void;
  act(action: Action): void;
}

export function element<T extends HTMLElement>(id: string): T {
  return document.getElementById(id) as T;
}
