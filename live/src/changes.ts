// What a reader changes of a run: values of sliders, and switches; and the run with all of it.
import { BITS } from "./engine";
import type { Fields, Run, Stop, Switch, Whole } from "./page_data";

/** Places of the sliders' values, and which switches are on. */
export interface Choice {
  stops: readonly number[];
  on: readonly boolean[];
}

export interface Composed {
  whole: Whole;
  /** Of the model as it was compiled, and of the run's: the later one counts. */
  patches: Fields[];
  /** Of the start. */
  moved: Fields[];
}

export const asStored = (run: Run): Choice => ({
  stops: (run.sliders ?? []).map((slider) => slider.own),
  on: (run.switches ?? []).map(() => false),
});

export function isChanged(run: Run, choice: Choice): boolean {
  return choice.on.includes(true) || (run.sliders ?? []).some((slider, place) => slider.own !== choice.stops[place]);
}

const stopsOf = (run: Run, choice: Choice): Stop[] =>
  (run.sliders ?? []).flatMap((slider, place) => (choice.stops[place] === slider.own ? [] : [slider.stops[choice.stops[place]!]!]));

const switchesOf = (run: Run, choice: Choice): Switch[] => (run.switches ?? []).filter((_, place) => choice.on[place]);

/** Whether the chosen values make another structure, of which the switches do not know the places. */
export const isRebuilt = (run: Run, choice: Choice): boolean => stopsOf(run, choice).some((stop) => stop.model !== undefined);

/** A run with the values that its sliders have, and what is switched. */
export function composed(run: Run, choice: Choice): Composed {
  const changed = stopsOf(run, choice);
  const other = changed.find((stop): stop is Stop & Whole => stop.model !== undefined);
  const whole: Whole = other ?? (run as Whole);
  const rest = changed.filter((stop) => stop !== other && stop.model === undefined);
  const switched = other ? [] : switchesOf(run, choice);
  const inputs = rest.findLast((stop) => stop.inputs !== undefined)?.inputs ?? whole.inputs;
  // The timestep alone decides how many steps there are.
  const steps = [...rest, ...switched].findLast((each) => "opt.timestep" in each.fields)?.steps ?? whole.steps;
  return {
    whole: { ...whole, inputs, steps },
    patches: [whole.fields, ...[...rest, ...switched].map((each) => each.fields)],
    moved: rest.map((stop) => stop.moved ?? {}),
  };
}

/** The switches that are on and set a number that another change sets, too: theirs counts. */
export function contested(run: Run, choice: Choice): string[] {
  const { patches } = composed(run, choice);
  const switches = switchesOf(run, choice);
  const first = patches.length - switches.length;
  return switches.flatMap((each, place) => {
    const before = patches.slice(1, first + place);
    const meets = Object.entries(each.fields).some(([field, [places]]) =>
      !BITS.has(field) && before.some((patch) => patch[field]?.[0].some((at) => places.includes(at))));
    return meets ? [each.name] : [];
  });
}
