// Of the page, for buttons and keys alike.
export type Action =
  | 'undo' | 'redo' | 'frame' | 'first' | 'full' | 'help' | 'hide' | 'link' | 'play' | 'next-step'
  | 'save-png' | 'save-glb' | 'save-stl' | 'save-view' | 'distance' | 'angle' | 'back' | 'end';

export function element<T extends HTMLElement>(id: string): T {
  return document.getElementById(id) as T;
}
