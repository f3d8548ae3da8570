// Points and directions of three numbers, and the matrix of a volume's grid. All of it in doubles.

export type Vec3 = readonly [number, number, number];

export const add = (a: Vec3, b: Vec3): Vec3 => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const subtract = (a: Vec3, b: Vec3): Vec3 => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const scale = (a: Vec3, by: number): Vec3 => [a[0] * by, a[1] * by, a[2] * by];
export const dot = (a: Vec3, b: Vec3): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a: Vec3, b: Vec3): Vec3 => [
  a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0],
];
export const length = (a: Vec3): number => Math.hypot(a[0], a[1], a[2]);
export const unit = (a: Vec3): Vec3 => scale(a, 1 / (length(a) || 1));
export const clamp = (value: number, least: number, most: number): number => Math.min(most, Math.max(least, value));
export const mapped = (a: Vec3, f: (value: number, axis: number) => number): Vec3 => [f(a[0], 0), f(a[1], 1), f(a[2], 2)];

// Three columns.
export type Mat3 = readonly [Vec3, Vec3, Vec3];

export const times = (m: Mat3, v: Vec3): Vec3 => add(add(scale(m[0], v[0]), scale(m[1], v[1])), scale(m[2], v[2]));
export const transposed = (m: Mat3): Mat3 => [
  [m[0][0], m[1][0], m[2][0]], [m[0][1], m[1][1], m[2][1]], [m[0][2], m[1][2], m[2][2]],
];
export const product = (a: Mat3, b: Mat3): Mat3 => [times(a, b[0]), times(a, b[1]), times(a, b[2])];
export function inverse(m: Mat3): Mat3 {
  const rows: Mat3 = [cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1])];
  const by = 1 / dot(m[0], rows[0]);
  return transposed([scale(rows[0], by), scale(rows[1], by), scale(rows[2], by)]);
}

// A box along the axes.
export interface Box {
  lower: Vec3;
  upper: Vec3;
}

export const boxAround = (points: readonly Vec3[]): Box => ({
  lower: mapped([0, 0, 0], (_, axis) => points.reduce((least, p) => Math.min(least, p[axis]!), Infinity)),
  upper: mapped([0, 0, 0], (_, axis) => points.reduce((most, p) => Math.max(most, p[axis]!), -Infinity)),
});
export const boxOf = (boxes: readonly Box[]): Box | undefined =>
  boxes.length === 0 ? undefined : boxAround(boxes.flatMap(({ lower, upper }) => [lower, upper]));
export const middle = (box: Box): Vec3 => scale(add(box.lower, box.upper), 0.5);
export const cornersOf = (box: Box): Vec3[] =>
  [0, 1, 2, 3, 4, 5, 6, 7].map((i) => mapped(box.lower, (low, axis) => ((i >> axis) & 1 ? box.upper[axis]! : low)));
