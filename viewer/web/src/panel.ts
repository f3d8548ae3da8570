// The controls beside the scene (page/index.html): they show the view, and change it. An input with
// `data-field` in a line of a list is that field of the line's surface or plane; a button with
// `data-acts` is the action of its id.
import { turnedRound } from './gestures';
import { Histogram } from './histogram';
import { element, type Action } from './host';
import { measurementText, shortNumber } from './overlay';
import type { Page } from './page';
import { cornersOf, dot, mapped, type Vec3 } from './vector';
import { activeSurface, bounded, kMostSurfaces, kMostVolumes, replaced, withActive, withClipPlane } from './view_state';
import { withSurface, type ViewClipPlane, type ViewState } from './view_state';

const field = (id: string): HTMLInputElement => element<HTMLInputElement>(id);
const toHex = (color: Vec3): string =>
  '#' + color.map((share) => Math.round(255 * share).toString(16).padStart(2, '0')).join('');
const fromHex = (text: string): Vec3 =>
  mapped([0, 1, 2], (i) => Number((parseInt(text.slice(1 + 2 * i, 3 + 2 * i), 16) / 255).toPrecision(4)));
const valueOf = (input: HTMLInputElement): unknown =>
  input.type === 'checkbox' ? input.checked : input.type === 'color' ? fromHex(input.value) : input.valueAsNumber;

function showValue(input: HTMLInputElement, value: unknown): void {
  if (input.type === 'checkbox') input.checked = value as boolean;
  else if (input.type === 'color') input.value = toHex(value as Vec3);
  else input.valueAsNumber = value as number;
}

// Made anew if they are others alone, so that the focus stays where it is.
function showChildren(place: HTMLElement, children: HTMLElement[]): void {
  const textOf = (list: Iterable<Element>): string => [...list].map((child) => child.outerHTML).join();
  if (textOf(place.children) !== textOf(children)) place.replaceChildren(...children);
}

type ListName = 'surfaces' | 'clip_planes' | 'measurements';

export class Panel {
  private readonly histogram: Histogram;

  constructor(private readonly host: Page) {
    const choose = (isovalue: number): void => {
      if (Number.isFinite(isovalue)) this.change((state) => withActive(state, { isovalue }));
    };
    this.histogram = new Histogram(element('histogram'), choose, (is_held) => host.hold(is_held));
    for (const button of document.querySelectorAll('[data-acts]'))
      button.addEventListener('click', () => host.act(button.id as Action));
    element('full').hidden = !document.fullscreenEnabled;
    field('isovalue').addEventListener('change', () => choose(field('isovalue').valueAsNumber));
    this.listen('everywhere', (state, { checked }) => ({ ...state, focus: { ...state.focus, everywhere: checked } }));
    this.listen('by-level', (state, { checked }) => ({ ...state, coloring: checked ? 'level' : 'plain' }));
    this.listen('orthographic', (state, box) => ({ ...state, camera: { ...state.camera, orthographic: box.checked } }));
    this.listen('radius', (state, { valueAsNumber }) => {
      const radius = host.volume.diagonal() ** valueAsNumber;
      return { ...state, focus: { ...state.focus, everywhere: false, radius } };
    });
    ['clip-x', 'clip-y', 'clip-z'].forEach((id, axis) =>
      element(id).addEventListener('click', () => this.change((state) => withClipPlane(state, axis, host.volume))),
    );
    element('add-surface').addEventListener('click', () => this.change((state) => withSurface(state, host.active)));
    element('add-volume').addEventListener('click', () => host.addVolume(Number(field('other-volume').value)));
    this.listen('step', (state, { valueAsNumber }) => ({ ...state, step: valueAsNumber }));
    field('step').max = String(host.entries.length - 1);
    element('time').hidden = !host.are_steps;
    element('suggestions').addEventListener('click', ({ target }) => choose(Number((target as HTMLButtonElement).value)));
  }

  show(): void {
    const { state, volume, active, tool, entries, ids } = this.host;
    const nameOf = (id: number): string => entries[id]!.name;
    this.histogram.show(active.facts, state);
    element('isovalue-of').textContent = ids.length > 1 ? active.facts.name : '';
    const suggested = active.facts.isovalues.map((value) =>
      Object.assign(document.createElement('button'), { textContent: shortNumber(value), value: String(value) }),
    );
    showChildren(element('suggestions'), suggested);
    field('step').valueAsNumber = state.step;
    field('step').setAttribute('aria-valuetext', nameOf(ids[0]!));
    element('step-text').textContent = `${state.step + 1} of ${entries.length}`;
    element('play').setAttribute('aria-pressed', String(this.host.is_playing));
    const others = entries.map(({ id }) => id).filter((id) => !ids.includes(id));
    showChildren(element('other-volume'), others.map((id) => new Option(nameOf(id), String(id))));
    element('add-volumes').hidden = this.host.are_steps || others.length === 0 || ids.length === kMostVolumes || state.surfaces.length === kMostSurfaces;
    if (document.activeElement !== field('isovalue'))
      field('isovalue').value = String(Number(activeSurface(state).isovalue.toPrecision(7)));
    field('everywhere').checked = state.focus.everywhere;
    field('by-level').checked = state.coloring === 'level';
    field('orthographic').checked = state.camera.orthographic;
    field('radius').valueAsNumber = Math.log(state.focus.radius) / Math.log(volume.diagonal());
    const radius = `${shortNumber(state.focus.radius)} voxels`;
    field('radius').setAttribute('aria-valuetext', radius);
    element('radius-text').textContent = radius;
    for (const name of ['distance', 'angle']) element(name).setAttribute('aria-pressed', String(tool === name));
    element<HTMLButtonElement>('add-surface').disabled = state.surfaces.length === kMostSurfaces;

    const surfaces = this.items('surfaces', (item, i) => {
      on(item, '[type=radio]', 'change', () => this.change((now) => ({ ...now, active_surface: i })));
      on(item, 'select', 'input', ({ value }) => {
        const isovalue = this.host.volumeAt(Number(value))?.firstIsovalue;
        const change = { volume: Number(value), ...(isovalue !== undefined && { isovalue }) };
        this.change((now) => ({ ...now, surfaces: replaced(now.surfaces, i, change), active_surface: i }));
      });
    });
    state.surfaces.forEach(({ isovalue, volume: place }, i) => {
      const choice = surfaces[i]!.querySelector('select')!;
      showChildren(choice, ids.map((id, at) => new Option(nameOf(id), String(at))));
      choice.value = String(place);
      choice.hidden = ids.length === 1;
      input(surfaces[i]!, '[type=radio]').checked = i === state.active_surface;
      surfaces[i]!.querySelector('output')!.textContent = shortNumber(isovalue);
      input(surfaces[i]!, '.remove').disabled = state.surfaces.length === 1;
    });
    const planes = this.items('clip_planes', (item, i) => {
      const set = (change: (plane: ViewClipPlane) => Partial<ViewClipPlane>): void =>
        this.change((now) => ({ ...now, clip_planes: replaced(now.clip_planes, i, change(now.clip_planes[i]!)) }));
      on(item, '.turn', 'click', () => set(turnedRound));
      on(item, '.offset', 'input', ({ valueAsNumber }) =>
        set((plane) => {
          const [least, most] = this.rangeOf(plane);
          return { offset: least + valueAsNumber * (most - least) };
        }),
      );
    });
    state.clip_planes.forEach((plane, i) => {
      const axis = plane.normal.findIndex((value) => Math.abs(value) === 1);
      const name = axis < 0 ? 'oblique' : `${plane.normal[axis]! > 0 ? '+' : '−'}${'xyz'[axis]}`;
      const [least, most] = this.rangeOf(plane);
      planes[i]!.querySelector('output')!.textContent = name;
      input(planes[i]!, '.offset').valueAsNumber = (plane.offset - least) / (most - least);
    });
    const measures = this.items('measurements', () => {});
    state.measurements.forEach((measurement, i) => {
      measures[i]!.querySelector('output')!.textContent = measurementText(measurement, volume.unit);
    });
  }

  // Where the volume begins and ends along the normal.
  private rangeOf({ normal }: ViewClipPlane): [number, number] {
    const places = cornersOf(this.host.volume.box()).map((corner) => dot(normal, corner));
    return [Math.min(...places), Math.max(...places)];
  }

  // The lines of a list with its values. Each is made once, so that the focus stays where it is.
  private items(list: ListName, made: (item: HTMLElement, i: number) => void): HTMLElement[] {
    const place = element(list);
    const values = this.host.state[list];
    while (place.childElementCount > values.length) place.lastElementChild!.remove();
    while (place.childElementCount < values.length) {
      const i = place.childElementCount;
      const template = element<HTMLTemplateElement>(`${list}-line`);
      const item = template.content.firstElementChild!.cloneNode(true) as HTMLElement;
      for (const box of item.querySelectorAll<HTMLInputElement>('[data-field]'))
        box.addEventListener('input', () => {
          const change = { [box.dataset['field']!]: valueOf(box) };
          this.change((now) => ({ ...now, [list]: replaced(now[list] as object[], i, change) }));
        });
      on(item, '.remove', 'click', () =>
        this.change((now) => {
          const active_surface = now.active_surface - Number(list === 'surfaces' && i < now.active_surface);
          return { ...now, active_surface, [list]: (now[list] as object[]).filter((_, at) => at !== i) };
        }),
      );
      made(item, i);
      place.append(item);
    }
    const items = [...place.children] as HTMLElement[];
    items.forEach((item, i) => {
      for (const box of item.querySelectorAll<HTMLInputElement>('[data-field]'))
        showValue(box, (values[i] as unknown as Record<string, unknown>)[box.dataset['field']!]);
    });
    return items;
  }

  private change(next: (state: ViewState) => ViewState): void {
    this.host.change(bounded(next(this.host.state), this.host.volume));
  }
  private listen(id: string, next: (state: ViewState, from: HTMLInputElement) => ViewState): void {
    field(id).addEventListener('input', () => this.change((state) => next(state, field(id))));
  }
}

const input = (item: HTMLElement, which: string): HTMLInputElement => item.querySelector<HTMLInputElement>(which)!;
const on = (item: HTMLElement, which: string, event: string, f: (from: HTMLInputElement) => void): void =>
  input(item, which).addEventListener(event, () => f(input(item, which)));
