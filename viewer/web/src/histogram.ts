// The histogram, the pencil of isosurfaces under it, and over both a slider of the isovalue.
import type { VolumeFacts } from './protocol';
import { clamp } from './vector';
import { activeSurface, type ViewState } from './view_state';

const kSteps: Readonly<Record<string, number>> = {
  ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10, Home: -Infinity, End: Infinity,
};

export class Histogram {
  private facts: VolumeFacts | undefined;
  private state: ViewState | undefined;

  // `choose`: a value that the user drags to or steps to; `hold`: a drag begins or ends.
  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly choose: (isovalue: number) => void,
    hold: (is_held: boolean) => void,
  ) {
    const drag = (event: PointerEvent): void => this.dragTo(event.clientX);
    canvas.addEventListener('pointerdown', (event) => {
      if (event.button !== 0) return;
      canvas.setPointerCapture(event.pointerId);
      canvas.addEventListener('pointermove', drag);
      hold(true);
      drag(event);
    });
    const end = (): void => {
      canvas.removeEventListener('pointermove', drag);
      hold(false);
    };
    canvas.addEventListener('lostpointercapture', end);
    canvas.addEventListener('keydown', (event) => this.step(event));
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  show(facts: VolumeFacts, state: ViewState): void {
    const [least, greatest] = facts.value_range;
    const { isovalue } = activeSurface(state);
    this.canvas.setAttribute('aria-valuemin', String(least));
    this.canvas.setAttribute('aria-valuemax', String(greatest));
    this.canvas.setAttribute('aria-valuenow', String(isovalue));
    this.facts = facts;
    this.state = state;
    this.draw();
  }

  private dragTo(client_x: number): void {
    if (!this.facts) return;
    const { least, greatest } = this.facts.histogram;
    const box = this.canvas.getBoundingClientRect();
    const share = clamp((client_x - box.left) / box.width, 0, 1);
    const step = stepOf(greatest - least) / 10;
    this.choose(Math.round((least + share * (greatest - least)) / step) * step);
  }

  private step(event: KeyboardEvent): void {
    if (!this.facts || !this.state || event.ctrlKey || event.metaKey) return;
    const [least, greatest] = this.facts.value_range;
    const step = stepOf(greatest - least) * (event.shiftKey ? 10 : 1);
    const now = activeSurface(this.state).isovalue;
    const steps = kSteps[event.key];
    if (steps === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    this.choose(clamp(now + steps * step, least, greatest));
  }

  private draw(): void {
    const { canvas, facts, state } = this;
    const context = canvas.getContext('2d');
    if (!context || !facts || !state) return;
    const scale = devicePixelRatio;
    const width = (canvas.width = Math.max(1, Math.round(canvas.clientWidth * scale)));
    const height = (canvas.height = Math.max(1, Math.round(canvas.clientHeight * scale)));
    const color = (name: string): string => getComputedStyle(canvas).getPropertyValue(name);
    const { least, greatest, counts, triangles } = facts.histogram;
    const bars = triangles ? 0.7 * height : height;
    const most = Math.log1p(Math.max(...counts));
    context.fillStyle = color('--line');
    counts.forEach((count, i) => {
      const tall = (Math.log1p(count) / most) * bars;
      context.fillRect((i * width) / counts.length, bars - tall, width / counts.length + 0.5, tall);
    });
    if (triangles) {
      const greatest_surface = Math.max(1, ...triangles);
      triangles.forEach((count, i) => {
        context.globalAlpha = count / greatest_surface;
        context.fillStyle = color('--accent');
        context.fillRect((i * width) / counts.length, bars + 2 * scale, width / counts.length + 0.5, height);
      });
      context.globalAlpha = 1;
    }
    const mark = (value: number, ink: string, thick: number, top: number): void => {
      context.fillStyle = ink;
      const x = ((value - least) / (greatest - least)) * width;
      context.fillRect(x - (thick * scale) / 2, top, thick * scale, height - top);
    };
    for (const value of facts.isovalues) mark(value, color('--good'), 2, 0.8 * bars);
    state.surfaces.forEach((surface, i) => {
      if (surface.volume !== activeSurface(state).volume) return;
      const is_active = i === state.active_surface;
      const rgb = surface.color.map((share) => Math.round(255 * share)).join(' ');
      mark(surface.isovalue, is_active ? color('--ink') : `rgb(${rgb})`, is_active ? 3 : 2, 0);
    });
  }
}

// A power of ten, a thousandth of the range or less.
export const stepOf = (range: number): number => 10 ** Math.floor(Math.log10(range / 1000));
