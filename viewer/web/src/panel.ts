// The controls beside the scene (page/index.html): they show the view, and change it.
import { element } from './host';
import type { Action, Host } from './host';
import { turnedRound } from './gestures';
import { Histogram } from './histogram';
import { measurementText, shortNumber } from './overlay';
import type { VolumeFacts } from './protocol';
import type { Vec3 } from './vector';
import { cornersOf, dot, mapped } from './vector';
import type { ViewState } from './view_state';
import { activeSurface, bounded, kMostSurfaces, kSurfaceColors, withActive, withClipPlane } from './view_state';

const kActions: readonly Action[] = [
  'undo', 'redo', 'frame', 'full', 'help', 'hide', 'link',
  'save-png', 'save-glb', 'save-stl', 'save-view', 'distance', 'angle',
];

const toHex = (color: Vec3): string =>
  '#' + color.map((share) => Math.round(255 * share).toString(16).padStart(2, '0')).join('');
const fromHex = (text: string): Vec3 =>
  mapped([0, 1, 2], (i) => Number((parseInt(text.slice(1 + 2 * i, 3 + 2 * i), 16) / 255).toPrecision(4)));

// Of a list in a state, without element i.
const without = <T>(list: readonly T[], i: number): T[] => list.filter((_, at) => at !== i);
const replaced = <T>(list: readonly T[], i: number, change: Partial<T>): T[] =>
  list.map((item, at) => (at === i ? { ...item, ...change } : item));

export class Panel {
  private readonly histogram: Histogram;

  constructor(private readonly host: Host) {
    const isovalue = (value: number): void => {
      if (Number.isFinite(value)) this.change((state) => withActive(state, { isovalue: value }));
    };
    this.histogram = new Histogram(element('histogram'), isovalue, (is_held) => host.hold(is_held));
    for (const action of kActions) element(action).addEventListener('click', () => host.act(action));
    const number = element<HTMLInputElement>('isovalue');
    number.addEventListener('change', () => isovalue(number.valueAsNumber));
    this.checked('everywhere', (state, everywhere) => ({ ...state, focus: { ...state.focus, everywhere } }));
    this.checked('by-level', (state, on) => ({ ...state, coloring: on ? 'level' : 'plain' }));
    this.checked('orthographic', (state, orthographic) => ({ ...state, camera: { ...state.camera, orthographic } }));
    const radius = element<HTMLInputElement>('radius');
    this.slides(radius, (state, share) => ({
      ...state,
      focus: { ...state.focus, everywhere: false, radius: host.volume.diagonal() ** share },
    }));
    ['clip-x', 'clip-y', 'clip-z'].forEach((id, axis) =>
      element(id).addEventListener('click', () => this.change((state) => withClipPlane(state, axis, host.volume))),
    );
    element('add-surface').addEventListener('click', () =>
      this.change((state) => {
        const color = kSurfaceColors.find((c) => !state.surfaces.some((s) => toHex(s.color) === toHex(c)));
        const free = host.volume.isovalues.find((value) => !state.surfaces.some((s) => s.isovalue === value));
        const more = { ...activeSurface(state), color: color ?? kSurfaceColors[1]! };
        const surfaces = [...state.surfaces, { ...more, isovalue: free ?? more.isovalue }];
        return { ...state, surfaces, active_surface: surfaces.length - 1 };
      }),
    );
  }

  show(facts: VolumeFacts): void {
    const { state, volume } = this.host;
    this.histogram.show(facts, state);
    const field = (id: string): HTMLInputElement => element<HTMLInputElement>(id);
    if (document.activeElement !== field('isovalue'))
      field('isovalue').value = String(Number(activeSurface(state).isovalue.toPrecision(7)));
    field('everywhere').checked = state.focus.everywhere;
    field('by-level').checked = state.coloring === 'level';
    field('orthographic').checked = state.camera.orthographic;
    field('radius').valueAsNumber = Math.log(state.focus.radius) / Math.log(volume.diagonal());
    field('radius').setAttribute('aria-valuetext', `${shortNumber(state.focus.radius)} voxels`);
    for (const tool of ['distance', 'angle'] as const)
      element(tool).setAttribute('aria-pressed', String(this.host.tool === tool));
    element<HTMLButtonElement>('add-surface').disabled = state.surfaces.length === kMostSurfaces;
    const suggestions = element('suggestions');
    if (suggestions.childElementCount !== volume.isovalues.length)
      suggestions.replaceChildren(
        ...volume.isovalues.map((value) => {
          const button = document.createElement('button');
          button.textContent = shortNumber(value);
          button.onclick = () => this.change((now) => withActive(now, { isovalue: value }));
          return button;
        }),
      );
    this.showSurfaces(state);
    this.showPlanes(state);
    this.showMeasures(state);
  }

  private showSurfaces(state: ViewState): void {
    const items = this.items('surfaces', 'surface', state.surfaces.length, (item, i) => {
      const set = (change: Partial<ViewState['surfaces'][number]>): void =>
        this.change((now) => ({ ...now, surfaces: replaced(now.surfaces, i, change) }));
      on(item, '[type=radio]', 'change', () => this.change((now) => ({ ...now, active_surface: i })));
      on(item, '[type=color]', 'input', ({ value }) => set({ color: fromHex(value) }));
      on(item, '.opacity', 'input', ({ valueAsNumber }) => set({ opacity: valueAsNumber }));
      on(item, '.visible', 'change', ({ checked }) => set({ visible: checked }));
      on(item, '.remove', 'click', () =>
        this.change((now) => {
          const active = now.active_surface - (i < now.active_surface ? 1 : 0);
          return bounded({ ...now, surfaces: without(now.surfaces, i), active_surface: active }, this.host.volume);
        }),
      );
    });
    state.surfaces.forEach((surface, i) => {
      const item = items[i]!;
      input(item, '[type=radio]').checked = i === state.active_surface;
      item.querySelector('output')!.textContent = shortNumber(surface.isovalue);
      input(item, '[type=color]').value = toHex(surface.color);
      input(item, '.opacity').valueAsNumber = surface.opacity;
      input(item, '.visible').checked = surface.visible;
      item.querySelector<HTMLButtonElement>('.remove')!.disabled = state.surfaces.length === 1;
    });
  }

  private showPlanes(state: ViewState): void {
    // Where the volume begins and ends along a normal.
    const rangeOf = (normal: Vec3): [number, number] => {
      const places = cornersOf(this.host.volume.box()).map((corner) => dot(normal, corner));
      return [Math.min(...places), Math.max(...places)];
    };
    const items = this.items('planes', 'plane', state.clip_planes.length, (item, i) => {
      const set = (change: (p: ViewState['clip_planes'][number]) => Partial<typeof p>): void =>
        this.change((now) => ({
          ...now,
          clip_planes: replaced(now.clip_planes, i, change(now.clip_planes[i]!)),
        }));
      on(item, '.offset', 'input', ({ valueAsNumber }) =>
        set(({ normal }) => {
          const [least, most] = rangeOf(normal);
          return { offset: least + valueAsNumber * (most - least) };
        }),
      );
      on(item, '.enabled', 'change', ({ checked }) => set(() => ({ enabled: checked })));
      on(item, '.cap', 'change', ({ checked }) => set(() => ({ cap: checked })));
      on(item, '.turn', 'click', () => set(turnedRound));
      on(item, '.remove', 'click', () => this.change((now) => ({ ...now, clip_planes: without(now.clip_planes, i) })));
    });
    state.clip_planes.forEach((plane, i) => {
      const item = items[i]!;
      const axis = plane.normal.findIndex((value) => Math.abs(value) === 1);
      const [least, most] = rangeOf(plane.normal);
      const name = axis < 0 ? 'oblique' : `${plane.normal[axis]! > 0 ? '+' : '−'}${'xyz'[axis]}`;
      item.querySelector('output')!.textContent = name;
      input(item, '.offset').valueAsNumber = (plane.offset - least) / (most - least);
      input(item, '.enabled').checked = plane.enabled;
      input(item, '.cap').checked = plane.cap;
    });
  }

  private showMeasures(state: ViewState): void {
    const items = this.items('measures', 'measure', state.measurements.length, (item, i) =>
      on(item, '.remove', 'click', () =>
        this.change((now) => ({ ...now, measurements: without(now.measurements, i) })),
      ),
    );
    state.measurements.forEach((measurement, i) => {
      items[i]!.querySelector('output')!.textContent = measurementText(measurement, this.host.volume.unit);
    });
  }

  // The items of a list, of which each is made once, so that the focus stays where it is.
  private items(list: string, template: string, count: number, made: (item: HTMLElement, i: number) => void): HTMLElement[] {
    const place = element(list);
    while (place.childElementCount > count) place.lastElementChild!.remove();
    while (place.childElementCount < count) {
      const item = element<HTMLTemplateElement>(template).content.firstElementChild!.cloneNode(true) as HTMLElement;
      made(item, place.childElementCount);
      place.append(item);
    }
    return [...place.children] as HTMLElement[];
  }

  private change(next: (state: ViewState) => ViewState): void {
    this.host.change(bounded(next(this.host.state), this.host.volume));
  }
  private checked(id: string, next: (state: ViewState, on: boolean) => ViewState): void {
    const box = element<HTMLInputElement>(id);
    box.addEventListener('change', () => this.change((state) => next(state, box.checked)));
  }
  private slides(range: HTMLInputElement, next: (state: ViewState, value: number) => ViewState): void {
    range.addEventListener('input', () => this.change((state) => next(state, range.valueAsNumber)));
  }
}

const input = (item: HTMLElement, which: string): HTMLInputElement => item.querySelector<HTMLInputElement>(which)!;
const on = (item: HTMLElement, which: string, event: string, f: (from: HTMLInputElement) => void): void =>
  input(item, which).addEventListener(event, () => f(input(item, which)));
