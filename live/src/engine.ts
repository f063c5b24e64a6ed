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

/** The folder of the files of a model, while it is read. */
const FOLDER = "/model";

/** The models of a page, each read once, and copied for whoever changes it. */
export class Models {
  private readonly read = new Map<number, Promise<MjModel>>();

  constructor(
    private readonly engine: Engine,
    private readonly models: readonly Model[],
  ) {}

  async copy(place: number): Promise<MjModel> {
    if (!this.read.has(place)) this.read.set(place, compile(this.engine, this.models[place]!));
    return new this.engine.MjModel(await this.read.get(place)!);
  }
}

async function compile(engine: Engine, model: Model): Promise<MjModel> {
  const files: Record<string, Uint8Array> = {};
  if (model.bytes !== undefined) files["model.mjb"] = await blob(model.bytes);
  else {
    files["model.xml"] = new TextEncoder().encode(model.alone);
    for (const [name, place] of Object.entries(model.files ?? {})) files[name] = await blob(place);
  }
  const numbers = model.numbers && (await unpacked(model.numbers));
  // MuJoCo's own virtual files are filled byte by byte, which takes a second for each megabyte.
  const { FS } = engine as unknown as { FS: Disk };
  const none = new engine.MjVFS();
  FS.mkdirTree(FOLDER);
  for (const [name, bytes] of Object.entries(files)) FS.writeFile(`${FOLDER}/${name}`, bytes);
  try {
    if (model.bytes !== undefined) return engine.MjModel.from_binary_path(`${FOLDER}/model.mjb`, none);
    const made = engine.MjModel.from_xml_path(`${FOLDER}/model.xml`, none);
    // MJCF has few digits: what was compiled is written over what it gives.
    for (const [name, column] of Object.entries(numbers ?? {})) {
      const [owner, key] = ownerOf(made, name);
      const field = owner[key];
      if (typeof field === "number") owner[key] = column[0]!;
      else if (isArray(field) && field.length === column.length) field.set(column);
    }
    return made;
  } finally {
    none.delete();
    for (const name of Object.keys(files)) FS.unlink(`${FOLDER}/${name}`);
  }
}

interface Disk {
  mkdirTree(path: string): void;
  writeFile(path: string, bytes: Uint8Array): void;
  unlink(path: string): void;
}

type NumberArray = Float64Array | Float32Array | Int32Array | Uint8Array;
type Owner = Record<string, number | NumberArray | undefined>;

const isArray = (value: unknown): value is NumberArray => ArrayBuffer.isView(value);

/** Fields of which changes turn bits. */
export const BITS: ReadonlySet<string> = new Set(["opt.disableflags", "opt.enableflags"]);

/** The object that has a field, as `opt.timestep`, and the field's name there. */
function ownerOf(model: MjModel, path: string): [Owner, string] {
  const [first, second] = path.split(".") as [string, string?];
  const whole = model as unknown as Owner & Record<string, Owner>;
  return second === undefined ? [whole, first] : [whole[first] as Owner, second];
}

/** Write a run's fields into a model, then each change of it; return the fields that this MuJoCo lacks. */
export function write(model: MjModel, [first, ...changes]: readonly Fields[]): string[] {
  const lacking = new Set(put(model, first ?? {}));
  const own = Object.fromEntries([...BITS].map((path) => [path, Number(valueOf(model, path))]));
  for (const change of changes) {
    for (const path of put(model, change, own)) lacking.add(path);
  }
  return [...lacking];
}

/** Put numbers into a model; of bits, turn those that differ from its own. */
function put(model: MjModel, fields: Fields, own: Record<string, number> = {}): string[] {
  const lacking: string[] = [];
  for (const [path, [places, values]] of Object.entries(fields)) {
    const [owner, key] = ownerOf(model, path);
    const field = owner[key];
    if (typeof field === "number") owner[key] = path in own ? field ^ own[path]! ^ values[0]! : values[0]!;
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
