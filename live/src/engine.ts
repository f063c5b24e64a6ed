// MuJoCo: models from what the page holds, with a run's changes written into them.
import load, { type MainModule, type MjData, type MjModel } from "@mujoco/mujoco";
import { type Fields, type Model, blob, engineBytes, unpacked } from "./page_data";

export type { MjData, MjModel };
export type Engine = MainModule;

export async function loadEngine(): Promise<Engine> {
  return load({ wasmBinary: await engineBytes() });
}

/** What MuJoCo says of an exception, which may be a pointer. */
export function reasonOf(engine: Engine, error: unknown): string {
  if (typeof error === "number") {
    const said: unknown = (engine as unknown as { getExceptionMessage(error: number): unknown }).getExceptionMessage(error);
    return Array.isArray(said) ? said.join(": ") : String(said);
  }
  return error instanceof Error ? error.message : String(error);
}

export async function compile(engine: Engine, model: Model): Promise<MjModel> {
  const files = new engine.MjVFS();
  try {
    if (model.bytes !== undefined) {
      files.addBuffer("model.mjb", await blob(model.bytes));
      return engine.MjModel.from_binary_path("model.mjb", files);
    }
    for (const [name, place] of Object.entries(model.files ?? {})) files.addBuffer(name, await blob(place));
    const made = engine.MjModel.from_xml_string(model.alone ?? "", files);
    if (model.numbers) {
      // MJCF has few digits: what was compiled is written over what it gives.
      for (const [name, column] of Object.entries(await unpacked(model.numbers))) {
        const [owner, key] = ownerOf(made, name);
        const field = owner[key];
        if (typeof field === "number") owner[key] = column[0]!;
        else if (isArray(field) && field.length === column.length) field.set(column);
      }
    }
    return made;
  } finally {
    files.delete();
  }
}

type NumberArray = Float64Array | Float32Array | Int32Array | Uint8Array;
type Owner = Record<string, number | NumberArray | undefined>;

const isArray = (value: unknown): value is NumberArray => ArrayBuffer.isView(value);

/** The object that has a field, as `opt.timestep`, and the field's name there. */
function ownerOf(model: MjModel, path: string): [Owner, string] {
  const [first, second] = path.split(".") as [string, string?];
  const whole = model as unknown as Owner & Record<string, Owner>;
  return second === undefined ? [whole, first] : [whole[first] as Owner, second];
}

/** Write changes into a model; return the fields that this version of MuJoCo lacks. */
export function write(model: MjModel, fields: Fields): string[] {
  const lacking: string[] = [];
  for (const [path, [places, values]] of Object.entries(fields)) {
    const [owner, key] = ownerOf(model, path);
    const field = owner[key];
    if (typeof field === "number") owner[key] = values[0]!;
    else if (isArray(field) && places.every((place) => place < field.length)) {
      places.forEach((place, index) => { field[place] = values[index]!; });
    } else lacking.push(path);
  }
  return lacking;
}

/** What a field of a model holds, by its path; undefined where this version of MuJoCo has none. */
export function valueOf(model: MjModel, path: string): ArrayLike<number> | number | undefined {
  const [owner, key] = ownerOf(model, path);
  return owner[key];
}
