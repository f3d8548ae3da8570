// Chunks of one volume in the scene of another, by the rules of viewer/stream/moved_chunk.h: points that
// were the same in two chunks are the same to the bit after it.
import type { DrawnChunk } from './scene_renderer';
import { add, boxAround, cornersOf, mapped, scale, type Vec3 } from './vector';
import type { ViewVolume } from './view_state';

const kPerVoxel = 1024; // places of the scene

export function movedChunk(chunk: DrawnChunk, from: ViewVolume, to: ViewVolume): DrawnChunk {
  const inScene = (place: Vec3): Vec3 =>
    to.worldToIndex(from.indexToWorld(add(chunk.origin, scale(place, chunk.step))));
  const origin = mapped(inScene([0, 0, 0]), Math.round);
  const stepsTo = (place: Vec3): Vec3 =>
    mapped(inScene(place), (value, axis) => Math.round(value * kPerVoxel) - kPerVoxel * origin[axis]!);
  const { positions, lower, upper } = chunk;
  const moved = new Float32Array(positions.length);
  for (let i = 0; i < moved.length; i += 4) {
    const high = positions[i + 3]!;
    moved.set(stepsTo(mapped([0, 0, 0], (_, axis) => positions[i + axis]! + 65536 * ((high >> (5 * axis)) & 31))), i);
  }
  const box = boxAround(cornersOf({ lower, upper }).map(stepsTo));
  return { ...chunk, ...box, origin, step: 1 / kPerVoxel, positions: moved };
}
