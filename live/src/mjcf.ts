// The model with what was changed, as one MJCF document.
import { type Choice, composed } from "./changes";
import type { Fields, PageData, Run } from "./page_data";

const WORDS: Record<string, readonly string[]> = {
  integrator: ["Euler", "RK4", "implicit", "implicitfast"],
  cone: ["pyramidal", "elliptic"],
  jacobian: ["dense", "sparse", "auto"],
  solver: ["PGS", "CG", "Newton"],
};
// Fields of a row for each element, and their attributes.
const ROWS = /^(geom|pair)_(friction|solref|solimp|condim|dim|margin|gap)$/;
const WIDTHS: Record<string, number> = { geom_friction: 3, pair_friction: 5, solref: 2, solimp: 5 };
// What the compiler derives, what only a compiled model has, and the groups that the page shows.
const DERIVED = /^(geom_group$|stat\.|body_(subtreemass|invweight0)|dof_|tendon_invweight0|actuator_acc0)/;

/** Values of each field as the patches leave it, over those of the model as compiled. */
export type Reader = (field: string) => ArrayLike<number> | number | undefined;

interface Keyframe {
  name: string;
  numbers: Record<string, ArrayLike<number>>;
}

/** Return MJCF with a state as its keyframe; a comment names what it cannot say. */
export function mjcfOf(page: PageData, run: Run, choice: Choice, read: Reader, state: Keyframe): string {
  const { whole, patches } = composed(run, choice);
  const model = page.models[whole.model]!;
  const document = new DOMParser().parseFromString(model.mjcf, "text/xml");
  const root = document.documentElement;
  const unsaid = new Set<string>();
  const changed: Fields = Object.assign({}, ...patches);
  for (const field of Object.keys(changed)) {
    const value = read(field);
    if (value === undefined) unsaid.add(field);
    else if (page.flags[field]) setFlags(root, field, Number(value), page.flags[field]);
    else if (field.startsWith("opt.")) setOption(root, field.slice(4), value);
    else if (ROWS.test(field)) {
      const places = patches.flatMap((patch) => patch[field]?.[0] ?? []);
      setRows(root, field, new Set(places), value as ArrayLike<number>, unsaid);
    } else if (!DERIVED.test(field)) unsaid.add(field);
  }
  const key = document.createElement("key");
  key.setAttribute("name", state.name);
  for (const [name, values] of Object.entries(state.numbers)) if (values.length) key.setAttribute(name, listed(values));
  childOf(root, "keyframe").append(key);
  if (unsaid.size) root.prepend(document.createComment(` not said here: ${[...unsaid].join(", ")} `));
  return new XMLSerializer().serializeToString(document);
}

const listed = (values: ArrayLike<number>): string => Array.from(values, String).join(" ");

function childOf(parent: Element, tag: string): Element {
  const found = [...parent.children].find((each) => each.tagName === tag);
  if (found) return found;
  const made = parent.ownerDocument.createElement(tag);
  parent.append(made);
  return made;
}

function setOption(root: Element, name: string, value: ArrayLike<number> | number): void {
  const words = WORDS[name];
  const text = typeof value === "number" ? (words?.[value] ?? String(value)) : listed(value);
  childOf(root, "option").setAttribute(name, text);
}

function setFlags(root: Element, field: string, value: number, bits: Record<string, number>): void {
  const flag = childOf(childOf(root, "option"), "flag");
  const [set, unset] = field.includes("disable") ? ["disable", "enable"] : ["enable", "disable"];
  for (const [name, bit] of Object.entries(bits)) {
    const written = flag.getAttribute(name);
    if (value & bit) flag.setAttribute(name, set);
    else if (written === set) flag.setAttribute(name, unset);
  }
}

function setRows(root: Element, field: string, places: Set<number>, values: ArrayLike<number>, unsaid: Set<string>): void {
  const [, kind, own] = ROWS.exec(field) as unknown as [string, string, string];
  const width = WIDTHS[field] ?? WIDTHS[own] ?? 1;
  const parent = root.querySelector(`:scope > ${kind === "geom" ? "worldbody" : "contact"}`);
  const elements = [...(parent?.querySelectorAll(kind) ?? [])];
  if (elements.length * width !== values.length) {
    unsaid.add(field);
    return;
  }
  // Geoms are numbered body by body, as a document has them where geoms stand before bodies.
  for (const row of new Set([...places].map((place) => Math.floor(place / width)))) {
    const attribute = own === "dim" ? "condim" : own;
    elements[row]!.setAttribute(attribute, listed(Array.from({ length: width }, (_, at) => values[row * width + at]!)));
  }
}
