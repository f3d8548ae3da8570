// What is written over the scene: the scale bar, measures, and the points picked so far.
import { placeCamera, placeOf } from './camera';
import { cross, dot, length, subtract, type Vec3 } from './vector';
import type { ViewMeasurement, ViewState } from './view_state';

// Four digits, and all of those before the point (viewer/state/measurement.h).
export function shortNumber(value: number): string {
  const size = Math.abs(value);
  return size >= 1e4 && size < 1e15 ? value.toFixed(0) : String(Number(value.toPrecision(4)));
}

export function measurementText({ points }: ViewMeasurement, unit: string): string {
  const [a, b, c] = points as [Vec3, Vec3, Vec3 | undefined];
  if (c === undefined) return withUnit(shortNumber(length(subtract(a, b))), unit);
  const [p, q] = [subtract(a, b), subtract(c, b)];
  return `${((Math.atan2(length(cross(p, q)), dot(p, q)) * 180) / Math.PI).toFixed(1)}°`;
}

export const withUnit = (text: string, unit: string): string => (unit === '' ? text : `${text} ${unit}`);

// The longest of 1, 2 and 5 times a power of ten that fits.
function scaleBarOf(per_pixel: number, most_pixels: number): number {
  const most = per_pixel * most_pixels;
  const power = 10 ** Math.floor(Math.log10(most));
  return power * ([5, 2].find((times) => times * power <= most) ?? 1);
}

export function drawOverlay(layer: HTMLCanvasElement, state: ViewState, picked: readonly Vec3[], unit: string): void {
  const { width, height } = layer;
  const scale = devicePixelRatio;
  const camera = placeCamera(state.camera, width / height);
  const canvas = layer.getContext('2d')!;
  canvas.clearRect(0, 0, width, height);
  canvas.font = `${14 * scale}px system-ui, sans-serif`;
  canvas.lineCap = canvas.lineJoin = 'round';
  const stroke = (points: readonly (readonly [number, number])[]): void => {
    for (const [color, thick] of [['#000a', 4], ['#fff', 2]] as const) {
      canvas.strokeStyle = color;
      canvas.lineWidth = thick * scale;
      canvas.beginPath();
      for (const [x, y] of points) canvas.lineTo(x, y);
      canvas.stroke();
    }
  };
  const write = (text: string, x: number, y: number): void => {
    canvas.strokeStyle = '#000c';
    canvas.lineWidth = 3 * scale;
    canvas.strokeText(text, x, y);
    canvas.fillStyle = '#fff';
    canvas.fillText(text, x, y);
  };
  const pixelOf = (point: Vec3): [number, number] | undefined => {
    const place = placeOf(camera, point);
    return place && [(0.5 + 0.5 * place[0]) * width, (0.5 - 0.5 * place[1]) * height];
  };
  const lines = (points: readonly Vec3[]): [number, number][] => {
    const pixels = points.map(pixelOf).filter((pixel) => pixel !== undefined);
    stroke(pixels);
    for (const [x, y] of pixels) {
      canvas.fillStyle = '#fff';
      canvas.beginPath();
      canvas.arc(x, y, 3 * scale, 0, 7);
      canvas.fill();
    }
    return pixels;
  };
  for (const measurement of state.measurements) {
    const pixels = lines(measurement.points);
    const at = pixels.length === 3 ? pixels[1] : pixels[pixels.length - 1];
    if (at) write(measurementText(measurement, unit), at[0] + 8 * scale, at[1] - 8 * scale);
  }
  lines(picked);

  const seen = 2 * camera.half_height * (camera.orthographic ? 1 : state.camera.distance);
  const bar = scaleBarOf(seen / height, 0.25 * width);
  const pixels = (bar / seen) * height;
  const [right, foot] = [width - 16 * scale, height - 16 * scale];
  const [left, top] = [right - pixels, foot - 5 * scale];
  stroke([[left, top], [left, foot], [right, foot], [right, top]]);
  canvas.textAlign = 'center';
  write(withUnit(String(Number(bar.toPrecision(6))), unit), right - pixels / 2, foot - 9 * scale);
  canvas.textAlign = 'start';
}
