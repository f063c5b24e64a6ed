// One run: its record, its numbers, its time series, and the commands that show it.

// As in report_columns.py.
const SCENES_OWN = "as in the scene";
const MOST_LISTED = 60;

function idOf(columns, row) {
  const half = (at) => columns.id[at].toString(16).padStart(8, "0");
  return half(2 * row) + half(2 * row + 1);
}

function rowOf(columns, run) {
  for (let row = 0; row < metadata.runs; row++) if (idOf(columns, row).startsWith(run)) return row;
  return -1;
}

function axisText(columns, axis, row) {
  return axis.binned ? number(columns[`number:${axis.name}`][row]) : axis.ticks[columns[`axis:${axis.name}`][row]];
}

// The letter of a label on its colour.
function swatch(code) {
  return svg("svg", { class: "swatch", width: 20, height: 17, "aria-hidden": "true" },
    svg("rect", { width: 20, height: 17, rx: 3, fill: metadata.labels.colours[code] }),
    word(10, 13, metadata.labels.letters[code], { "text-anchor": "middle", class: "letter" }));
}

// Runs as lines of a list: label and id, then what distinguishes them.
function listOf(columns, state, rows, open, most = MOST_LISTED) {
  const extra = state.what === "label" ? [] : [state.what];
  const items = rows.slice(0, most).map((row) => {
    const run = idOf(columns, row);
    const told = metadata.axes.filter((axis) => axisText(columns, axis, row) !== SCENES_OWN);
    const settings = told.map((axis) => `${axis.name} ${axisText(columns, axis, row)}${axis.amount ? ` ${axis.amount}` : ""}`);
    const values = extra.map((name) => `${name} ${amount(columns[`value:${name}`][row], quantityOf(name)?.[1] ?? "")}`);
    return element("li", {},
      element("button", { class: "plain", "data-run": run, onclick: () => open(row) }, run.slice(0, 8)),
      " ", element("span", { class: "nowrap" }, swatch(columns.label[row]), ` ${metadata.labels.names[columns.label[row]]}`),
      element("span", { class: "caption" }, ` ${[...values, ...settings].join(" · ")}`));
  });
  const more = rows.length > most ? element("p", { class: "caption" }, `and ${rows.length - most} more`) : null;
  return [element("ul", { class: "list" }, ...items), more].filter(Boolean);
}

function labelsOf(columns, row) {
  const labels = metadata.details[row]?.labels;
  if (labels) return labels.map(([label, reason, step]) => label === "stable" ? label : `${label}: ${reason}${step === null ? "" : ` (step ${step})`}`);
  return metadata.labels.every.filter((_, bit) => (bit < 32 ? columns.labels[row] >>> bit : columns["labels:high"][row] >>> (bit - 32)) & 1);
}

function recordOf(columns, row) {
  const details = metadata.details[row];
  const outcome = ["no expectation", "not as expected", "as expected"][columns.expected[row]];
  const axes = metadata.axes.map((axis) => [axis.title, axisText(columns, axis, row)]);
  if (!details) return [...axes, ["outcome", outcome]];
  return [
    ...axes, ["outcome", details.expectation_reason ? `${outcome}: ${details.expectation_reason}` : outcome],
    ["engine", details.engine], ["status", `${details.status}, ${details.steps} steps`],
  ];
}

function numbersOf(columns, row) {
  return metadata.quantities.flatMap(([name, unit, , , description]) => {
    const value = columns[`value:${name}`][row];
    return Number.isFinite(value) ? [[name, amount(value, unit), description]] : [];
  });
}

function commandsOf(columns, row) {
  const run = idOf(columns, row);
  const lines = [`contactlab verify ${metadata.store} ${run}`, `contactlab show ${metadata.store} ${run}`];
  if (metadata.details[row]?.trace) lines.push(`contactlab render ${metadata.store} ${run} -o run.mcap`);
  return element("pre", { class: "code", "aria-label": "Commands" }, lines.join("\n"));
}

// Metrics that limits of the run's labels read, or that exceed a tolerance, come first.
function metricLists(columns, row) {
  const breaching = new Set(metadata.details[row]?.breaching ?? []);
  for (const [name, limit] of Object.entries(metadata.tradeoff?.tolerances ?? {})) {
    if (columns[`value:${name}`]?.[row] > limit) breaching.add(name);
  }
  const all = numbersOf(columns, row);
  const isFirst = ([name]) => breaching.has(name);
  return [all.filter(isFirst), all];
}

// Whether a run is clearly better in what the labels of another are about: by a tenth. Runs on both
// sides of a limit are alike.
function isBetter(columns, row, other) {
  const names = (metadata.details[row]?.breaching ?? []).filter((name) => columns[`value:${name}`]);
  const pairs = names.map((name) => [columns[`value:${name}`][row], columns[`value:${name}`][other]]);
  const known = pairs.filter(([here, there]) => Number.isFinite(here) && Number.isFinite(there));
  return !known.length || known.some(([here, there]) => Math.abs(here - there) > 0.1 * Math.abs(here));
}

// How far two values of an axis lie apart: by their ratio, or as a share of the range of the axis.
function axisDistance(columns, axis, row, other) {
  const codes = axisCodes(columns, axis.name);
  if (codes[row] === codes[other]) return 0;
  const [here, there] = [Number(axis.ticks[codes[row]]), Number(axis.ticks[codes[other]])];
  if (here > 0 && there > 0) return Math.abs(Math.log(there / here));
  const numbers = axis.ticks.map(Number);
  return numbers.every(Number.isFinite) ? Math.abs(here - there) / (Math.max(...numbers) - Math.min(...numbers)) : 1;
}

// The stable run under the same conditions that is clearly better and differs in fewest settings, of
// equals by the nearest values, and what it has instead.
function nearestStable(columns, row) {
  const stable = metadata.labels.names.indexOf("stable");
  if (metadata.aggregated || !metadata.axes.some((axis) => axis.role !== "scenario") || columns.label[row] === stable) return null;
  const codes = metadata.axes.map((axis) => axisCodes(columns, axis.name));
  let [best, least, alike] = [null, [Infinity, Infinity], false];
  for (let other = 0; other < metadata.runs; other++) {
    if (columns.label[other] !== stable) continue;
    if (metadata.axes.some((axis, at) => axis.role === "scenario" && codes[at][other] !== codes[at][row])) continue;
    if (!isBetter(columns, row, other)) { alike = true; continue; }
    const changed = metadata.axes.filter((_, at) => codes[at][other] !== codes[at][row]);
    if (changed.length > least[0]) continue;
    const distance = changed.reduce((sum, axis) => sum + axisDistance(columns, axis, row, other), 0);
    if (changed.length < least[0] || distance < least[1]) [best, least] = [other, [changed.length, distance]];
  }
  if (best === null) return { row: null, alike };
  const changes = metadata.axes.filter((_, at) => codes[at][best] !== codes[at][row]);
  return { row: best, changes: changes.map((axis) => `${axis.name} ${axisText(columns, axis, row)} → ${axisText(columns, axis, best)} ${axis.amount}`.trim()) };
}

function changePart(columns, row, open) {
  const nearest = nearestStable(columns, row);
  if (!nearest) return null;
  if (nearest.row === null) {
    const why = nearest.alike ? "the stable runs under the same conditions are hardly better: the limit lies between like runs; "
      : "nothing in this sweep is stable under the same conditions; ";
    return element("p", { class: "change" }, element("strong", {}, "What to change: "), why,
      element("code", {}, "contactlab tune"), " looks for settings that are.");
  }
  return element("p", { class: "change" }, element("strong", {}, "What to change: "), `the nearest stable run has ${nearest.changes.join(", ")}. `,
    element("button", { class: "plain", onclick: () => open(nearest.row) }, `Open ${idOf(columns, nearest.row).slice(0, 8)}`));
}

// What a run is, which stands beside the map, and what it did, below.
function runPanel(columns, row, open) {
  const run = idOf(columns, row);
  const details = metadata.details[row];
  const code = columns.label[row];
  const labels = labelsOf(columns, row).filter((each) => each !== "stable"); // the head says so
  const trace = details?.trace;
  const [first, all] = metricLists(columns, row);
  // In a wide window all metrics have room next to the plots.
  const metricsOpen = window.innerWidth > 1000 || !first.length;
  const head = [
    element("h3", {}, swatch(code), ` ${metadata.labels.names[code]}: run `, element("span", { class: "id" }, run)),
    labels.length ? element("ul", { class: "reasons" }, ...labels.map((each) => element("li", {}, each))) : null,
    changePart(columns, row, open),
    pairsOf(recordOf(columns, row)),
    first.length ? element("h4", {}, "Metrics that its labels are about") : null,
    first.length ? pairsOf(first) : null,
  ];
  const numbers = [
    element("h3", {}, "Its numbers"),
    details?.coverage.length ? element("details", {}, element("summary", {}, "Exercised parts"),
      element("div", { class: "scroll" }, table(["exercised", "not at all", "share of range or time"], details.coverage))) : null,
    element("details", { open: metricsOpen }, element("summary", {}, `All ${all.length} metrics`), element("div", { id: "metrics" }, pairsOf(all))),
    details ? element("details", {}, element("summary", {}, "All settings"),
      pairsOf(Object.entries(details.settings).map(([name, value]) => [name, setting(value)]))) : null,
    commandsOf(columns, row),
    trace ? element("p", { class: "caption" }, "Its trace, for Foxglove, PlotJuggler or Rerun: ", element("code", {}, `${metadata.store}/${trace}`)) : null,
  ];
  const plots = [element("h3", {}, "Run ", element("span", { class: "id" }, run.slice(0, 8)), " over time"), element("div", { id: "timeline", class: "picture", role: "group", "aria-label": `Run ${run} over time` })];
  return {
    head: head.filter(Boolean),
    more: [element("div", {}, ...plots), element("div", {}, ...numbers)],
  };
}
