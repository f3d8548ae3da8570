// A binary message of the stream, which is one chunk (docs/SERVE.md), unpacked. Runs in workers.
import { MeshoptDecoder } from 'meshoptimizer/decoder';
import type { Vec3 } from './vector';

export interface UnpackedChunk {
  id: number;
  volume: number; // the id of it
  surface: number; // its place among those of the volume
  level: number;
  origin: Vec3; // steps
  lower: Vec3; // of the least box around its positions
  upper: Vec3;
  positions: Uint16Array; // 4 a vertex: x y z, and further bits of them as the message has them
  normals: Int16Array; // likewise
  triangles: Uint16Array | Uint32Array;
}

const kHeadBytes = 48;

export const volumeOfChunk = (message: ArrayBuffer): number => new DataView(message).getUint32(44, true);

export async function unpackChunk(message: ArrayBuffer): Promise<UnpackedChunk> {
  await MeshoptDecoder.ready;
  const head = new DataView(message);
  const word = (at: number): number => head.getUint32(at, true);
  if (message.byteLength < kHeadBytes || word(0) !== 0x43425349) throw new Error('a message is no chunk');
  const [vertices, indices] = [word(24), 3 * word(28)];
  let at = kHeadBytes;
  const unpack = (target: ArrayBufferView, count: number, bytes: number, mode: string, filter: string): void => {
    const packed = new Uint8Array(message, at, bytes);
    at += (bytes + 3) & ~3;
    const into = new Uint8Array(target.buffer);
    MeshoptDecoder.decodeGltfBuffer(into, count, into.length / count, packed, mode, filter);
  };
  const positions = new Uint16Array(4 * vertices);
  const normals = new Int16Array(4 * vertices);
  const triangles = vertices <= 65536 ? new Uint16Array(indices) : new Uint32Array(indices);
  unpack(positions, vertices, word(32), 'ATTRIBUTES', 'NONE');
  unpack(normals, vertices, word(36), 'ATTRIBUTES', 'OCTAHEDRAL');
  unpack(triangles, indices, word(40), 'TRIANGLES', 'NONE');
  return {
    id: word(4),
    volume: volumeOfChunk(message),
    surface: head.getUint16(8, true),
    level: head.getUint8(10),
    origin: [head.getInt32(12, true), head.getInt32(16, true), head.getInt32(20, true)],
    ...boxAround(positions),
    positions,
    normals,
    triangles,
  };
}

function boxAround(positions: Uint16Array): { lower: Vec3; upper: Vec3 } {
  const lower: [number, number, number] = [Infinity, Infinity, Infinity];
  const upper: [number, number, number] = [0, 0, 0];
  for (let i = 0; i < positions.length; i += 4)
    for (let axis = 0; axis < 3; ++axis) {
      const place = positions[i + axis]! + 65536 * ((positions[i + 3]! >> (5 * axis)) & 31);
      if (place < lower[axis]!) lower[axis] = place;
      if (place > upper[axis]!) upper[axis] = place;
    }
  return { lower, upper };
}
