// The page: chooses a run, plays it, changes it, and holds it against the record.
import { composed, isChanged } from "./changes";
import { DepthGraph } from "./depth_graph";
import { digits, element, find, gauge, length } from "./elements";
import { type Engine, Models, reasonOf } from "./engine";
import { mjcfOf } from "./mjcf";
import { type PageData, type Run, unpacked } from "./page_data";
import { Panel } from "./panel";
import type { View } from "./scene";
import { type Contact, Ghost, Simulation } from "./simulation";
import { Looks } from "./surface";

const FRAME_BUDGET = 12; // ms of a frame that may be spent stepping
const TOLD = 100; // ms between two readings of gauges while it plays
const SLICE = 24; // ms between breaks while a whole run is made
const NO_WEBGL = "This browser draws no 3D (it has no WebGL); numbers, sliders and the comparison with the record work.";

export class Page {
  private run!: Run;
  private readonly panel = new Panel(() => void this.change());
  private readonly graph = new DepthGraph();
  private simulation: Simulation | null = null;
  private ghost: Ghost | null = null;
  private playing = false;
  private last = 0;
  private owed = 0;
  private pace: { wall: number; simulated: number } | null = null;
  private frames = 0;
  private told = 0;
  private making = Promise.resolve();

  private readonly models: Models;
  private readonly looks: Looks;

  constructor(
    private readonly page: PageData,
    private readonly engine: Engine,
    private readonly view: View | null,
  ) {
    this.models = new Models(engine, page.models);
    this.looks = new Looks(page.models, view?.isFast ?? false);
  }

  async start(): Promise<void> {
    const list = find<HTMLSelectElement>("run");
    for (const run of this.page.runs) {
      const axes = run.axes.map(([name, value]) => `${name} ${value}`).join(", ");
      list.append(element("option", { value: run.id }, `${run.id.slice(0, 8)} ${run.label}${axes ? `: ${axes}` : ""}`));
    }
    list.addEventListener("change", () => this.open(list.value, {}));
    find("play").addEventListener("click", () => this.play(!this.playing));
    find("step").addEventListener("click", () => this.stepOnce());
    find("restart").addEventListener("click", () => this.seek(0));
    find("record").addEventListener("click", () => this.compareWithRecord());
    find("link").addEventListener("click", () => this.offer(location.href));
    find("mjcf").addEventListener("click", () => this.offer(this.mjcf()));
    find("ghost").addEventListener("change", () => this.draw());
    const time = find<HTMLInputElement>("time");
    time.addEventListener("input", () => this.seek(Number(time.value)));
    document.addEventListener("keydown", (event) => this.onKey(event));
    addEventListener("hashchange", () => this.fromLink());
    this.view?.onTurn(() => this.view?.draw(true));
    await this.fromLink();
    requestAnimationFrame((now) => this.frame(now));
  }

  // What is simulated.

  private async fromLink(): Promise<void> {
    const values = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
    const wanted = this.page.runs.find((run) => run.id === values.run) ?? this.page.runs[0]!;
    await this.open(wanted.id, values);
  }

  private async open(id: string, values: Record<string, string>): Promise<void> {
    this.run = this.page.runs.find((run) => run.id === id)!;
    find<HTMLSelectElement>("run").value = id;
    const { run } = this;
    find("finding").textContent = run.reasons.join("; ") || run.label;
    find("notes").replaceChildren(...this.notes().map((note) => element("p", {}, note)));
    this.panel.show(run, values);
    this.view?.leave();
    this.ghost?.delete();
    this.ghost = null;
    await this.make();
  }

  private notes(): string[] {
    const { run, page } = this;
    const notes = [...run.notes];
    if (!run.why && this.differs) {
      notes.push(`This page runs MuJoCo ${page.engine}, the record was made with ${run.version}: bits may differ, and the ghost shows by how much.`);
    }
    return notes;
  }

  /** Make the simulation anew with what was changed, and play it if it was played. */
  private async change(): Promise<void> {
    const { playing } = this;
    await this.make();
    if (playing && this.steps) this.play(true);
  }

  /** Make the simulation anew; one after the other, the latest choice last. */
  private make(): Promise<void> {
    this.play(false);
    this.making = this.making.then(() => this.remake());
    return this.making;
  }

  private async remake(): Promise<void> {
    const { run, engine, page } = this;
    this.simulation?.delete();
    this.simulation = null;
    this.verdict("");
    this.say(run.why && `This run is not simulated here: ${run.why}.`);
    this.showFilm(run.film ?? null);
    try {
      if (run.film === undefined) this.ghost ??= await Ghost.of(engine, this.models, run);
      if (run.why) await this.showStoredOnly();
      else {
        const { choice } = this.panel;
        const look = await this.looks.of(composed(run, choice).whole.model);
        this.simulation = await Simulation.of(engine, this.models, page, run, choice);
        this.view?.show(this.simulation.model, this.simulation.look(), look);
      }
    } catch (error) {
      this.say(`MuJoCo ${page.engine} does not read this model: ${reasonOf(engine, error)}`, true);
    }
    const { simulation } = this;
    if (simulation?.lacking.length) this.say(`MuJoCo ${page.engine} lacks ${simulation.lacking.join(", ")}`, true);
    for (const id of ["play", "step", "restart", "speed"]) find<HTMLButtonElement>(id).disabled = this.steps === 0;
    for (const id of ["record", "mjcf"]) find<HTMLButtonElement>(id).disabled = simulation === null;
    const time = find<HTMLInputElement>("time");
    time.max = String(this.steps);
    time.disabled = this.steps === 0;
    this.writeLink();
    this.draw();
  }

  /** Show the stored film in place of the view, or the view again. */
  private showFilm(film: string | null): void {
    document.getElementById("film")?.remove();
    const canvas = find("view").querySelector("canvas");
    if (canvas) canvas.hidden = film !== null;
    if (film) find("view").append(element("img", { id: "film", src: film, alt: "Film of the stored run" }));
  }

  private async showStoredOnly(): Promise<void> {
    if (!this.ghost || !this.view) return;
    this.ghost.pose(0);
    this.view.show(this.ghost.model, this.ghost.data, await this.looks.of(this.run.model!));
  }

  /** Steps of the run; where only the stored one is shown, its poses. */
  private get steps(): number {
    return this.simulation?.steps ?? (this.run.why && this.ghost ? this.ghost.times.length - 1 : 0);
  }

  private storedStep = 0;

  // Time.

  private play(on: boolean): void {
    if (on && this.isOver) this.seek(0);
    this.playing = on && this.steps > 0;
    this.pace = null;
    this.owed = 0;
    find("play").textContent = this.playing ? "❚❚ pause" : "▶ play";
    document.body.dataset.playing = String(this.playing);
    if (!on) this.draw();
  }

  private get isOver(): boolean {
    return this.simulation ? this.simulation.isOver : this.storedStep >= this.steps;
  }

  private stepOnce(): void {
    this.play(false);
    this.seek((this.simulation?.step ?? this.storedStep) + 1);
  }

  /** Have the engine step; where it gives up, say so and stop there. Return whether it went on. */
  private stepping(act: (simulation: Simulation) => void): boolean {
    const { simulation } = this;
    if (!simulation) return false;
    try {
      act(simulation);
      return true;
    } catch (error) {
      this.simulation = null;
      this.play(false);
      this.say(`MuJoCo ${this.page.engine} gives up after step ${simulation.step}: ${reasonOf(this.engine, error)}`, true);
      return false;
    }
  }

  private seek(step: number): void {
    if (this.playing) this.play(false);
    this.stepping((simulation) => simulation.seek(step));
    this.storedStep = Math.min(step, this.steps);
    this.draw();
  }

  private frame(now: number): void {
    requestAnimationFrame((next) => this.frame(next));
    const passed = Math.min(now - this.last, 100) / 1e3;
    this.last = now;
    if (!this.playing) return;
    const speed = Number(find<HTMLSelectElement>("speed").value);
    if (this.simulation) {
      const { simulation } = this;
      this.pace ??= { wall: performance.now(), simulated: simulation.time };
      this.owed += passed * speed;
      if (!this.stepping(() => this.catchUp(simulation))) return;
    } else {
      const { times } = this.ghost!;
      this.owed += passed * speed;
      while (this.storedStep < this.steps && this.owed >= times[this.storedStep + 1]! - times[this.storedStep]!) {
        this.owed -= times[this.storedStep + 1]! - times[this.storedStep]!;
        this.storedStep += 1;
      }
    }
    this.frames += 1;
    document.body.dataset.frames = String(this.frames);
    this.draw();
    if (this.isOver) this.play(false);
  }

  /** Make the steps that are owed, as far as a frame has time. */
  private catchUp(simulation: Simulation): void {
    const began = performance.now();
    while (this.owed >= simulation.timestep && !simulation.isOver) {
      if (performance.now() - began > FRAME_BUDGET) {
        this.owed = 0;
        return;
      }
      simulation.advance();
      this.owed -= simulation.timestep;
    }
  }

  // What is seen.

  private draw(): void {
    const { simulation, ghost, view } = this;
    if (!simulation && !(this.run.why && ghost)) return;
    const time = simulation?.time ?? ghost!.times[this.storedStep]!;
    // A reader reads no faster, and each text costs as much as a frame.
    const now = performance.now();
    const read = !this.playing || now - this.told > TOLD;
    if (read) {
      this.told = now;
      this.showTime(time);
    }
    if (simulation) {
      const data = simulation.look();
      const contacts = simulation.contacts();
      const deepest = most(contacts, (each) => each.depth);
      view?.place(data);
      view?.showContacts(contacts, deepest);
      const shown = find<HTMLInputElement>("ghost").checked && (this.isChanged || this.differs) ? ghost : null;
      view?.showGhost(shown?.model ?? null);
      if (shown) {
        shown.pose(time);
        view?.placeGhost(shown.data);
      }
      if (read) {
        this.showGauges(simulation, contacts, deepest);
        this.graph.draw(simulation.depths, simulation.step);
      }
    } else if (ghost?.pose(time)) view?.place(ghost.data);
    view?.draw(this.playing);
  }

  private showTime(time: number): void {
    const step = this.simulation?.step ?? this.storedStep;
    find<HTMLInputElement>("time").value = String(step);
    find("clock").textContent = `${time.toFixed(3)} s, step ${step}`;
    document.body.dataset.step = String(step);
    const { pace } = this;
    const wall = pace ? (performance.now() - pace.wall) / 1e3 : 0;
    if (pace && wall > 0.25) find("pace").textContent = `${digits((time - pace.simulated) / wall, 2)} x real time`;
  }

  private get isChanged(): boolean {
    return isChanged(this.run, this.panel.choice);
  }

  private get differs(): boolean {
    return this.run.version !== this.page.engine;
  }

  private showGauges(simulation: Simulation, contacts: readonly Contact[], deepest: Contact | undefined): void {
    const pair = (contact: Contact): string => contact.geoms.map((geom) => simulation.geoms[geom] || `geom ${geom}`).join(" – ");
    const strongest = most(contacts, (each) => each.normal);
    const apart = deepest && deepest.depth < 0;
    gauge("depth", deepest ? length(Math.abs(deepest.depth)) + (apart ? " apart" : "") : "none", deepest && pair(deepest));
    gauge("force", strongest ? `${digits(strongest.normal)} N` : "none", strongest && pair(strongest));
    const [potential, kinetic] = simulation.energy;
    gauge("energy", `${digits(potential + kinetic)} J`, `${digits(kinetic)} J kinetic`);
  }

  private say(words: string, bad = false): void {
    const message = find("message");
    message.textContent = this.view || words ? words : NO_WEBGL;
    message.classList.toggle("bad", bad);
    message.hidden = !message.textContent;
  }

  private writeLink(): void {
    history.replaceState(null, "", `#${new URLSearchParams([["run", this.run.id], ...this.panel.values])}`);
  }

  // The record.

  private verdict(words: string, good?: boolean): void {
    const verdict = find("verdict");
    verdict.textContent = words;
    verdict.className = good === undefined ? "" : good ? "good" : "bad";
  }

  private async compareWithRecord(): Promise<void> {
    if (this.isChanged) {
      this.panel.show(this.run, {});
      await this.make();
    }
    await this.finish();
    const { simulation, run } = this;
    if (!simulation) return;
    if (!run.end) return this.verdict("No state of this run is stored to compare with.");
    const stored = await unpacked(run.end);
    const made = simulation.end();
    const gaps = (["qpos", "qvel"] as const).flatMap((name) =>
      Array.from(made[name], (value, place): [number, string] => [gapOf(value, stored[name]![place]!), `${name}[${place}]`]));
    const equal = gaps.every(([gap]) => gap === 0);
    const [gap, where] = gaps.reduce((worst, each) => (each[0] > worst[0] ? each : worst), [0, ""]);
    find("verdict").dataset.difference = String(gap);
    this.verdict(
      equal
        ? `As the record: after ${simulation.step} steps all ${gaps.length} numbers of the state are equal, bit for bit.`
        : `Not as the record: after ${simulation.step} steps ${where} differs the most, by ${digits(gap)}.`,
      equal,
    );
  }

  /** Make all steps that remain, with breaks in which the page stays alive. */
  private async finish(): Promise<void> {
    this.play(false);
    const { simulation } = this;
    while (simulation && simulation === this.simulation && !simulation.isOver) {
      const began = performance.now();
      const went = this.stepping(() => {
        while (!simulation.isOver && performance.now() - began < SLICE) simulation.advance();
      });
      if (!went) return;
      this.draw();
      await new Promise((resume) => { setTimeout(resume); });
    }
    this.draw();
  }

  /** For a console, or a test: make all steps, and return the state after them. */
  async end(): Promise<{ qpos: number[]; qvel: number[] }> {
    await this.making;
    await this.finish();
    const { qpos, qvel } = this.simulation!.end();
    return { qpos: [...qpos], qvel: [...qvel] };
  }

  private mjcf(): string {
    const { simulation, page, run } = this;
    return simulation ? mjcfOf(page, run, this.panel.choice, (field) => simulation.read(field), { name: `run ${run.id} at ${simulation.time} s`, numbers: simulation.keyframe }) : "";
  }

  private offer(text: string): void {
    const area = find<HTMLTextAreaElement>("text");
    area.hidden = false;
    area.value = text;
    area.focus();
    area.select();
    // Where a page from disk may not, the reader copies what is selected.
    navigator.clipboard?.writeText(text).catch(() => undefined);
  }

  private onKey(event: KeyboardEvent): void {
    const target = event.target as HTMLElement;
    if (/^(INPUT|SELECT|TEXTAREA|BUTTON)$/.test(target.tagName) || event.ctrlKey || event.metaKey || event.altKey) return;
    const acts: Record<string, () => void> = {
      " ": () => this.play(!this.playing),
      ArrowRight: () => this.stepOnce(),
      ArrowLeft: () => { this.play(false); this.seek((this.simulation?.step ?? this.storedStep) - 1); },
      Home: () => this.seek(0),
      r: () => void this.compareWithRecord(),
    };
    const act = acts[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }
}

/** How far two numbers are apart: 0 where they have the same bits, infinite where either is none. */
function gapOf(one: number, other: number): number {
  if (Object.is(one, other)) return 0;
  const gap = Math.abs(one - other);
  return Number.isNaN(gap) ? Infinity : Math.max(gap, Number.MIN_VALUE);
}

function most(contacts: readonly Contact[], of: (contact: Contact) => number): Contact | undefined {
  return contacts.reduce<Contact | undefined>((best, each) => (best && of(best) >= of(each) ? best : each), undefined);
}
