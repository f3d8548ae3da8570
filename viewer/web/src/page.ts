// The page of a scene: the view, what is asked for and drawn of its volumes, and the frames.
import { framed, placeCamera, pointAt, type Place } from './camera';
import { CapImages } from './cap_images';
import { Connection } from './connection';
import { DecoderPool } from './decoder_pool';
import { Gestures } from './gestures';
import { element, type Action } from './host';
import { drawOverlay, shortNumber } from './overlay';
import { Panel } from './panel';
import { request, statusOf } from './protocol';
import type { ServerMessage, Show, VolumeEntry, VolumeFacts, Wish } from './protocol';
import { save, savePicture } from './save';
import { SceneRenderer, type SceneFrame } from './scene_renderer';
import { SurfaceSet } from './surface_set';
import { boxOf, clamp, type Box, type Vec3 } from './vector';
import { ViewHistory } from './view_history';
import { fragmentOf, viewFromJson, viewToJson } from './view_link';
import { activeSurface, bounded, firstView, focusedOn, surfaceNumber, ViewVolume } from './view_state';
import { kMostVolumes, withVolume, type ViewState } from './view_state';

const kMostTriangles = { mouse: 8_000_000, fingers: 2_000_000 };
const kStepSeconds = 0.1; // for which a step of time is shown at least

export class Page {
  state!: ViewState;
  is_playing = false;
  tool: 'distance' | 'angle' | undefined;
  picked: Vec3[] = [];

  private readonly scene = element<HTMLCanvasElement>('scene');
  private readonly overlay = element<HTMLCanvasElement>('overlay');
  private readonly renderer = new SceneRenderer(this.scene);
  private readonly volumes = new Map<number, ViewVolume>(); // that were opened, by id
  private readonly surfaces = new SurfaceSet(this.renderer, this.volumes, new DecoderPool(), () => this.requestFrame());
  private readonly caps: CapImages;
  private readonly connection: Connection;
  private panel: Panel | undefined; // from the facts of the volume on
  private history!: ViewHistory;
  private first!: ViewState;
  private own_camera: ViewState['camera'] | undefined; // that the page chose; the surface gets framed
  private is_held = false;
  private is_requested = false;
  private adding: number | undefined; // a volume that is not open yet
  private shown: ViewState | undefined; // by the panel
  private readonly passed = new Map<number, Show>(); // by the volume's id
  private readonly fine = new Set<number>(); // volumes, as fine as was wished
  private goes_on = false; // to other steps of time
  private step_shown = 0; // seconds
  private link_timer = 0;

  // Throws if the browser has no WebGL 2. `entries`: by id; `drawn`: the first one's, and then that of
  // the volume that the view's own surfaces are of; `view`: JSON, of the link.
  constructor(
    readonly entries: readonly VolumeEntry[],
    readonly are_steps: boolean,
    private drawn: number,
    private readonly token: string,
    private readonly keeps_token: boolean, // in the tab; else it stays in the address
    private readonly view: string | undefined,
  ) {
    this.caps = new CapImages(token, () => this.requestFrame());
    this.connection = new Connection(drawn, token, {
      message: (message) => this.receive(message),
      chunk: (message) => this.surfaces.addChunk(message),
      begun: () => {
        this.surfaces.beginConnection();
        this.say('trouble', '');
      },
      lost: () => this.sayLost(),
      refused: () => this.say('status', ''),
    });
    new ResizeObserver(() => this.resize()).observe(element('view'));
    this.scene.addEventListener('webglcontextlost', () => this.say('trouble', 'The graphics card was reset.'));
    this.scene.addEventListener('webglcontextrestored', () => location.reload());
  }

  get aspect(): number {
    return this.scene.width / this.scene.height;
  }

  get volume(): ViewVolume {
    return this.volumes.get(this.drawn)!;
  }
  // Of the active surface.
  get active(): ViewVolume {
    return this.volumeAt(activeSurface(this.state).volume) ?? this.volume;
  }
  volumeAt(place: number): ViewVolume | undefined {
    return this.volumes.get(this.ids[place]!);
  }
  // Of the volumes of the view, by their places.
  get ids(): number[] {
    return [this.are_steps ? this.state.step : this.drawn, ...this.state.beside];
  }

  // The next view; it is drawn with the next frame, and what it lacks is asked for.
  change(next: ViewState): void {
    this.goes_on ||= next.step !== this.state.step;
    this.state = this.inRange(next);
    this.requestFrame();
  }

  // With isovalues that its volumes have; a step of time may lack one.
  private inRange(state: ViewState): ViewState {
    const surfaces = state.surfaces.map((surface) => {
      const own = this.volumes.get([this.drawn, ...state.beside][surface.volume]!);
      return own && !this.are_steps ? { ...surface, isovalue: clamp(surface.isovalue, ...own.facts.value_range) } : surface;
    });
    return surfaces.every(({ isovalue }, i) => isovalue === state.surfaces[i]!.isovalue) ? state : { ...state, surfaces };
  }

  // A drag begins or ends: all of it is one step of undo.
  hold(is_held: boolean): void {
    this.is_held = is_held;
    this.requestFrame();
  }

  // The point of the surface at a place: the tool takes it or, if there is none, the view turns about it.
  async take(place: Place): Promise<void> {
    const frame = this.frameOf();
    const distance = await this.renderer.distanceAt(frame, place);
    if (distance === 0) return;
    const point = pointAt(frame.camera, place, distance);
    if (!this.tool) return this.change(focusedOn(this.state, point, this.volume));
    this.picked.push(point);
    if (this.picked.length < (this.tool === 'angle' ? 3 : 2)) return this.requestFrame();
    const measurements = [...this.state.measurements, { points: this.picked }];
    this.picked = [];
    this.change(bounded({ ...this.state, measurements }, this.volume));
  }

  act(action: Action): void {
    const name = this.active.facts.name.replace(/\.\w+$/, '');
    const actions: Record<Action, () => unknown> = {
      undo: () => this.change(this.history.undo(this.state)),
      redo: () => this.change(this.history.redo(this.state)),
      frame: () => this.change({ ...this.state, camera: this.framedCamera() }),
      first: () => this.change({ ...this.first, camera: framed(this.first.camera, this.shownBox(), this.aspect) }),
      full: () =>
        document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen(),
      help: () => element<HTMLDialogElement>('keys').showModal(),
      hide: () => {
        const is_hidden = element('panel').classList.toggle('hidden');
        element('hide').setAttribute('aria-expanded', String(!is_hidden));
      },
      link: () => this.copyLink(),
      'save-png': () => {
        this.renderer.draw(this.frameOf());
        savePicture([this.scene, this.overlay], `${name}.png`);
      },
      'save-glb': () => this.saveMesh(name, 'glb'),
      'save-stl': () => this.saveMesh(name, 'stl'),
      'save-view': () => save(new Blob([this.viewFile()]), `${name}.view.json`),
      play: () => (this.is_playing = this.are_steps && !this.is_playing),
      'next-step': () => this.are_steps && this.change({ ...this.state, step: this.nextStep }),
      distance: () => this.chooseTool('distance'),
      angle: () => this.chooseTool('angle'),
      back: () => this.picked.pop(),
      end: () => this.chooseTool(undefined),
    };
    actions[action]();
    this.shown = undefined;
    this.requestFrame();
  }

  private chooseTool(tool: Page['tool']): void {
    this.tool = tool === this.tool ? undefined : tool;
    this.picked = [];
  }

  private receive(message: ServerMessage): void {
    const { type } = message;
    if (type === 'opening') {
      this.say('status', `${message.phase}: ${Math.round(100 * message.share)} %`);
      element<HTMLProgressElement>('progress').value = message.share;
    }
    if (type === 'volume') this.begin(message);
    if (type === 'show') this.surfaces.add({ show: message });
    if (type === 'drop') this.surfaces.add(message);
    if (type === 'error') {
      if (message.ended) this.connection.asked.delete(message.volume); // what comes next is another wish
      this.is_playing = false;
      this.shown = undefined;
      this.say('trouble', message.error);
    }
    if (type === 'ended') this.surfaces.add({ then: () => this.forget(message.volume) });
    if (type !== 'fine') return;
    const then = (): void => {
      if (this.connection.asked.get(message.volume)?.wish === message.wish) this.fine.add(message.volume);
      this.tell(message.limited);
    };
    this.surfaces.add({ then });
  }

  // Of each volume, and again after a lost connection.
  private begin(facts: VolumeFacts): void {
    const volume = new ViewVolume(facts);
    element('progress').hidden = true;
    this.requestFrame();
    if (this.panel && this.are_steps && !volume.hasGridOf(this.volume)) {
      this.is_playing = false;
      if (facts.id !== this.state.step) return; // it was made ahead
      this.say('trouble', `'${facts.name}' has another grid than the steps before`);
      return this.change({ ...this.state, step: this.drawn });
    }
    this.volumes.set(facts.id, volume);
    this.shown = undefined;
    if (this.panel) this.state = this.inRange(this.state);
    if (this.adding === facts.id) this.change(bounded(withVolume(this.state, volume), this.volume));
    if (this.adding === facts.id) this.adding = undefined;
    if (this.panel || facts.id !== this.drawn) return;
    document.title = `${facts.name} – isobrick`;
    element('name').textContent = facts.name;
    this.resize();
    const theme = matchMedia('(prefers-color-scheme: light)').matches ? 'light' : 'dark';
    this.first = firstView(this.volume, this.aspect, theme);
    const read = this.view ? viewFromJson(this.view, this.first) : this.first;
    const isOther = (id: number, i: number): boolean =>
      !this.are_steps && this.entries[id] !== undefined && id !== this.drawn && read.beside.indexOf(id) === i;
    const beside = read.beside.map((id, i) => (isOther(id, i) && i < kMostVolumes - 1 ? id : -1));
    this.state = bounded({ ...read, beside, step: this.are_steps ? this.drawn : 0 }, this.volume);
    this.state = this.inRange(this.state);
    if (!this.view?.includes('"camera"')) this.own_camera = this.state.camera;
    this.history = new ViewHistory(this.state);
    this.panel = new Panel(this);
    new Gestures(this.scene, this);
  }

  // With a surface of it, as soon as it is open.
  addVolume(id: number): void {
    this.adding = id;
    this.connection.ask({ type: 'open', volume: id });
  }

  private requestFrame(): void {
    if (this.is_requested) return;
    this.is_requested = true;
    requestAnimationFrame((time) => {
      this.is_requested = false;
      if (this.panel) this.frame(this.panel, time / 1000);
    });
  }

  private frame(panel: Panel, seconds: number): void {
    const { shown, has_more } = this.surfaces.pump(this.volume);
    for (const { show } of shown) this.noteShow(show);
    if (this.isFine()) this.own_camera = undefined; // from now on it is the user's
    this.sendWishes();
    this.goOnInTime(seconds);
    this.renderer.draw(this.frameOf());
    for (const { show, seconds: passed } of shown) this.connection.noteShown(show, passed);
    drawOverlay(this.overlay, this.state, this.picked, this.volume.unit);
    if (this.shown !== this.state) {
      panel.show();
      this.shown = this.state;
      clearTimeout(this.link_timer);
      this.link_timer = setTimeout(() => history.replaceState(null, '', this.fragment(!this.keeps_token)), 300);
    }
    const comes_back = this.history.note(this.state, this.is_held || this.is_playing, seconds);
    if (has_more || this.is_playing || (comes_back && !this.is_held)) this.requestFrame();
  }

  // The step that was wished takes the place of the one before once it is there.
  private goOnInTime(seconds: number): void {
    const [step] = this.ids;
    if (step !== this.drawn && this.passed.has(step!)) {
      this.drawn = step!;
      this.step_shown = seconds;
      this.shown = undefined;
      this.requestFrame();
      element('name').textContent = this.volume.facts.name;
      this.tell();
    }
    const is_next_there = this.isFine() && step === this.drawn && this.fine.has(this.nextStep);
    if (this.is_playing && is_next_there && seconds >= this.step_shown + kStepSeconds)
      this.change({ ...this.state, step: this.nextStep });
  }
  private get nextStep(): number {
    return (this.state.step + 1) % this.entries.length;
  }

  private noteShow(show: Show): void {
    this.passed.set(show.volume, show);
    this.say('trouble', '');
    this.tell(show.limited);
    if (this.own_camera === undefined || this.own_camera !== this.state.camera) return;
    this.own_camera = this.framedCamera();
    this.state = { ...this.state, camera: this.own_camera };
    this.history.replace(this.state);
  }

  // Volumes of which there are surfaces.
  private seenIds(): number[] {
    return this.ids.filter((_, place) => this.state.surfaces.some((surface) => surface.volume === place));
  }
  private isFine(): boolean {
    return this.seenIds().every((id) => this.fine.has(id));
  }

  private tell(limited?: string): void {
    const passes = this.seenIds().flatMap((id) => this.passed.get(id) ?? []);
    if (passes.length === 0) return;
    const triangles = passes.reduce((sum, pass) => sum + pass.triangles, 0);
    const surfaces = passes.flatMap((pass) => pass.surfaces);
    const levels = [...new Set(surfaces.flatMap((surface) => surface.levels.map(([level]) => level)))];
    const words = [`${triangles.toLocaleString('en')} triangles`, `levels ${levels.sort().join(' ')}`];
    words.push(limited ?? (this.isFine() ? 'fine' : 'finer ones come'));
    this.say('status', words.join(' · '));
  }

  // The next step of time is made ahead.
  private sendWishes(): void {
    const ids = this.seenIds();
    const all = kMostTriangles[matchMedia('(pointer: coarse)').matches ? 'fingers' : 'mouse'];
    const most_triangles = Math.floor(all / ids.length);
    const next = this.are_steps && (this.goes_on || this.is_playing) ? this.nextStep : undefined;
    for (const id of this.connection.asked.keys()) {
      if (ids.includes(id) || [this.drawn, next, this.adding].includes(id)) continue;
      this.connection.end(id);
      this.forget(id);
    }
    for (const id of ids) this.sendWish(id, this.ids.indexOf(id), most_triangles);
    if (next !== undefined && this.isFine()) this.sendWish(next, 0, most_triangles);
  }

  private forget(id: number): void {
    this.surfaces.end(id);
    this.passed.delete(id);
    this.fine.delete(id);
  }

  private sendWish(id: number, place: number, most_triangles: number): void {
    const volume = this.volumes.get(id);
    if (!volume) return void this.connection.ask({ type: 'open', volume: id });
    const [least, greatest] = volume.facts.value_range;
    const surfaces = this.state.surfaces.filter((surface) => surface.volume === place).map((surface) => {
      const is_made = !this.are_steps || (surface.isovalue >= least && surface.isovalue <= greatest);
      return { iso: surface.isovalue, visible: is_made && surface.visible && surface.opacity > 0 };
    });
    const focus = this.state.focus.everywhere ? {} : this.focusIn(volume);
    if (!this.connection.ask({ type: 'wish', volume: id, surfaces, ...focus, most_triangles })) return;
    this.fine.delete(id);
    if (id !== this.drawn) this.passed.delete(id); // made ahead, of another wish
    this.tell();
  }

  // The view's counts in voxels of its own volume.
  private focusIn(volume: ViewVolume): Pick<Wish, 'focus' | 'radius'> {
    const { center, radius } = this.state.focus;
    if (volume.hasGridOf(this.volume)) return { focus: center, radius };
    const by = Math.min(...this.volume.facts.spacing) / Math.min(...volume.facts.spacing);
    return { focus: volume.worldToIndex(this.volume.indexToWorld(center)), radius: by * radius };
  }

  private frameOf(): SceneFrame {
    const { state, volume } = this;
    const drawn = [this.drawn, ...state.beside].flatMap((id, place) =>
      state.surfaces
        .filter((surface) => surface.volume === place)
        .map((s, i) => [surfaceNumber(id, i), { ...s, opacity: s.visible ? s.opacity : 0 }] as const),
    );
    return {
      camera: placeCamera(state.camera, this.aspect),
      bounds: boxOf(this.drawnVolumes().map((other) => other.box()))!,
      lattice: { matrix: volume.indexToWorldMatrix, origin: volume.origin },
      surfaces: new Map(drawn),
      color_by_level: state.coloring === 'level',
      clip_planes: state.clip_planes.filter((plane) => plane.enabled),
      caps: this.caps.capsOf(state, volume),
      background_top: state.background_top,
      background_bottom: state.background_bottom,
    };
  }

  private drawnVolumes(): ViewVolume[] {
    return [this.drawn, ...this.state.beside].flatMap((id) => this.volumes.get(id) ?? []);
  }
  private shownBox(): Box {
    const boxes = this.drawnVolumes().flatMap((volume) => {
      const shown = this.surfaces.shownBox(volume.facts.id);
      return shown ? volume.boxAround(shown.lower, shown.upper) : [];
    });
    return boxOf(boxes) ?? this.volume.box();
  }
  private framedCamera(): ViewState['camera'] {
    return framed(this.state.camera, this.shownBox(), this.aspect);
  }

  private resize(): void {
    const { clientWidth, clientHeight } = this.scene;
    const [width, height] = [clientWidth, clientHeight].map((side) => Math.max(1, Math.round(side * devicePixelRatio)));
    [this.overlay.width, this.overlay.height] = [width!, height!];
    this.renderer.resize(width!, height!);
    this.requestFrame();
  }

  private fragment(with_key: boolean): string {
    const token = with_key ? this.token : undefined;
    return fragmentOf({ token, volume: String(this.ids[0]), view: viewToJson(this.state) });
  }

  // It finds further volumes where the files of the server lie.
  private viewFile(): string {
    const [volume, ...beside] = this.ids.map((id) => this.entries[id]!.name);
    return viewToJson(this.state, beside.length > 0 ? { volume: volume!, beside } : {});
  }

  private copyLink(): void {
    const link = new URL(this.fragment(element<HTMLInputElement>('with-key').checked), location.href).href;
    navigator.clipboard?.writeText(link).then(
      () => this.say('status', 'link copied'),
      () => prompt('Copy this link', link),
    ) ?? prompt('Copy this link', link);
  }

  // The active surface, at the wanted detail.
  private saveMesh(name: string, ending: 'glb' | 'stl'): void {
    const { isovalue, volume } = activeSurface(this.state);
    if (!this.volumeAt(volume)) return this.say('trouble', 'the volume of the active surface is not open');
    const { focus, radius } = this.focusIn(this.active);
    const detail = this.state.focus.everywhere ? '' : `&focus=${focus!.join()}&radius=${radius}`;
    this.say('status', `making ${name}.${ending} …`);
    request(`volume/${this.active.facts.id}/surface.${ending}?iso=${isovalue}${detail}`, this.token)
      .then((response) => response.blob())
      .then((blob) => {
        save(blob, `${name}-${shortNumber(isovalue)}.${ending}`);
        this.tell();
      })
      .catch((error: Error) => this.say('trouble', error.message));
  }

  private sayLost(): void {
    this.say('trouble', 'The connection is lost; trying again …');
    void request('volumes', this.token).catch((error: unknown) => {
      if (statusOf(error) === 401)
        this.say('trouble', 'The server began anew with another key: open the address that it printed.');
    });
  }

  private say(where: 'status' | 'trouble', text: string): void {
    element(where).textContent = text;
  }
}
