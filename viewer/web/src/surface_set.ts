// The chunks that are shown and those that come. A message takes effect after those before it,
// though chunks are unpacked beside, and the GPU gets a slice of them with every frame.
import { volumeOfChunk, type UnpackedChunk } from './chunk_message';
import type { DecoderPool } from './decoder_pool';
import { movedChunk } from './moved_chunk';
import type { Range, Show } from './protocol';
import type { SceneRenderer } from './scene_renderer';
import { add, boxOf, scale, type Box, type Vec3 } from './vector';
import { surfaceNumber, type ViewVolume } from './view_state';

// Of a frame, so that it stays far below 50 ms on a slow machine.
const kMostBytes = 2 << 20;
const kMostMilliseconds = 6;
const kMostLeaving = 64;

type Step = { chunk: UnpackedChunk | undefined; is_ready: boolean } | { show: Show } | { drop: Range[] } | { then: () => void };

export class SurfaceSet {
  private steps: Step[] = [];
  // By number, with that of its connection in front: these give numbers anew.
  private readonly kept = new Map<number, { volume: number; box: Box; is_shown: boolean }>();
  private leaving: number[] = [];
  private connection = 0;
  private readonly first_arrivals = new Map<number, number>(); // by volume

  constructor(
    private readonly renderer: SceneRenderer,
    private readonly volumes: ReadonlyMap<number, ViewVolume>, // by id
    private readonly decoders: DecoderPool,
    private readonly onNews: () => void,
  ) {}

  addChunk(message: ArrayBuffer): void {
    const step: Step = { chunk: undefined, is_ready: false };
    const volume = volumeOfChunk(message);
    if (!this.first_arrivals.has(volume)) this.first_arrivals.set(volume, performance.now());
    this.steps.push(step);
    this.decoders.unpack(message, (chunk) => {
      step.chunk = chunk;
      step.is_ready = true;
      this.onNews();
    });
  }

  add(step: { show: Show } | { drop: Range[] } | { then: () => void }): void {
    this.steps.push(step);
    this.onNews();
  }

  // The connection ended. What is shown stays until another one shows something.
  beginConnection(): void {
    ++this.connection;
    this.steps = [];
    this.first_arrivals.clear();
    for (const [id, chunk] of this.kept) if (!chunk.is_shown) this.release(id);
  }

  // Takes what one frame may take, into the voxels of `scene`. Returns the passes that it shows,
  // with their seconds since the first chunk of each came.
  pump(scene: ViewVolume): { shown: { show: Show; seconds: number }[]; has_more: boolean } {
    const shown: { show: Show; seconds: number }[] = [];
    const begin = performance.now();
    for (const id of this.leaving.splice(0, kMostLeaving)) this.renderer.remove(id);
    let bytes = 0;
    while (bytes < kMostBytes && performance.now() - begin < kMostMilliseconds) {
      const step = this.steps[0];
      if (step === undefined || ('is_ready' in step && !step.is_ready)) break;
      this.steps.shift();
      if ('show' in step) {
        this.show(step.show);
        const { volume } = step.show;
        shown.push({ show: step.show, seconds: (begin - (this.first_arrivals.get(volume) ?? begin)) / 1000 });
        this.first_arrivals.delete(volume);
      } else if ('drop' in step) {
        this.inRanges(step.drop, (id) => this.release(id));
      } else if ('then' in step) {
        step.then();
      } else if (step.chunk !== undefined) {
        bytes += step.chunk.positions.byteLength * 2 + step.chunk.triangles.byteLength;
        this.keep(step.chunk, scene);
      }
    }
    const next = this.steps[0];
    const is_waiting = next !== undefined && 'is_ready' in next && !next.is_ready;
    return { shown, has_more: this.leaving.length > 0 || (next !== undefined && !is_waiting) };
  }

  // All that is there of a volume goes.
  end(volume: number): void {
    for (const [id, chunk] of this.kept) if (chunk.volume === volume) this.release(id);
  }

  // Around what is shown of a volume, its voxel indices; none if that is nothing.
  shownBox(volume: number): Box | undefined {
    const shown = [...this.kept.values()].filter((chunk) => chunk.is_shown && chunk.volume === volume);
    return boxOf(shown.map((chunk) => chunk.box));
  }

  private get base(): number {
    return this.connection * 2 ** 32;
  }

  private keep(chunk: UnpackedChunk, scene: ViewVolume): void {
    const id = this.base + chunk.id;
    const volume = this.volumes.get(chunk.volume)!;
    const step = volume.facts.position_step;
    const inVoxels = (place: Vec3): Vec3 => scale(add(chunk.origin, place), step);
    const surface = surfaceNumber(chunk.volume, chunk.surface);
    const drawn = { ...chunk, surface, origin: scale(chunk.origin, step), step };
    this.renderer.add(id, volume.hasGridOf(scene) ? drawn : movedChunk(drawn, volume, scene));
    const box = { lower: inVoxels(chunk.lower), upper: inVoxels(chunk.upper) };
    this.kept.set(id, { volume: chunk.volume, box, is_shown: false });
  }

  private show(show: Show): void {
    for (const [id, chunk] of this.kept)
      if (id < this.base && chunk.is_shown && chunk.volume === show.volume) this.release(id);
    this.inRanges(show.drop, (id) => this.release(id));
    this.inRanges(show.show, (id) => {
      this.kept.get(id)!.is_shown = true;
      this.renderer.show(id, true);
    });
  }

  private release(id: number): void {
    this.kept.delete(id);
    this.renderer.show(id, false);
    this.leaving.push(id);
  }

  // A range may have numbers that are not here, and be far longer than what is here.
  private inRanges(ranges: readonly Range[], f: (id: number) => void): void {
    for (const [first, last] of ranges) {
      if (last - first < this.kept.size) {
        for (let id = this.base + first; id <= this.base + last; ++id) if (this.kept.has(id)) f(id);
      } else {
        for (const id of this.kept.keys()) if (id >= this.base + first && id <= this.base + last) f(id);
      }
    }
  }
}
