// One run: its record, its numbers, its time series, and the commands that show it.

const MOST_LISTED = 200;

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

function listOf(columns, state, rows, open) {
  const extra = state.what === "label" ? [] : [state.what];
  const header = ["run", ...metadata.axes.map((axis) => axis.title), "label", ...extra];
  const lines = rows.slice(0, MOST_LISTED).map((row) => {
    const run = idOf(columns, row);
    return [
      element("button", { class: "plain", "data-run": run, onclick: () => open(row) }, run.slice(0, 8)),
      ...metadata.axes.map((axis) => axisText(columns, axis, row)),
      metadata.labels.legend[columns.label[row]],
      ...extra.map((name) => number(columns[`value:${name}`][row])),
    ];
  });
  const more = rows.length > MOST_LISTED ? element("p", {}, `and ${rows.length - MOST_LISTED} more`) : null;
  return [element("div", { class: "scroll" }, table(header, lines)), more].filter(Boolean);
}

function labelsOf(columns, row) {
  const labels = metadata.details[row]?.labels;
  if (labels) return labels.map(([label, reason, step]) => `${label}: ${reason}${step === null ? "" : ` (step ${step})`}`);
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
    return Number.isFinite(value) ? [[withUnit(name, unit), String(Number(value.toPrecision(metadata.digits))), description]] : [];
  });
}

function commandsOf(columns, row) {
  const run = idOf(columns, row);
  const lines = [`contactlab replay ${metadata.store} ${run}`, `contactlab show ${metadata.store} ${run}`];
  if (metadata.details[row]?.trace) lines.push(`contactlab render ${metadata.store} ${run} -o run.mcap`);
  return element("pre", { class: "code", "aria-label": "Commands" }, lines.join("\n"));
}

function runPanel(columns, row) {
  const run = idOf(columns, row);
  const details = metadata.details[row];
  const code = columns.label[row];
  const labels = labelsOf(columns, row);
  const trace = details?.trace;
  return [
    element("h3", {}, `Run ${run}: ${metadata.labels.legend[code]}`),
    labels.length ? element("ul", {}, ...labels.map((each) => element("li", {}, each))) : null,
    pairsOf(recordOf(columns, row)),
    details?.coverage.length ? table(["exercised", "not at all", "share of range or time"], details.coverage) : null,
    element("div", { id: "timeline", class: "picture", role: "img", "aria-label": `Run ${run} over time` }),
    commandsOf(columns, row),
    trace ? element("p", { class: "caption" }, "Its trace, for Foxglove, PlotJuggler or Rerun: ", element("code", {}, `${metadata.store}/${trace}`)) : null,
    element("h3", {}, "Metrics"),
    pairsOf(numbersOf(columns, row)),
    details ? element("details", {}, element("summary", {}, "All settings"),
      pairsOf(Object.entries(details.settings).map(([name, value]) => [name, setting(value)]))) : null,
  ].filter(Boolean);
}

function timelineSpec(series, row, chosen) {
  const run = series.runs[row];
  const data = { motion: [], force: [], depth: [], modes: [] };
  run.signals.forEach(([name, unit, panel], index) => {
    if (panel === "motion" ? name !== chosen.motion : !name.startsWith(`${chosen.pair} `)) return;
    const times = series.columns[`${row}:t${index}`];
    const values = series.columns[`${row}:v${index}`];
    const short = panel === "motion" ? name : name.slice(chosen.pair.length + 1);
    times.forEach((time, order) => data[panel].push({ time, value: values[order], order, name: withUnit(short, unit) }));
  });
  run.bands.forEach(([pair, end], index) => {
    const starts = series.columns[`${row}:s${index}`];
    const modes = series.columns[`${row}:m${index}`];
    starts.forEach((time, at) => data.modes.push({ time, end: starts[at + 1] ?? end, pair, mode: metadata.modes[modes[at]] }));
  });
  const spec = structuredClone(metadata.specs.timeline);
  const end = Math.max(...run.bands.map((each) => each[1]), ...data.motion.map((each) => each.time), 0);
  spec.vconcat = spec.vconcat.filter((panel) => data[panel.data.name].length);
  for (const panel of spec.vconcat) {
    panel.data.values = data[panel.data.name];
    panel.encoding.x.scale = { domain: [0, end], nice: false };
    panel.width = Math.min(620, document.getElementById("run").clientWidth - 190);
  }
  return spec;
}

async function showTimeline(series, row) {
  const target = document.getElementById("timeline");
  if (!series.runs[row]) {
    const why = metadata.details[row]?.trace === null ? "No trace of this run was kept." : "The page does not hold its time series; see --traces, or the commands below.";
    target.replaceChildren(element("p", { class: "caption" }, why));
    return;
  }
  const { signals, bands } = series.runs[row];
  const motions = signals.filter((each) => each[2] === "motion").map((each) => each[0]);
  const chosen = { motion: motions[0], pair: bands[0]?.[0] ?? "" };
  const box = element("div", {});
  const redraw = () => draw(box, timelineSpec(series, row, chosen));
  const controls = element("div", { class: "controls" },
    motions.length > 1 ? choice("coordinate", motions.map((name) => [name, name]), chosen.motion, (name) => { chosen.motion = name; redraw(); }) : null,
    bands.length > 1 ? choice("contact", bands.map(([name]) => [name, name]), chosen.pair, (name) => { chosen.pair = name; redraw(); }) : null);
  target.replaceChildren(controls, box);
  await redraw();
}
