// What the page holds, as contactlab/live/live_page.py writes it, and how it is unpacked.

/** Numbers by field of the model: flat places, and what stands there. */
export type Fields = Record<string, [number[], number[]]>;

export interface Packed {
  columns: [string, "f4" | "f8", number][];
  bytes: string;
}

/** P inputs over time: levels at K knots, shared times or each input's own. */
export interface Inputs extends Packed {
  places: number[];
  knots: number;
}

/** All that a motion is simulated from. */
export interface Whole {
  model: number;
  fields: Fields;
  parts: Packed;
  inputs: number | null;
  steps: number;
}

/** What tells a value of a slider from the run itself, or all of it where the structure differs. */
export interface Stop extends Partial<Omit<Whole, "fields" | "steps">> {
  text: string;
  fields: Fields;
  steps: number;
  moved?: Fields;
}

export interface Slider {
  name: string;
  unit: string;
  own: number;
  stops: Stop[];
}

/** A change of the run's model that is made or not: a row of its budget, or what mends it. */
export interface Switch {
  kind: string;
  name: string;
  summary: string;
  /** What is known of it: its share, or its cost. */
  told: string;
  fields: Fields;
  steps: number;
}

export interface Run extends Partial<Whole> {
  id: string;
  label: string;
  reasons: string[];
  axes: [string, string][];
  /** Of the engine that made the record. */
  version: string;
  notes: string[];
  why: string;
  end?: Packed;
  ghost?: Packed;
  sliders?: Slider[];
  switches?: Switch[];
  film?: string | null;
}

/** What a material looks like: a picture, of so many pixels, or its mean colour. */
export interface Texture {
  material: number;
  mean: [number, number, number];
  repeat: [number, number];
  uniform: boolean;
  width?: number;
  height?: number;
  blob?: number;
}

export interface Model {
  geoms: string[];
  textures: Texture[];
  /** As its author reads it, with files of his. */
  mjcf: string;
  /** The compiled model, where this MuJoCo has the version that compiled it; else all that follows. */
  bytes?: number;
  alone?: string;
  files?: Record<string, number>;
  numbers?: Packed;
}

export interface PageData {
  store: string;
  engine: string;
  runs: Run[];
  models: Model[];
  inputs: Inputs[];
  flags: Record<string, Record<string, number>>;
}

const text = (id: string): string => document.getElementById(id)?.textContent ?? "";

function bytesOf(base64: string): Uint8Array {
  const made = Uint8Array as unknown as { fromBase64?: (text: string) => Uint8Array };
  if (made.fromBase64) return made.fromBase64(base64);
  const letters = atob(base64);
  const bytes = new Uint8Array(letters.length);
  for (let at = 0; at < bytes.length; at++) bytes[at] = letters.charCodeAt(at);
  return bytes;
}

async function inflated(base64: string): Promise<Uint8Array> {
  const stream = new Blob([bytesOf(base64) as BlobPart]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

export const engineBytes = (): Promise<Uint8Array> => inflated(text("engine"));
export const blob = (place: number): Promise<Uint8Array> => inflated(text(`blob-${place}`));

export async function pageData(): Promise<PageData> {
  return JSON.parse(new TextDecoder().decode(await inflated(text("data"))));
}

/** Bytes are ordered by significance: all first bytes of a column, then all second ones, ... */
export async function unpacked(packed: Packed): Promise<Record<string, Float64Array | Float32Array>> {
  const bytes = await inflated(packed.bytes);
  const columns: Record<string, Float64Array | Float32Array> = {};
  let start = 0;
  for (const [name, kind, length] of packed.columns) {
    const array = kind === "f4" ? new Float32Array(length) : new Float64Array(length);
    const width = array.BYTES_PER_ELEMENT;
    const raw = new Uint8Array(array.buffer);
    for (let place = 0; place < width; place++) {
      const from = start + place * length;
      for (let index = 0; index < length; index++) raw[index * width + place] = bytes[from + index]!;
    }
    columns[name] = array;
    start += width * length;
  }
  return columns;
}
