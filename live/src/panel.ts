// The panel of what can be changed: a slider for each axis, a switch for each row of a budget.
import { type Choice, asStored, contested, isRebuilt } from "./changes";
import { element, find } from "./elements";
import type { Run, Slider, Switch } from "./page_data";

const ON = "on";

export class Panel {
  choice: Choice = { stops: [], on: [] };
  private run: Run | null = null;

  /** `changed` is called when the reader has changed something. */
  constructor(private readonly changed: () => void) {}

  /** Show a run's sliders and switches, with the values that a link gives by their names. */
  show(run: Run, values: Readonly<Record<string, string>>): void {
    this.run = run;
    const stored = asStored(run);
    this.choice = {
      stops: (run.sliders ?? []).map((slider, place) => {
        const wanted = slider.stops.findIndex((stop) => stop.text === values[slider.name]);
        return wanted < 0 ? stored.stops[place]! : wanted;
      }),
      on: (run.switches ?? []).map((each) => values[each.name] === ON),
    };
    find("sliders").replaceChildren(...(run.sliders ?? []).map((slider, place) => this.slider(slider, place)));
    const switches = run.switches ?? [];
    find("switches").replaceChildren(...switches.flatMap((each, place) => [
      ...(each.kind === switches[place - 1]?.kind ? [] : [element("h2", {}, each.kind)]),
      this.switch(each, place),
    ]));
    this.tell();
  }

  /** What is changed, by name, as a link has it. */
  get values(): [string, string][] {
    const { run, choice } = this;
    return [
      ...(run?.sliders ?? []).flatMap((slider, place): [string, string][] =>
        choice.stops[place] === slider.own ? [] : [[slider.name, slider.stops[choice.stops[place]!]!.text]]),
      ...(run?.switches ?? []).flatMap((each, place): [string, string][] => (choice.on[place] ? [[each.name, ON]] : [])),
    ];
  }

  private slider(slider: Slider, place: number): HTMLElement {
    const title = ["", "1"].includes(slider.unit) ? slider.name : `${slider.name} [${slider.unit}]`;
    const output = element("output", {}, slider.stops[this.choice.stops[place]!]!.text);
    const range = element("input", {
      type: "range", min: "0", max: String(slider.stops.length - 1), value: String(this.choice.stops[place]),
      "aria-label": title, "aria-valuetext": output.textContent ?? "", "data-axis": slider.name,
    }) as HTMLInputElement;
    const row = element("label", { class: "slider" }, element("span", {}, title), output, range);
    const mark = (): void => { row.classList.toggle("changed", this.choice.stops[place] !== slider.own); };
    range.addEventListener("input", () => {
      this.choice = { ...this.choice, stops: this.choice.stops.with(place, Number(range.value)) };
      const { text } = slider.stops[this.choice.stops[place]!]!;
      output.textContent = text;
      range.setAttribute("aria-valuetext", text);
      mark();
    });
    range.addEventListener("change", () => this.change());
    mark();
    return row;
  }

  private switch(each: Switch, place: number): HTMLElement {
    const box = element("input", { type: "checkbox", "data-switch": each.name }) as HTMLInputElement;
    box.checked = this.choice.on[place]!;
    box.addEventListener("change", () => {
      this.choice = { ...this.choice, on: this.choice.on.with(place, box.checked) };
      this.change();
    });
    return element("label", { class: "switch" }, box, element("span", {}, each.name, element("small", {}, each.summary)), element("span", { class: "told" }, each.told));
  }

  private change(): void {
    this.tell();
    this.changed();
  }

  private tell(): void {
    const { run, choice } = this;
    if (!run) return;
    const rebuilt = isRebuilt(run, choice);
    for (const box of find("switches").querySelectorAll("input")) box.disabled = rebuilt;
    const won = contested(run, choice);
    const words = rebuilt ? "Switches are of the run's own structure." : won.length ? `Where sliders or switches set the same number, this one counts: ${won.join(", ")}.` : "";
    find("contested").textContent = run.switches?.length ? words : "";
  }
}
