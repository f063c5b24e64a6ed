// Depth of the deepest contact in every step that was made, and where time is.
import { find, length } from "./elements";

const TALL = 48; // CSS pixels
const TEXT = 14; // of them above the highest column

export class DepthGraph {
  private readonly canvas = find<HTMLCanvasElement>("depths");
  private colours = { edge: "", link: "", faint: "" };

  constructor() {
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.paint());
    this.paint();
  }

  private paint(): void {
    const style = getComputedStyle(document.body);
    const of = (name: string): string => style.getPropertyValue(`--${name}`);
    this.colours = { edge: of("edge"), link: of("link"), faint: of("faint") };
  }

  /** Draw depths by step [m], NaN where none was reached, as one shape. */
  draw(depths: Float32Array, at: number): void {
    const { canvas, colours } = this;
    const context = canvas.getContext("2d");
    if (!context) return;
    const scale = devicePixelRatio;
    const [width, height] = [Math.max(1, Math.round(canvas.clientWidth * scale)), Math.round(TALL * scale)];
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const steps = depths.length - 1;
    const columns = new Float32Array(width);
    let largest = 0;
    for (let step = 0; step <= steps; step++) {
      const depth = depths[step]!;
      if (!(depth > 0)) continue;
      const column = Math.min(width - 1, Math.floor((step / steps) * width));
      if (depth > columns[column]!) columns[column] = depth;
      if (depth > largest) largest = depth;
    }
    context.clearRect(0, 0, width, height);
    const tall = largest ? (height - TEXT * scale) / largest : 0;
    context.beginPath();
    columns.forEach((depth, column) => {
      if (depth) context.rect(column, height - depth * tall, 1, depth * tall);
    });
    context.fillStyle = colours.edge;
    context.fill();
    context.fillStyle = colours.link;
    context.fillRect((at / steps) * width - scale, 0, 2 * scale, height);
    context.fillStyle = colours.faint;
    context.font = `${11 * scale}px system-ui, sans-serif`;
    context.fillText(largest ? `depth, ${length(largest)} at most so far` : "depth", 2 * scale, 11 * scale);
  }
}
