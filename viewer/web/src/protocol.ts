// The messages of the stream, as docs/SERVE.md describes them.
import type { Vec3 } from './vector';

export type Range = readonly [number, number]; // chunk numbers, both ends included

export interface VolumeEntry {
  id: number;
  name: string;
  error?: string;
}

export interface VolumeFacts extends VolumeEntry {
  dimensions: Vec3;
  spacing: Vec3;
  index_to_world: readonly number[]; // 4 x 4, column after column
  unit: 'millimetres' | 'unknown';
  value_range: readonly [number, number];
  position_step: number;
  histogram: { least: number; greatest: number; counts: number[]; triangles?: number[] };
  isovalues: number[];
}

export interface Wish {
  type: 'wish';
  volume: number; // the id of it
  surfaces: { iso: number; visible: boolean }[];
  focus?: Vec3; // voxel indices
  radius?: number; // voxels
  most_triangles: number;
}

export interface Show {
  type: 'show';
  volume: number;
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
  | { type: 'fine'; volume: number; wish: number; limited?: string }
  | { type: 'error'; volume: number; error: string; ended?: boolean }
  | { type: 'ended'; volume: number };

// Where a request goes, from the folder of the page on, so that proxies may put a path in front.
export const addressOf = (path: string): URL => new URL(`api/${path}`, document.baseURI);

// Throws an Error with one line: the server's, with its statusOf(), or why there is none.
export async function request(path: string, token: string): Promise<Response> {
  const response = await fetch(addressOf(path), { headers: { Authorization: `Bearer ${token}` } });
  if (response.ok) return response;
  const { status } = response;
  const body = (await response.json().catch(() => ({}))) as { error?: string };
  throw Object.assign(new Error(body.error ?? `the server answers ${status}`), { status });
}
export const statusOf = (error: unknown): number | undefined => (error as { status?: number }).status;
