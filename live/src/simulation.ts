// One motion: its model, start and inputs, stepped, rewound and looked at.
import { type Choice, composed } from "./changes";
import { type Engine, type MjData, type MjModel, type Models, valueOf, write } from "./engine";
import { type Inputs, type PageData, type Run, unpacked } from "./page_data";

const SNAPSHOTS = 128;
const CONTACT = 5; // of mjtConstraint, the first that is a contact

type Numbers = Float64Array | Float32Array;
type Parts = Record<string, Numbers>;

interface Course {
  places: number[];
  knots: number;
  times: Numbers;
  levels: Numbers;
}

export interface Contact {
  depth: number;
  at: [number, number, number];
  force: [number, number, number];
  normal: number;
  geoms: [number, number];
}

export class Simulation {
  step = 0;
  /** Largest depth of a contact in each state that was reached [m]. */
  readonly depths: Float32Array;
  private readonly shown: MjData;
  private readonly snapshots = new Map<number, Float64Array>();
  private readonly force: InstanceType<Engine["DoubleBuffer"]>;
  private readonly state: InstanceType<Engine["DoubleBuffer"]>;
  private readonly kind: number;
  private readonly stride: number;
  private reached = 0;

  private constructor(
    private readonly engine: Engine,
    readonly model: MjModel,
    readonly data: MjData,
    readonly steps: number,
    readonly geoms: readonly string[],
    private readonly course: Course | null,
    readonly lacking: readonly string[],
  ) {
    this.depths = new Float32Array(steps + 1).fill(Number.NaN);
    this.shown = new engine.MjData(model);
    this.force = new engine.DoubleBuffer(6);
    this.kind = (engine.mjtState.mjSTATE_INTEGRATION as unknown as { value: number }).value;
    this.state = new engine.DoubleBuffer(engine.mj_stateSize(model, this.kind));
    this.stride = Math.max(1, Math.ceil(steps / SNAPSHOTS));
  }

  static async of(engine: Engine, models: Models, page: PageData, run: Run, choice: Choice): Promise<Simulation> {
    const { whole, patches, moved } = composed(run, choice);
    const model = await models.copy(whole.model);
    const parts = (await unpacked(whole.parts)) as Parts;
    for (const each of moved) {
      for (const [name, [places, values]] of Object.entries(each)) {
        places.forEach((place, index) => { parts[name]![place] = values[index]!; });
      }
    }
    const course = whole.inputs === null ? null : await courseOf(page.inputs[whole.inputs]!);
    const lacking = write(model, patches);
    const made = new Simulation(engine, model, new engine.MjData(model), whole.steps, page.models[whole.model]!.geoms, course, lacking);
    made.start(parts);
    return made;
  }

  get timestep(): number {
    return this.model.opt.timestep;
  }

  get time(): number {
    return this.step * this.timestep;
  }

  get isOver(): boolean {
    return this.step >= this.steps;
  }

  private start(parts: Parts): void {
    const { data } = this;
    const pose = parts.mocap!;
    const turns = 3 * this.model.nmocap;
    data.qpos.set(parts.qpos!);
    data.qvel.set(parts.qvel!);
    if (this.model.na) data.act.set(parts.act!);
    if (this.model.nu) data.ctrl.set(parts.ctrl!);
    data.xfrc_applied.set(parts.applied!);
    if (this.model.nmocap) {
      data.mocap_pos.set(pose.subarray(0, turns));
      data.mocap_quat.set(pose.subarray(turns));
    }
    this.remember();
  }

  private remember(): void {
    if (this.step % this.stride || this.snapshots.has(this.step)) return;
    this.engine.mj_getState(this.model, this.data, this.state, this.kind);
    this.snapshots.set(this.step, new Float64Array(this.state.GetView()));
  }

  /** Make one step, under the inputs at its beginning. */
  advance(): void {
    if (this.isOver) return;
    this.act(this.data, this.step * this.timestep);
    this.engine.mj_step(this.model, this.data);
    if (this.step >= this.reached) {
      this.depths[this.step] = deepest(this.data);
      this.reached = this.step + 1;
    }
    this.step += 1;
    this.remember();
  }

  /** Go to a step, from the nearest state before it that is remembered. */
  seek(step: number): void {
    const wanted = Math.min(Math.max(step, 0), this.steps);
    if (wanted < this.step || wanted - this.step > this.stride) {
      let from = Math.floor(wanted / this.stride) * this.stride;
      while (!this.snapshots.has(from)) from -= this.stride;
      if (wanted < this.step || from > this.step) {
        this.engine.mj_setState(this.model, this.data, this.snapshots.get(from) as unknown as number[], this.kind);
        this.step = from;
      }
    }
    while (this.step < wanted) this.advance();
  }

  private act(data: MjData, time: number): void {
    if (!this.course) return;
    const { places, knots, times, levels } = this.course;
    const own = times.length > knots;
    const { nu, nbody, nmocap } = this.model;
    const bodies = nu + 6 * nbody;
    const turns = bodies + 3 * nmocap;
    let [from, before, after, along, width] = [-1, 0, 0, 0, 1];
    places.forEach((place, row) => {
      if (own || from < 0) {
        from = own ? row * knots : 0;
        after = from;
        while (after < from + knots && times[after]! <= time) after++;
        before = Math.max(after - 1, from);
        after = Math.min(after, from + knots - 1);
        width = after > before ? times[after]! - times[before]! : 1;
        along = time - times[before]!;
        before -= from;
        after -= from;
      }
      const first = levels[row * knots + before]!;
      const level = ((levels[row * knots + after]! - first) / width) * along + first;
      if (place < nu) data.ctrl[place] = level;
      else if (place < bodies) data.xfrc_applied[place - nu] = level;
      else if (place < turns) data.mocap_pos[place - bodies] = level;
      else data.mocap_quat[place - turns] = level;
    });
  }

  /** The state as it is now, with poses, contacts and energies; what is stepped stays untouched. */
  look(): MjData {
    const { engine, model, data, shown } = this;
    engine.mj_getState(model, data, this.state, this.kind);
    engine.mj_setState(model, shown, this.state.GetView() as unknown as number[], this.kind);
    this.act(shown, this.time);
    engine.mj_forward(model, shown);
    engine.mj_energyPos(model, shown);
    engine.mj_energyVel(model, shown);
    return shown;
  }

  /** The contacts of the state that was looked at last, with the force on the second geom. */
  contacts(): Contact[] {
    const found: Contact[] = [];
    const all = this.shown.contact;
    for (let index = 0; index < this.shown.ncon; index++) {
      const contact = all.get(index);
      if (!contact) continue;
      const [frame, at] = [contact.frame as Float64Array, contact.pos as Float64Array];
      let force = [0, 0, 0];
      if (contact.efc_address >= 0) {
        this.engine.mj_contactForce(this.model, this.shown, index, this.force);
        const given = this.force.GetView() as Float64Array;
        force = [0, 1, 2].map((axis) => given[0]! * frame[axis]! + given[1]! * frame[3 + axis]! + given[2]! * frame[6 + axis]!);
      }
      found.push({
        depth: -contact.dist,
        at: [at[0]!, at[1]!, at[2]!],
        force: force as [number, number, number],
        normal: Math.hypot(...force),
        geoms: [contact.geom1, contact.geom2],
      });
      contact.delete();
    }
    all.delete?.();
    return found;
  }

  /** Potential and kinetic energy of the state that was looked at last [J]. */
  get energy(): [number, number] {
    const energy = this.shown.energy as Float64Array;
    return [energy[0]!, energy[1]!];
  }

  /** What a field of the model holds now. */
  read(field: string): ArrayLike<number> | number | undefined {
    return valueOf(this.model, field);
  }

  /** The state now, as a keyframe has it. */
  get keyframe(): Record<string, ArrayLike<number>> {
    const { qpos, qvel, act, ctrl, mocap_pos, mocap_quat } = this.data;
    return { qpos, qvel, act, ctrl, mpos: mocap_pos, mquat: mocap_quat };
  }

  /** qpos and qvel after the steps made. */
  end(): { qpos: Float64Array; qvel: Float64Array } {
    return { qpos: new Float64Array(this.data.qpos), qvel: new Float64Array(this.data.qvel) };
  }

  delete(): void {
    for (const each of [this.shown, this.data, this.force, this.state, this.model]) each.delete();
  }
}

async function courseOf(inputs: Inputs): Promise<Course> {
  const { times, levels } = await unpacked(inputs);
  return { places: inputs.places, knots: inputs.knots, times: times!, levels: levels! };
}

/** The depth of the deepest contact that the last step resolved [m]; 0 without one. */
function deepest(data: MjData): number {
  if (!data.nefc) return 0;
  const kinds = data.efc_type as Int32Array;
  const distances = data.efc_pos as Float64Array;
  let least = 0;
  for (let row = 0; row < data.nefc; row++) {
    if (kinds[row]! >= CONTACT && distances[row]! < least) least = distances[row]!;
  }
  return -least;
}

/** What is stored of a motion, as poses in a model of its own. */
export class Ghost {
  private last = -1;

  private constructor(
    private readonly engine: Engine,
    readonly model: MjModel,
    readonly data: MjData,
    readonly times: Float64Array,
    private readonly poses: Float32Array,
  ) {}

  static async of(engine: Engine, models: Models, run: Run): Promise<Ghost | null> {
    if (!run.ghost || run.model === undefined) return null;
    const { times, poses } = await unpacked(run.ghost);
    const model = await models.copy(run.model);
    write(model, [run.fields ?? {}]);
    return new Ghost(engine, model, new engine.MjData(model), times as Float64Array, poses as Float32Array);
  }

  get end(): number {
    return this.times[this.times.length - 1] ?? 0;
  }

  /** Pose the model as it was stored nearest to a time [s]; return whether that changed anything. */
  pose(time: number): boolean {
    let place = Math.max(this.last, 0);
    const { times } = this;
    while (place + 1 < times.length && times[place + 1]! <= time) place++;
    while (place > 0 && times[place]! > time) place--;
    if (place === this.last) return false;
    const { nq } = this.model;
    this.data.qpos.set(this.poses.subarray(place * nq, (place + 1) * nq));
    this.engine.mj_kinematics(this.model, this.data);
    this.last = place;
    return true;
  }

  delete(): void {
    this.data.delete();
    this.model.delete();
  }
}
