// The values of the volume on the cuts of clip planes, asked for one after the other: while a plane
// moves, its cap is of one grey, and gets its values when it rests.
import type { SceneCap } from './scene_renderer';
import { request } from './protocol';
import { add, cornersOf, cross, dot, scale, subtract, unit, type Vec3 } from './vector';
import type { ViewClipPlane, ViewState, ViewVolume } from './view_state';

const kRestMilliseconds = 120;
const kMostPixels = 1024;

type CapPlane = Pick<SceneCap, 'corner' | 'across' | 'along'>;

// The rectangle of the plane that holds the volume (capPlane() of viewer/stream/plane_sampler.cpp),
// in the world; none: the plane is beside it.
function capPlane(plane: ViewClipPlane, volume: ViewVolume): CapPlane | undefined {
  const { normal, offset } = plane;
  const u = unit(cross(Math.abs(normal[2]) < 0.9 ? [0, 0, 1] : [0, 1, 0], normal));
  const v = cross(normal, u);
  const corners = cornersOf({ lower: [0, 0, 0], upper: volume.last() }).map((index) => volume.indexToWorld(index));
  const range = (axis: Vec3): [number, number] => {
    const places = corners.map((corner) => dot(corner, axis));
    return [Math.min(...places), Math.max(...places)];
  };
  const [left, right] = range(u);
  const [low, high] = range(v);
  const [near, far] = range(normal);
  if (!(offset >= near && offset <= far)) return undefined;
  const corner = add(add(scale(u, left), scale(v, low)), scale(normal, offset));
  return { corner, across: scale(u, right - left), along: scale(v, high - low) };
}

export class CapImages {
  private readonly images = new Map<string, ImageBitmap | undefined>();
  private timer = 0;

  constructor(
    private readonly token: string,
    private readonly onNews: () => void,
  ) {}

  // Of the planes that cut and have a cap, by their place among those that cut.
  capsOf(state: ViewState, volume: ViewVolume): SceneCap[] {
    const visible = state.surfaces.filter((surface) => surface.volume === 0 && surface.visible && surface.opacity > 0);
    if (visible.length === 0) return [];
    const least = Math.min(...visible.map((surface) => surface.isovalue));
    const wanted: string[] = [];
    const [lowest, highest] = volume.facts.value_range;
    const share = (value: number): number => (value - lowest) / (highest - lowest || 1);
    const window: [number, number] = [share(state.value_window[0]), share(state.value_window[1])];
    const caps = state.clip_planes
      .filter((plane) => plane.enabled)
      .flatMap((plane, i) => {
        const place = plane.cap ? capPlane(plane, volume) : undefined;
        if (!place) return [];
        const index = (v: Vec3): string => v.map((x) => x.toPrecision(9)).join();
        const corner = volume.worldToIndex(place.corner);
        const ends = [place.across, place.along].map((v) =>
          subtract(volume.worldToIndex(add(place.corner, v)), corner),
        );
        const path =
          `volume/${volume.facts.id}/slice.png?corner=${index(corner)}&across=${index(ends[0]!)}` +
          `&along=${index(ends[1]!)}&size=${kMostPixels}&least=-1e30`; // where there is no value, it is clear
        wanted.push(path);
        return [{ plane: i, ...place, values: this.images.get(path), least: share(least), window }];
      });
    for (const path of this.images.keys()) if (!wanted.includes(path)) this.images.delete(path);
    const missing = wanted.find((path) => !this.images.has(path));
    clearTimeout(this.timer);
    if (missing !== undefined) this.timer = setTimeout(() => void this.fetch(missing), kRestMilliseconds);
    return caps;
  }

  private async fetch(path: string): Promise<void> {
    this.images.set(path, undefined); // one that fails stays grey
    try {
      const blob = await (await request(path, this.token)).blob();
      const how = { colorSpaceConversion: 'none', premultiplyAlpha: 'premultiply' } as const;
      if (this.images.has(path)) this.images.set(path, await createImageBitmap(blob, how));
    } finally {
      this.onNews();
    }
  }
}
