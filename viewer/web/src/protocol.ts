// The messages of the stream, as docs/SERVE.md describes them.
import type { Mat3, Vec3 } from './vector';
import { ViewVolume } from './view_state';

export type Range = readonly [number, number]; // chunk numbers, both ends included

export interface VolumeEntry {
  id: number;
  name: string;
  error?: string;
}

export interface VolumeFacts extends VolumeEntry {
  dimensions: Vec3;
  spacing: Vec3;
  origin: Vec3;
  direction: readonly number[]; // column after column
  unit: 'millimetres' | 'unknown';
  value_range: readonly [number, number];
  position_step: number;
  histogram: { least: number; greatest: number; counts: number[]; triangles?: number[] };
  isovalues: number[];
}

export interface Wish {
  surfaces: { iso: number; visible: boolean }[];
  focus?: Vec3; // voxel indices
  radius?: number; // voxels
  most_triangles: number;
}

export interface Show {
  type: 'show';
  pass: number;
  show: Range[];
  drop: Range[];
  triangles: number;
  surfaces: { surface: number; triangles: number; levels: [number, number][] }[];
  limited?: string;
}

export type ServerMessage =
  | { type: 'opening'; phase: string; share: number }
  | ({ type: 'volume' } & VolumeFacts)
  | Show
  | { type: 'drop'; drop: Range[] }
  | { type: 'fine'; wish: number; limited?: string }
  | { type: 'error'; error: string };

export function volumeOf(facts: VolumeFacts): ViewVolume {
  const column = (i: number): Vec3 => facts.direction.slice(3 * i, 3 * i + 3) as unknown as Vec3;
  const direction: Mat3 = [column(0), column(1), column(2)];
  const unit = facts.unit === 'millimetres' ? 'mm' : '';
  const { dimensions, origin, spacing, value_range, isovalues } = facts;
  return new ViewVolume(dimensions, origin, spacing, direction, value_range, isovalues, unit);
}

// Where a request goes, from the folder of the page on, so that proxies may put a path in front.
export const addressOf = (path: string): URL => new URL(`api/${path}`, document.baseURI);

// Throws an Error with one line: the server's, or why there is none.
export async function request(path: string, token: string): Promise<Response> {
  const response = await fetch(addressOf(path), { headers: { Authorization: `Bearer ${token}` } });
  if (response.ok) return response;
  const body = (await response.json().catch(() => ({}))) as { error?: string };
  throw new RequestError(response.status, body.error ?? `the server answers ${response.status}`);
}

export class RequestError extends Error {
  constructor(readonly status: number, message: string) {
    super(message);
  }
}
