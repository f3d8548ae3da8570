// Mouse, fingers, wheel and keys over the scene, as viewer/state/interaction.cpp has them.
import { orbited, panned, zoomed, type Place } from './camera';
import type { Action } from './host';
import type { Page } from './page';
import { scale } from './vector';
import { activeSurface, bounded, replaced, withActive, withClipPlane, type ViewClipPlane } from './view_state';

const kDegreesPerPicture = 240; // a drag over the height of the picture
const kZoomPerNotch = 0.88;
const kRadiusPerNotch = 1.12;
const kClickPixels = 5;
const kDoubleClickMilliseconds = 400;
const kStepDegrees = 6; // of an arrow key

const kActions: Readonly<Record<string, Action>> = {
  f: 'frame', Home: 'first', h: 'help', d: 'distance', a: 'angle', p: 'save-png', j: 'play', k: 'next-step',
  Backspace: 'back', Escape: 'end',
};
const kDirections: Readonly<Record<string, readonly [number, number]>> = { '1': [0, 0], '3': [90, 0], '7': [0, 90] };
const kArrows: Readonly<Record<string, Place>> = {
  ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1],
};

export class Gestures {
  private readonly fingers = new Map<number, { x: number; y: number }>();
  private pressed: { x: number; y: number; moved: boolean } | undefined;
  private last_click = { x: 0, y: 0, at: -1e9 };
  private holds_control = false; // a wheel with Ctrl but without the key is a pinch on a touchpad

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly host: Page,
  ) {
    canvas.addEventListener('pointerdown', (event) => this.press(event));
    canvas.addEventListener('pointermove', (event) => this.move(event));
    for (const kind of ['pointerup', 'pointercancel'] as const)
      canvas.addEventListener(kind, (event) => this.release(event, kind === 'pointerup'));
    canvas.addEventListener('wheel', (event) => this.wheel(event), { passive: false });
    canvas.addEventListener('contextmenu', (event) => event.preventDefault());
    addEventListener('keydown', (event) => this.key(event));
    addEventListener('keyup', (event) => (this.holds_control &&= event.key !== 'Control'));
  }

  private placeOf(x: number, y: number): Place {
    const box = this.canvas.getBoundingClientRect();
    return [(2 * (x - box.left)) / box.width - 1, 1 - (2 * (y - box.top)) / box.height];
  }

  private press(event: PointerEvent): void {
    this.canvas.focus();
    this.canvas.setPointerCapture(event.pointerId);
    this.fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    this.pressed = { x: event.clientX, y: event.clientY, moved: this.fingers.size > 1 };
    this.host.hold(true);
  }

  private move(event: PointerEvent): void {
    const finger = this.fingers.get(event.pointerId);
    if (!finger || !this.pressed) return;
    const [dx, dy] = [event.clientX - finger.x, event.clientY - finger.y];
    const { x, y } = this.pressed;
    if (!this.pressed.moved && Math.hypot(event.clientX - x, event.clientY - y) <= kClickPixels) return;
    this.pressed.moved = true;
    const other = [...this.fingers].find(([id]) => id !== event.pointerId)?.[1];
    this.fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    const height = this.canvas.clientHeight;
    if (other) {
      // Each finger moves the middle of both by half.
      const before = Math.hypot(finger.x - other.x, finger.y - other.y);
      const after = Math.hypot(event.clientX - other.x, event.clientY - other.y);
      this.pan(0.5 * dx, 0.5 * dy);
      const middle = this.placeOf(0.5 * (event.clientX + other.x), 0.5 * (event.clientY + other.y));
      this.zoom(before / Math.max(1, after), middle);
    } else if (event.buttons & 4 || event.shiftKey) {
      this.pan(dx, dy);
    } else if (event.buttons & 2) {
      this.zoom(Math.exp((4 * dy) / height), this.placeOf(x, y));
    } else {
      const degrees = kDegreesPerPicture / height;
      const { state } = this.host;
      this.host.change({ ...state, camera: orbited(state.camera, -dx * degrees, dy * degrees) });
    }
  }

  private release(event: PointerEvent, is_click: boolean): void {
    this.fingers.delete(event.pointerId);
    if (this.fingers.size > 0) return;
    this.host.hold(false);
    if (!is_click || !this.pressed || this.pressed.moved || event.button !== 0) return;
    const place = this.placeOf(event.clientX, event.clientY);
    if (this.host.tool) return void this.host.take(place);
    const { x, y, at } = this.last_click;
    const is_near = Math.hypot(event.clientX - x, event.clientY - y) <= 4 * kClickPixels;
    const is_again = is_near && event.timeStamp - at <= kDoubleClickMilliseconds;
    if (is_again) void this.host.take(place);
    this.last_click = { x: event.clientX, y: event.clientY, at: is_again ? -1e9 : event.timeStamp };
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault();
    const notches = -event.deltaY / (event.deltaMode === WheelEvent.DOM_DELTA_PIXEL ? 100 : 3);
    if (event.ctrlKey && this.holds_control) return this.changeRadius(kRadiusPerNotch ** notches);
    this.zoom(kZoomPerNotch ** (event.ctrlKey ? 8 * notches : notches), this.placeOf(event.clientX, event.clientY));
  }

  private changeRadius(factor: number): void {
    const { state, volume } = this.host;
    const focus = { ...state.focus, everywhere: false, radius: state.focus.radius * factor };
    this.host.change(bounded({ ...state, focus }, volume));
  }

  private zoom(factor: number, place: Place): void {
    const { state, volume, aspect } = this.host;
    this.host.change({ ...state, camera: zoomed(state.camera, factor, place, aspect, volume.size()) });
  }

  private pan(dx: number, dy: number): void {
    const { state, aspect } = this.host;
    const shift: Place = [(2 * dx) / this.canvas.clientWidth, (-2 * dy) / this.canvas.clientHeight];
    this.host.change({ ...state, camera: panned(state.camera, shift, aspect) });
  }

  private key(event: KeyboardEvent): void {
    if (event.key === 'Control') this.holds_control = true;
    const target = event.target as HTMLElement;
    if (document.querySelector('dialog[open]') || target.matches('select, input:not([type=checkbox], [type=radio])'))
      return;
    if (this.pressKey(event, target === this.canvas)) event.preventDefault();
  }

  // True: it was for the scene. Arrows, signs and Enter are, if it has the focus.
  private pressKey(event: KeyboardEvent, is_here: boolean): boolean {
    const { host } = this;
    const { state, volume } = host;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const control = event.ctrlKey || event.metaKey;
    const direction = kDirections[key];
    const arrow = kArrows[key];
    if (control && (key === 'z' || key === 'y')) {
      host.act(key === 'y' || event.shiftKey ? 'redo' : 'undo');
    } else if (direction) {
      const [azimuth, elevation] = direction;
      const opposite = key === '7' ? { azimuth, elevation: -90 } : { azimuth: azimuth === 0 ? 180 : -90, elevation };
      host.change({ ...state, camera: { ...state.camera, ...(control ? opposite : { azimuth, elevation }) } });
    } else if (control || event.altKey) {
      return false;
    } else if (is_here && arrow && event.shiftKey) {
      this.pan((-arrow[0] * this.canvas.clientWidth) / 20, (arrow[1] * this.canvas.clientHeight) / 20);
    } else if (is_here && arrow) {
      host.change({ ...state, camera: orbited(state.camera, kStepDegrees * arrow[0], kStepDegrees * arrow[1]) });
    } else if (is_here && (key === '+' || key === '=' || key === '-')) {
      this.zoom(kZoomPerNotch ** (key === '-' ? -1 : 1), [0, 0]);
    } else if (is_here && key === 'Enter') {
      void host.take([0, 0]);
    } else if (kActions[key]) {
      host.act(kActions[key]);
    } else if (key === 'x' || key === 'y' || key === 'z') {
      host.change(withClipPlane(state, 'xyz'.indexOf(key), volume));
    } else if (key === 'i') {
      const planes = state.clip_planes;
      const last = planes.at(-1);
      if (last) host.change({ ...state, clip_planes: replaced(planes, planes.length - 1, turnedRound(last)) });
    } else if (key === 'c') {
      host.change({ ...state, coloring: state.coloring === 'level' ? 'plain' : 'level' });
    } else if (key === 'o') {
      host.change({ ...state, camera: { ...state.camera, orthographic: !state.camera.orthographic } });
    } else if (key === 'r') {
      const { isovalues } = host.active.facts;
      const next = isovalues.indexOf(activeSurface(state).isovalue) + 1;
      const isovalue = isovalues[next % isovalues.length];
      if (isovalue !== undefined) host.change(withActive(state, { isovalue }));
    } else {
      return false;
    }
    return true;
  }
}

export const turnedRound = ({ normal, offset }: ViewClipPlane): Partial<ViewClipPlane> => ({
  normal: scale(normal, -1),
  offset: -offset,
});
