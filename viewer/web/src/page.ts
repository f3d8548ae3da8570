// The page of one volume: the view, what is asked for and drawn of it, and the frames.
import { framed, placeCamera, pointAt, type Place } from './camera';
import { CapImages } from './cap_images';
import { Connection } from './connection';
import { DecoderPool } from './decoder_pool';
import { Gestures } from './gestures';
import { element, type Action, type Host } from './host';
import { drawOverlay, shortNumber } from './overlay';
import { Panel } from './panel';
import { request, RequestError, volumeOf, type ServerMessage, type Show, type VolumeFacts, type Wish } from './protocol';
import { save, savePicture } from './save';
import { SceneRenderer, type SceneFrame } from './scene_renderer';
import { SurfaceSet } from './surface_set';
import type { Vec3 } from './vector';
import { ViewHistory } from './view_history';
import { fragmentOf, viewFromJson, viewToJson } from './view_link';
import { activeSurface, bounded, firstView, focusedOn, type ViewState, type ViewVolume } from './view_state';

const kMostTriangles = { mouse: 8_000_000, fingers: 2_000_000 };

export class Page implements Host {
  state!: ViewState;
  volume!: ViewVolume;
  tool: 'distance' | 'angle' | undefined;
  picked: Vec3[] = [];

  private readonly scene = element<HTMLCanvasElement>('scene');
  private readonly overlay = element<HTMLCanvasElement>('overlay');
  private readonly renderer = new SceneRenderer(this.scene);
  private readonly surfaces = new SurfaceSet(this.renderer, new DecoderPool(), () => this.requestFrame());
  private readonly caps: CapImages;
  private readonly connection: Connection;
  private panel: Panel | undefined; // from the facts of the volume on
  private facts!: VolumeFacts;
  private history!: ViewHistory;
  private first!: ViewState;
  private own_camera: ViewState['camera'] | undefined; // that the page chose; the surface gets framed
  private wished = '';
  private is_held = false;
  private is_requested = false;
  private shown: ViewState | undefined; // by the panel
  private passed: Show | undefined;
  private is_fine = false;
  private link_timer = 0;

  // Throws if the browser has no WebGL 2. `view`: JSON, of the link.
  constructor(
    private readonly id: number,
    private readonly token: string,
    private readonly keeps_token: boolean, // in the tab; else it stays in the address
    private readonly view: string | undefined,
  ) {
    this.caps = new CapImages(id, token, () => this.requestFrame());
    this.connection = new Connection(id, token, {
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

  change(next: ViewState): void {
    this.state = next;
    this.requestFrame();
  }

  hold(is_held: boolean): void {
    this.is_held = is_held;
    this.requestFrame();
  }

  take(place: Place): void {
    void this.pointUnder(place).then((point) => {
      if (!point) return;
      if (!this.tool) return this.change(focusedOn(this.state, point, this.volume));
      this.picked.push(point);
      if (this.picked.length < (this.tool === 'angle' ? 3 : 2)) return this.requestFrame();
      const measurements = [...this.state.measurements, { points: this.picked }];
      this.picked = [];
      this.change(bounded({ ...this.state, measurements }, this.volume));
    });
  }

  act(action: Action): void {
    const name = this.facts.name.replace(/\.\w+$/, '');
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
      'save-view': () => save(new Blob([viewToJson(this.state)]), `${name}.view.json`),
      distance: () => this.chooseTool('distance'),
      angle: () => this.chooseTool('angle'),
      back: () => this.picked.pop(),
      end: () => this.chooseTool(undefined),
    };
    actions[action]();
    this.requestFrame();
  }

  private chooseTool(tool: Page['tool']): void {
    this.tool = tool === this.tool ? undefined : tool;
    this.picked = [];
    this.shown = undefined;
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
    if (type === 'error') this.say('trouble', message.error);
    if (type !== 'fine') return;
    const then = (): void => {
      this.is_fine = message.wish === this.connection.lastWish;
      this.tell(message.limited);
    };
    this.surfaces.add({ then });
  }

  // Again after a lost connection.
  private begin(facts: VolumeFacts): void {
    this.facts = facts;
    element('progress').hidden = true;
    if (this.panel) return;
    this.volume = volumeOf(facts);
    document.title = `${facts.name} – isobrick`;
    element('name').textContent = facts.name;
    this.resize();
    const theme = matchMedia('(prefers-color-scheme: light)').matches ? 'light' : 'dark';
    this.first = firstView(this.volume, this.aspect, theme);
    this.state = this.view ? bounded(viewFromJson(this.view, this.first), this.volume) : this.first;
    if (!this.view?.includes('"camera"')) this.own_camera = this.state.camera;
    this.history = new ViewHistory(this.state);
    this.panel = new Panel(this);
    new Gestures(this.scene, this);
    this.requestFrame();
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
    const { shown, has_more } = this.surfaces.pump(this.facts.position_step);
    for (const { show } of shown) this.noteShow(show);
    if (this.is_fine) this.own_camera = undefined; // from now on it is the user's
    this.sendWish();
    this.renderer.draw(this.frameOf());
    for (const { show, seconds: passed } of shown) this.connection.noteShown(show.pass, passed);
    drawOverlay(this.overlay, this.state, this.picked, this.volume.unit);
    if (this.shown !== this.state) {
      panel.show(this.facts);
      this.shown = this.state;
      clearTimeout(this.link_timer);
      this.link_timer = setTimeout(() => this.writeAddress(), 300);
    }
    const comes_back = this.history.note(this.state, this.is_held, seconds);
    if (has_more || (comes_back && !this.is_held)) this.requestFrame();
  }

  private noteShow(show: Show): void {
    this.passed = show;
    this.say('trouble', '');
    this.tell(show.limited);
    if (this.own_camera === undefined || this.own_camera !== this.state.camera) return;
    this.own_camera = this.framedCamera();
    this.state = { ...this.state, camera: this.own_camera };
    this.history.replace(this.state);
  }

  private tell(limited: string | undefined): void {
    if (!this.passed) return;
    const levels = [...new Set(this.passed.surfaces.flatMap((surface) => surface.levels.map(([level]) => level)))];
    const words = [`${this.passed.triangles.toLocaleString('en')} triangles`, `levels ${levels.sort().join(' ')}`];
    words.push(limited ?? (this.is_fine ? 'fine' : 'finer ones come'));
    this.say('status', words.join(' · '));
  }

  private sendWish(): void {
    const { surfaces, focus } = this.state;
    const wish: Wish = {
      surfaces: surfaces.map((s) => ({ iso: s.isovalue, visible: s.visible && s.opacity > 0 })),
      ...(focus.everywhere ? {} : { focus: focus.center, radius: focus.radius }),
      most_triangles: kMostTriangles[matchMedia('(pointer: coarse)').matches ? 'fingers' : 'mouse'],
    };
    const text = JSON.stringify(wish);
    if (text === this.wished) return;
    this.wished = text;
    this.is_fine = false;
    this.tell(undefined);
    this.connection.send(wish);
  }

  private frameOf(): SceneFrame {
    const { state, volume } = this;
    return {
      camera: placeCamera(state.camera, this.aspect),
      bounds: volume.box(),
      lattice: { matrix: volume.indexToWorldMatrix, origin: volume.origin },
      surfaces: state.surfaces.map((s) => ({ ...s, opacity: s.visible ? s.opacity : 0 })),
      color_by_level: state.coloring === 'level',
      clip_planes: state.clip_planes.filter((plane) => plane.enabled),
      caps: this.caps.capsOf(state, volume),
      background_top: state.background_top,
      background_bottom: state.background_bottom,
    };
  }

  private shownBox(): ReturnType<ViewVolume['box']> {
    const shown = this.surfaces.shownBox();
    return shown ? this.volume.boxAround(shown.lower, shown.upper) : this.volume.box();
  }
  private framedCamera(): ViewState['camera'] {
    return framed(this.state.camera, this.shownBox(), this.aspect);
  }

  private async pointUnder(place: Place): Promise<Vec3 | undefined> {
    const frame = this.frameOf();
    const distance = await this.renderer.distanceAt(frame, place);
    return distance === 0 ? undefined : pointAt(frame.camera, place, distance);
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
    return fragmentOf({ token, volume: String(this.id), view: viewToJson(this.state) });
  }

  private writeAddress(): void {
    history.replaceState(null, '', this.fragment(!this.keeps_token));
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
    const { isovalue } = activeSurface(this.state);
    const { everywhere, center, radius } = this.state.focus;
    const detail = everywhere ? '' : `&focus=${center.join()}&radius=${radius}`;
    this.say('status', `making ${name}.${ending} …`);
    request(`volume/${this.id}/surface.${ending}?iso=${isovalue}${detail}`, this.token)
      .then((response) => response.blob())
      .then((blob) => {
        save(blob, `${name}-${shortNumber(isovalue)}.${ending}`);
        this.tell(undefined);
      })
      .catch((error: Error) => this.say('trouble', error.message));
  }

  private sayLost(): void {
    this.say('trouble', 'The connection is lost; trying again …');
    void request('volumes', this.token).catch((error: unknown) => {
      if (error instanceof RequestError && error.status === 401)
        this.say('trouble', 'The server began anew with another key: open the address that it printed.');
    });
  }

  private say(where: 'status' | 'trouble', text: string): void {
    element(where).textContent = text;
  }
}
