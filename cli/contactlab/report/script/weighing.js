// Accuracy against time, weighed again as `contactlab tradeoff` does it.

const EQUALLY_FAST = 1.05;
const SAFE = 1.25;

function limitsOf(state) {
  const given = { ...words.tradeoff.tolerances, ...state.limits };
  return Object.fromEntries(Object.entries(given).filter(([name]) => name in words.tradeoff.tolerances || name in state.limits));
}

// The largest size of a metric; single precision is compared as such.
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

function weigh(columns, limits) {
  const entries = Object.entries(limits);
  const feasible = Array.from(columns.sound, (sound, place) =>
    sound === 1 && entries.every(([name, limit]) => meets(columns, name, place, limit)));
  const shortest = (place) => Math.min(Infinity, ...entries.map(([name, limit]) => marginOf(columns, name, place, limit) ?? Infinity));
  return {
    feasible,
    chosen: equallyFast(columns, feasible.map((fit, place) => (fit ? place : -1)).filter((place) => place >= 0)),
    robust: equallyFast(columns, feasible.map((fit, place) => (fit && shortest(place) >= SAFE ? place : -1)).filter((place) => place >= 0)),
    front: frontOf(columns, feasible),
  };
}

// Of those that time cannot tell from the cheapest, the most accurate; of these the first.
function equallyFast(columns, fit) {
  if (!fit.length) return null;
  const limit = EQUALLY_FAST * fit.reduce((least, place) => Math.min(least, columns.time[place]), Infinity);
  const error = (place) => (Number.isNaN(columns.error[place]) ? Infinity : columns.error[place]);
  return fit.filter((place) => columns.time[place] <= limit).reduce((best, place) => (error(place) < error(best) ? place : best));
}

function frontOf(columns, feasible) {
  const known = feasible.flatMap((fit, place) => (fit && !Number.isNaN(columns.time[place] + columns.error[place]) ? [place] : []));
  known.sort((a, b) => columns.time[a] - columns.time[b] || columns.error[a] - columns.error[b]);
  let least = Infinity;
  return known.filter((place) => {
    if (columns.error[place] >= least) return false;
    least = columns.error[place];
    return true;
  });
}

function rowsNamed(spec, name) {
  return spec.layer.find((layer) => layer.data.name === name)?.data.values ?? [];
}

// The chart with other states, front and rings; names and colours of methods stay.
function chartSpec(columns, weighed, limits) {
  const spec = structuredClone(words.specs.tradeoff);
  const points = [...rowsNamed(spec, "points"), ...rowsNamed(spec, "failures"), ...rowsNamed(spec, "lines")];
  const shown = new Set(points.map((row) => row.place));
  const sides = spec.layer.find((layer) => layer.encoding.y?.axis).encoding;
  const floor = sides.y.scale.domain[0];
  const values = {
    front: weighed.front.filter((place) => shown.has(place)).map((place) => ({
      time: columns.time[place], error: Math.max(columns.error[place], floor),
    })),
    chosen: ringRows(points, weighed, sides.x.scale.domain),
  };
  const limit = limits[words.tradeoff.error[0]];
  if (limit) {
    values.band = [{ low: limit, high: sides.y.scale.domain[1] }];
    values.tolerance = [{ low: limit, text: "tolerance", time: sides.x.scale.domain[1] }];
  }
  const fit = weighed.feasible.filter(Boolean).length;
  spec.title.subtitle[0] = spec.title.subtitle[0].replace(/^\d+/, fit);
  for (const layer of spec.layer) {
    const { name } = layer.data;
    if (name.startsWith("labels")) layer.data.values = labelRows(layer.data.values, points, values.chosen, name);
    if (name in values) layer.data.values = values[name];
    for (const row of layer.data.values) {
      if (row.state && row.state !== "failed") row.state = weighed.feasible[row.place] ? "within tolerance" : "beyond tolerance";
    }
  }
  return spec;
}

// What has a ring is told beside it; what had one gets its label back.
function labelRows(rows, points, rings, name) {
  const before = rowsNamed(words.specs.tradeoff, "chosen").map((row) => row.place);
  const apart = new Set(rings.map((row) => row.place));
  const back = name.endsWith("right") ? points.filter((row, index) =>
    before.includes(row.place) && points.findIndex((each) => each.place === row.place) === index) : [];
  return [...rows, ...back].filter((row) => !apart.has(row.place));
}

function ringRows(points, weighed, [least, most]) {
  const rings = [["recommended", weighed.chosen], ["margin 1.25", weighed.robust]];
  const found = rings.filter(([, place], index) => place !== null && (index === 0 || place !== weighed.chosen));
  const rows = found.flatMap(([name, place]) => {
    const row = points.find((each) => each.place === place);
    return row ? [{ ...row, chosen: `${name} ${row.label}`.trim() }] : [];
  });
  const lower = Math.min(...rows.map((row) => row.error));
  return rows.map((row) => {
    const right = row.time > Math.sqrt(least * most);
    return { ...row, align: right ? "right" : "left", dx: right ? -10 : 10, dy: row.error === lower ? 18 : -16 };
  });
}

const setting = (value) => (value === null ? "the scene's own" : Array.isArray(value) ? value.join(" ") : String(value));

function configuration(place) {
  return words.tradeoff.knobs.map((knob, index) => [knob, setting(words.tradeoff.configurations[place][index])]);
}

function adviceOf(columns, weighed, limits) {
  if (weighed.chosen === null) {
    const blocked = Object.entries(limits).map(([name, limit]) => {
      const out = Array.from(columns.sound, (_, place) => !meets(columns, name, place, limit)).filter(Boolean).length;
      return element("li", {}, `tolerance ${name} keeps out ${out} of ${columns.sound.length} configurations`);
    });
    return [element("p", {}, element("strong", {}, "No configuration is feasible.")), element("ul", {}, ...blocked)];
  }
  const place = weighed.chosen;
  const values = configuration(place).map(([name, value]) =>
    element("div", {}, element("dt", {}, axisOf(name)?.title ?? name), element("dd", {}, value)));
  const [, unit] = words.tradeoff.error;
  const time = columns.time[place];
  const parts = [
    `Error ${number(columns.error[place])}${["", "1", "any"].includes(unit) ? "" : ` ${unit}`}, ${number(time)} CPU s per simulated s`,
    ` (${number(1 / time)} x real time). `,
    robustWords(columns, weighed),
  ];
  const lines = words.tradeoff.mjcf?.[place];
  return [
    element("dl", { class: "settings" }, ...values),
    element("p", {}, parts.join("")),
    lines ? element("pre", { class: "code", "aria-label": "Lines for the model" }, lines) : null,
  ].filter(Boolean);
}

function robustWords(columns, weighed) {
  if (weighed.robust === null) return "No configuration keeps a margin of 1.25 to every tolerance.";
  if (weighed.robust === weighed.chosen) return "It keeps a margin of 1.25 to every tolerance.";
  const ratio = columns.time[weighed.robust] / columns.time[weighed.chosen];
  const values = configuration(weighed.robust).map(([name, value]) => `${name} ${value}`).join(", ");
  return `A margin of 1.25 to every tolerance costs ${number(ratio)} x the time: ${values}.`;
}
