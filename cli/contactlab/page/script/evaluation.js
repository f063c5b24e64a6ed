// Accuracy against time, evaluated under other tolerances by the rules of `contactlab tradeoff`.

const limitsOf = (state) => ({ ...metadata.tradeoff.tolerances, ...state.limits });

// Single precision is compared with the limit in single precision.
function meets(columns, name, place, limit) {
  const worst = columns[`worst:${name}`];
  const bound = worst instanceof Float32Array ? Math.fround(limit) : limit;
  return worst[place] <= bound;
}

function marginOf(columns, name, place, limit) {
  const worst = columns[`worst:${name}`][place];
  const ratio = worst ? limit / worst : Infinity;
  return Number.isFinite(ratio) ? ratio : null;
}

function evaluate(columns, limits, rules = metadata.tradeoff) {
  const entries = Object.entries(limits);
  const places = Array.from(columns.otherwiseFeasible.keys());
  const feasible = places.map((place) =>
    columns.otherwiseFeasible[place] === 1 && entries.every(([name, limit]) => meets(columns, name, place, limit)));
  const leastMargin = (place) => Math.min(Infinity, ...entries.map(([name, limit]) => marginOf(columns, name, place, limit) ?? Infinity));
  const candidates = places.filter((place) => feasible[place]);
  const recommendable = new Set(rules.recommendable ?? places);
  const possible = candidates.filter((place) => recommendable.has(place));
  return {
    feasible,
    recommended: bestOfCheapest(columns, possible, rules),
    robust: bestOfCheapest(columns, possible.filter((place) => leastMargin(place) >= rules.safeMargin), rules),
    front: paretoFront(columns, candidates),
  };
}

// The most accurate of those whose time is within a factor of the least; of equals the first. With the
// model as written, which is the first of all, that which changes least of it and is as accurate.
function bestOfCheapest(columns, candidates, { equallyFast, equallyAccurate, baseline, configurations }) {
  if (!candidates.length) return null;
  const limit = equallyFast * candidates.reduce((least, place) => Math.min(least, columns.time[place]), Infinity);
  const error = (place) => (Number.isNaN(columns.error[place]) ? Infinity : columns.error[place]);
  const fast = candidates.filter((place) => columns.time[place] <= limit);
  const best = fast.reduce((best, place) => (error(place) < error(best) ? place : best));
  if (!baseline) return best;
  const changes = (place) => configurations[place].filter((value, knob) => value !== configurations[0][knob]).length;
  const rank = (place) => [changes(place), error(place)];
  return fast.filter((place) => error(place) <= equallyAccurate * error(best)).sort((a, b) => {
    const [one, other] = [rank(a), rank(b)];
    return one[0] - other[0] || (one[1] === other[1] ? 0 : one[1] - other[1]);
  })[0];
}

// The candidates that no other dominates, the cheapest first; equal ones do not dominate each other.
function paretoFront({ time, error }, candidates) {
  const known = candidates.filter((place) => Number.isFinite(time[place]) && Number.isFinite(error[place]));
  known.sort((a, b) => time[a] - time[b] || error[a] - error[b]);
  const front = [];
  for (const place of known) {
    const last = front.at(-1);
    if (last === undefined || error[place] < error[last] || (error[place] === error[last] && time[place] === time[last])) front.push(place);
  }
  return front;
}

function rowsNamed(spec, name) {
  return spec.layer.find((layer) => layer.data.name === name)?.data.values ?? [];
}

// The chart with new states, front and rings; names and colours of methods stay.
function chartSpec(columns, evaluated, limits) {
  const spec = structuredClone(metadata.specs.tradeoff);
  const points = [...rowsNamed(spec, "points"), ...rowsNamed(spec, "beside"), ...rowsNamed(spec, "failures"), ...rowsNamed(spec, "lines")];
  const shown = new Set(points.map((row) => row.place));
  const sides = spec.layer.find((layer) => layer.encoding.y?.axis).encoding;
  const floor = sides.y.scale.domain[0];
  const values = {
    front: evaluated.front.filter((place) => shown.has(place)).map((place) => ({
      time: columns.time[place], error: Math.max(columns.error[place], floor),
    })),
    chosen: ringRows(points, evaluated, sides.x.scale.domain),
  };
  const limit = limits[metadata.tradeoff.error[0]];
  if (limit) {
    values.band = [{ low: limit, high: sides.y.scale.domain[1] }];
    values.tolerance = [{ low: limit, text: "tolerance", time: sides.x.scale.domain[1] }];
  }
  const fit = evaluated.feasible.filter(Boolean).length;
  spec.title.subtitle[0] = spec.title.subtitle[0].replace(/^\d+/, fit);
  for (const layer of spec.layer) {
    const { name } = layer.data;
    if (name.startsWith("labels")) layer.data.values = labelRows(layer.data.values, points, values.chosen);
    if (name in values) layer.data.values = values[name];
    for (const row of layer.data.values) {
      if (row.state && row.state !== "failed") row.state = evaluated.feasible[row.place] ? "within tolerance" : "beyond tolerance";
    }
  }
  return spec;
}

// A point with a ring is labelled beside the ring; one that lost its ring gets its label back.
function labelRows(rows, points, rings) {
  const before = rowsNamed(metadata.specs.tradeoff, "chosen").map((row) => row.place);
  const apart = new Set(rings.map((row) => row.place));
  const back = points.filter((row, index) =>
    before.includes(row.place) && points.findIndex((each) => each.place === row.place) === index)
    .map((row) => ({ ...row, align: "left", dx: 8, dy: -9 }));
  return [...rows, ...back].filter((row) => !apart.has(row.place));
}

function ringRows(points, evaluated, [least, most]) {
  const rings = [["recommended", evaluated.recommended], [`margins >= ${metadata.tradeoff.safeMargin}`, evaluated.robust]];
  const found = rings.filter(([, place], index) => place !== null && (index === 0 || place !== evaluated.recommended));
  const rows = found.flatMap(([name, place]) => {
    const row = points.find((each) => each.place === place);
    return row ? [{ ...row, chosen: `${name} ${row.label}`.trim() }] : [];
  });
  const now = rowsNamed(metadata.specs.tradeoff, "chosen").find((row) => row.chosen.startsWith("now"));
  if (now && !rows.some((row) => row.place === now.place)) rows.push({ ...now, chosen: `now ${now.label}`.trim() });
  const lower = Math.min(...rows.map((row) => row.error));
  const written = rowsNamed(metadata.specs.tradeoff, "chosen");
  return rows.map((row) => {
    // As the report placed it, where it covers fewest points.
    const same = written.find((each) => each.place === row.place && each.chosen === row.chosen);
    if (same) return same;
    const right = row.time > Math.sqrt(least * most);
    return { ...row, align: right ? "right" : "left", dx: right ? -10 : 10, dy: row.error === lower ? 18 : -16 };
  });
}

const setting = (value) => (value === null ? "as in the scene" : Array.isArray(value) ? value.join(" ") : String(value));

// Below 1 s or 1 m in ms or mm, as the recommendation of the report.
function settingWithUnit(value, unit) {
  if (typeof value !== "number" || !unit || unit === "1") return setting(value);
  const small = { s: "ms", m: "mm" }[unit];
  return small && Math.abs(value) < 1 ? `${Number((1e3 * value).toPrecision(6))} ${small}` : `${value} ${unit}`;
}

function configurationOf(place) {
  const { knobs, units, configurations } = metadata.tradeoff;
  return knobs.map((knob, index) => [knob, settingWithUnit(configurations[place][index], units[knob])]);
}

function recommendationOf(columns, evaluated, limits) {
  if (evaluated.recommended === null) {
    const blockers = Object.entries(limits).map(([name, limit]) => {
      const out = Array.from(columns.otherwiseFeasible, (_, place) => !meets(columns, name, place, limit)).filter(Boolean).length;
      return element("li", {}, `tolerance ${name} rules out ${out} of ${columns.otherwiseFeasible.length} configurations`);
    });
    return [element("p", {}, element("strong", {}, evaluated.front.length ? "No configuration of mujoco is feasible." : "No configuration is feasible.")), element("ul", {}, ...blockers)];
  }
  const place = evaluated.recommended;
  const values = configurationOf(place).map(([name, value]) =>
    element("div", {}, element("dt", {}, name), element("dd", {}, value)));
  const [, unit] = metadata.tradeoff.error;
  const time = columns.time[place];
  const parts = [
    `Error ${amount(columns.error[place], unit)}, ${number(time)} CPU s per simulated s`,
    ` (${number(1 / time)} x real time). `,
    robustText(columns, evaluated),
    metadata.tradeoff.clamped.includes(place) ? " At this timestep refsafe makes its contacts softer than its solref says." : "",
  ];
  return [
    element("dl", { class: "settings" }, ...values),
    element("p", {}, parts.join("")),
  ];
}

function robustText(columns, evaluated) {
  const least = `at least ${metadata.tradeoff.safeMargin}`;
  if (evaluated.robust === null) return `No configuration has all margins ${least}.`;
  if (evaluated.robust === evaluated.recommended) return `Every tolerance is ${least} times the worst value.`;
  const ratio = columns.time[evaluated.robust] / columns.time[evaluated.recommended];
  const values = configurationOf(evaluated.robust).map((pair) => pair.join(" ")).join(", ");
  return `All margins ${least} cost x${number(ratio)} time: ${values}.`;
}
