// The camera of a view, and functions that give the next one: those of viewer/state/view_camera.h,
// by the same names.
import { add, clamp, cornersOf, cross, dot, middle, scale, subtract, type Box, type Vec3 } from './vector';

// Turns about a pivot, which is in the middle of the picture. World units and degrees.
export interface ViewCamera {
  pivot: Vec3;
  distance: number;
  azimuth: number;
  elevation: number;
  vertical_fov: number;
  orthographic: boolean;
}

export type Place = readonly [number, number]; // normalised device coordinates

export interface PlacedCamera {
  eye: Vec3;
  right: Vec3;
  up: Vec3;
  forward: Vec3;
  half_width: number; // of the picture: at distance 1, or in world units if orthographic
  half_height: number;
  orthographic: boolean;
}

const kMargin = 1.06; // around what is framed
const radians = (degrees: number): number => (degrees * Math.PI) / 180;
const halfHeight = (camera: ViewCamera): number => Math.tan(0.5 * radians(camera.vertical_fov));

function axesOf(camera: ViewCamera): { right: Vec3; up: Vec3; forward: Vec3 } {
  const [azimuth, elevation] = [radians(camera.azimuth), radians(camera.elevation)];
  const outward: Vec3 = [Math.sin(azimuth), -Math.cos(azimuth), 0];
  const axis: Vec3 = [0, 0, 1];
  const forward = scale(add(scale(outward, Math.cos(elevation)), scale(axis, Math.sin(elevation))), -1);
  const up = subtract(scale(axis, Math.cos(elevation)), scale(outward, Math.sin(elevation)));
  return { right: cross(forward, up), up, forward };
}

// `aspect` is width / height of the picture.
export function placeCamera(camera: ViewCamera, aspect: number): PlacedCamera {
  const axes = axesOf(camera);
  const half_height = halfHeight(camera) * (camera.orthographic ? camera.distance : 1);
  const eye = subtract(camera.pivot, scale(axes.forward, camera.distance));
  return { ...axes, eye, half_height, half_width: half_height * aspect, orthographic: camera.orthographic };
}

// The same direction, from a place that sees the whole box; the pivot is its middle.
export function framed(camera: ViewCamera, box: Box, aspect: number): ViewCamera {
  const { right, up, forward } = axesOf(camera);
  const pivot = middle(box);
  const half_height = halfHeight(camera) / kMargin;
  let distance = 0;
  for (const corner of cornersOf(box)) {
    const arm = subtract(corner, pivot);
    const aside = Math.max(Math.abs(dot(arm, right)) / aspect, Math.abs(dot(arm, up))) / half_height;
    distance = Math.max(distance, aside - (camera.orthographic ? 0 : dot(arm, forward)));
  }
  return { ...camera, pivot, distance: distance > 0 ? distance : camera.distance };
}

export const orbited = (camera: ViewCamera, azimuth: number, elevation: number): ViewCamera => ({
  ...camera,
  azimuth: camera.azimuth + azimuth - 360 * Math.round((camera.azimuth + azimuth) / 360),
  elevation: clamp(camera.elevation + elevation, -90, 90),
});

// A point of the pivot's plane, from the pivot; `place` in normalised device coordinates.
function inPivotPlane(camera: ViewCamera, place: Place, aspect: number): Vec3 {
  const { right, up } = axesOf(camera);
  const half_height = halfHeight(camera) * camera.distance;
  return add(scale(right, place[0] * half_height * aspect), scale(up, place[1] * half_height));
}

// Moved so that points in the pivot's plane move by `shift` (normalised device coordinates).
export const panned = (camera: ViewCamera, shift: Place, aspect: number): ViewCamera => ({
  ...camera,
  pivot: subtract(camera.pivot, inPivotPlane(camera, shift, aspect)),
});

// The distance times `factor`; the point of the pivot's plane under `cursor` stays where it is.
// `size`: of the volume, which bounds the distance.
export function zoomed(camera: ViewCamera, factor: number, cursor: Place, aspect: number, size: number): ViewCamera {
  const distance = clamp(camera.distance * factor, 1e-4 * size, 20 * size);
  const kept = distance / camera.distance;
  const under = inPivotPlane(camera, cursor, aspect);
  return { ...camera, distance, pivot: add(camera.pivot, scale(under, 1 - kept)) };
}

// Near and far that just hold the box.
export function depthRangeOf(box: Box, camera: PlacedCamera): { near: number; far: number } {
  const depths = cornersOf(box).map((corner) => dot(subtract(corner, camera.eye), camera.forward));
  const [least, greatest] = [Math.min(...depths), Math.max(...depths)];
  if (camera.orthographic) {
    const rim = Math.max(1e-3 * (greatest - least), 1e-9);
    return { near: least - rim, far: greatest + rim };
  }
  const far = greatest > 0 ? 1.001 * greatest : 1;
  return { near: Math.max(0.999 * least, 1e-4 * far), far };
}

// The world's point under a place of the picture, at a distance along the view.
export function pointAt(camera: PlacedCamera, place: Place, distance: number): Vec3 {
  const by = camera.orthographic ? 1 : distance;
  const right = scale(camera.right, place[0] * camera.half_width * by);
  const up = scale(camera.up, place[1] * camera.half_height * by);
  return add(camera.eye, add(scale(camera.forward, distance), add(right, up)));
}

// Where a point of the world is seen, in normalised device coordinates; none behind the eye.
export function placeOf(camera: PlacedCamera, point: Vec3): Place | undefined {
  const arm = subtract(point, camera.eye);
  const by = camera.orthographic ? 1 : dot(arm, camera.forward);
  if (!(by > 0)) return undefined;
  return [dot(arm, camera.right) / (by * camera.half_width), dot(arm, camera.up) / (by * camera.half_height)];
}
