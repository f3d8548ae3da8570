// All that a view brings back: the fields of a view file (docs/reference/views-and-scripts.md)
// that the page knows, by the same names, so that a link, the window and `isobrick render --state`
// show the same picture.
import { framed, type ViewCamera } from './camera';
import type { VolumeFacts } from './protocol';
import type { Box, Mat3, Vec3 } from './vector';
import { add, boxAround, clamp, cornersOf, inverse, length, mapped, scale, subtract, times, unit } from './vector';

// Colours are sRGB values 0..1.
export interface ViewSurface {
  isovalue: number;
  color: Vec3;
  opacity: number;
  visible: boolean;
  volume: number; // its place: 0 the view's own, then those beside it
}

export interface ViewFocus {
  center: Vec3; // voxel indices
  radius: number; // voxels
  everywhere: boolean; // the finest level everywhere
}

// Points with dot(normal, point) >= offset stay. World.
export interface ViewClipPlane {
  normal: Vec3;
  offset: number;
  enabled: boolean;
  cap: boolean;
}

// Two points: their distance. Three: the angle at the second.
export interface ViewMeasurement {
  points: Vec3[];
}

export interface ViewState {
  camera: ViewCamera;
  surfaces: ViewSurface[]; // at least one
  active_surface: number;
  focus: ViewFocus;
  beside: number[]; // further volumes, by their ids
  step: number; // of time, if the volumes are such
  clip_planes: ViewClipPlane[];
  value_window: [number, number]; // that caps show black and white
  coloring: 'plain' | 'level';
  measurements: ViewMeasurement[];
  background_top: Vec3;
  background_bottom: Vec3;
}

export const kMostClipPlanes = 6;
export const kMostSurfaces = 8;
export const kMostVolumes = 4; // that a server has open at once
export const kMostMeasurements = 64;

export class ViewVolume {
  readonly indexToWorldMatrix: Mat3;
  readonly origin: Vec3;
  private readonly worldToIndexMatrix: Mat3;

  constructor(readonly facts: VolumeFacts) {
    const column = (i: number): Vec3 => facts.index_to_world.slice(4 * i, 4 * i + 3) as unknown as Vec3;
    this.indexToWorldMatrix = [column(0), column(1), column(2)];
    this.origin = column(3);
    this.worldToIndexMatrix = inverse(this.indexToWorldMatrix);
  }

  get unit(): string {
    return this.facts.unit === 'millimetres' ? 'mm' : '';
  }
  get firstIsovalue(): number {
    const { isovalues, value_range } = this.facts;
    return isovalues[0] ?? 0.5 * (value_range[0] + value_range[1]);
  }
  hasGridOf({ facts }: ViewVolume): boolean {
    const other = new ViewVolume(facts), [x, y, z] = this.last();
    const rounding = 0.01 * Math.min(...this.facts.spacing);
    const places: Vec3[] = [[0, 0, 0], [x, 0, 0], [0, y, 0], [0, 0, z]];
    const isNear = (at: Vec3): boolean => length(subtract(this.indexToWorld(at), other.indexToWorld(at))) <= rounding;
    return String(facts.dimensions) === String(this.facts.dimensions) && places.every(isNear);
  }
  indexToWorld(index: Vec3): Vec3 {
    return add(this.origin, times(this.indexToWorldMatrix, index));
  }
  worldToIndex(world: Vec3): Vec3 {
    return times(this.worldToIndexMatrix, subtract(world, this.origin));
  }
  last(): Vec3 {
    return mapped(this.facts.dimensions, (count) => count - 1);
  }
  box(): Box {
    return this.boxAround([0, 0, 0], this.last());
  }
  // The world's box around a box of voxel indices.
  boxAround(lower: Vec3, upper: Vec3): Box {
    return boxAround(cornersOf({ lower, upper }).map((index) => this.indexToWorld(index)));
  }
  // Voxels from any point of the volume to the furthest.
  diagonal(): number {
    return length(this.last());
  }
  // Of the world.
  size(): number {
    return length(subtract(this.box().upper, this.box().lower));
  }
}

export const kSurfaceColors: readonly Vec3[] = [
  [0.9, 0.86, 0.79], [0.8, 0.45, 0.38], [0.45, 0.66, 0.85], [0.6, 0.75, 0.42],
  [0.93, 0.78, 0.4], [0.68, 0.52, 0.78], [0.4, 0.72, 0.68], [0.85, 0.6, 0.7],
];

const kBackgrounds: Readonly<Record<'dark' | 'light', readonly [Vec3, Vec3]>> = {
  dark: [[0.36, 0.38, 0.41], [0.16, 0.17, 0.19]],
  light: [[0.96, 0.97, 0.98], [0.78, 0.8, 0.83]],
};

export function firstView(volume: ViewVolume, aspect: number, theme: 'dark' | 'light'): ViewState {
  const [least, greatest] = volume.facts.value_range;
  const [background_top, background_bottom] = kBackgrounds[theme];
  const from_the_left = { azimuth: 25, elevation: 15, vertical_fov: 30, orthographic: false };
  const camera = { pivot: [0, 0, 0] as Vec3, distance: 1, ...from_the_left };
  const radius = Math.max(8, 0.25 * Math.max(...volume.facts.dimensions));
  return {
    camera: framed(camera, volume.box(), aspect),
    surfaces: [{ isovalue: volume.firstIsovalue, color: kSurfaceColors[0]!, opacity: 1, visible: true, volume: 0 }],
    active_surface: 0,
    focus: { center: scale(volume.last(), 0.5), radius, everywhere: true },
    beside: [],
    step: 0,
    clip_planes: [],
    value_window: [least, greatest],
    coloring: 'plain',
    measurements: [],
    background_top,
    background_bottom,
  };
}

// With every number in its range.
export function bounded(state: ViewState, volume: ViewVolume): ViewState {
  const size = volume.size();
  // A volume without a surface goes.
  const most = state.surfaces.slice(0, kMostSurfaces);
  const beside = state.beside.filter((id, i) => id >= 0 && most.some((s) => s.volume === i + 1));
  const surfaces = most.map((surface) => ({
    ...surface,
    opacity: clamp(surface.opacity, 0, 1),
    volume: 1 + beside.indexOf(state.beside[surface.volume - 1]!),
  }));
  const last = volume.last();
  return {
    ...state,
    camera: {
      ...state.camera,
      distance: clamp(state.camera.distance, 1e-5 * size, 100 * size),
      elevation: clamp(state.camera.elevation, -90, 90),
      vertical_fov: clamp(state.camera.vertical_fov, 1, 150),
    },
    surfaces,
    beside,
    active_surface: clamp(state.active_surface, 0, surfaces.length - 1),
    focus: {
      ...state.focus,
      center: mapped(state.focus.center, (value, axis) => clamp(value, 0, last[axis]!)),
      radius: clamp(state.focus.radius, 1, volume.diagonal()),
    },
    clip_planes: state.clip_planes.slice(0, kMostClipPlanes).map((p) => ({ ...p, normal: unit(p.normal) })),
    measurements: state.measurements.slice(0, kMostMeasurements),
  };
}

// Of a surface in the scene, by the volume's id and its place among those of the volume.
export const surfaceNumber = (volume: number, place: number): number => volume * kMostSurfaces + place;

// A list with a change of element i.
export const replaced = <T>(list: readonly T[], i: number, change: Partial<T>): T[] =>
  list.map((item, at) => (at === i ? { ...item, ...change } : item));

export const activeSurface = (state: ViewState): ViewSurface => state.surfaces[state.active_surface]!;

export const withActive = (state: ViewState, change: Partial<ViewSurface>): ViewState => ({
  ...state,
  surfaces: replaced(state.surfaces, state.active_surface, change),
});

// With one more, of the next suggestion and colour; or of another volume, at the end.
export function withSurface(state: ViewState, { facts }: ViewVolume, change: Partial<ViewSurface> = {}): ViewState {
  const color = kSurfaceColors.find((c) => !state.surfaces.some((s) => String(s.color) === String(c)));
  const isovalue = facts.isovalues.find((value) => !state.surfaces.some((s) => s.isovalue === value));
  const look = { ...(color && { color }), ...(isovalue !== undefined && { isovalue }) };
  const surfaces = [...state.surfaces, { ...activeSurface(state), ...look, ...change }];
  return { ...state, surfaces, active_surface: state.surfaces.length };
}
export function withVolume(state: ViewState, volume: ViewVolume): ViewState {
  const beside = [...state.beside, volume.facts.id];
  const change = { volume: beside.length, isovalue: volume.firstIsovalue, opacity: 1, visible: true };
  return withSurface({ ...state, beside }, volume, change);
}

// The view turns about the point, and the focus moves there.
export function focusedOn(state: ViewState, world: Vec3, volume: ViewVolume): ViewState {
  const focus = { ...state.focus, center: volume.worldToIndex(world) };
  return bounded({ ...state, camera: { ...state.camera, pivot: world }, focus }, volume);
}

// A clip plane across an axis of the world through the focus, or that one off, or on again.
export function withClipPlane(state: ViewState, axis: number, volume: ViewVolume): ViewState {
  const found = state.clip_planes.findIndex((plane) => Math.abs(plane.normal[axis]!) === 1);
  const enabled = !state.clip_planes[found]?.enabled;
  if (found >= 0) return { ...state, clip_planes: replaced(state.clip_planes, found, { enabled }) };
  if (state.clip_planes.length === kMostClipPlanes) return state;
  const normal = mapped([0, 0, 0], (_, i) => (i === axis ? 1 : 0));
  const offset = volume.indexToWorld(state.focus.center)[axis]!;
  return { ...state, clip_planes: [...state.clip_planes, { normal, offset, enabled, cap: true }] };
}
