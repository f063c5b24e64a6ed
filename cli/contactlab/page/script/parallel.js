// Parallel coordinates: the axes of the sweep and a few metrics, a line for each run.

const MOST_LINES = 600;

function parallelAxes(page) {
  const { columns } = page;
  const axes = metadata.axes.map((axis) => {
    const codes = axisCodes(columns, axis.name);
    const last = Math.max(1, axis.ticks.length - 1);
    return { title: axis.title, at: (row) => codes[row] / last, ends: axis.ticks };
  });
  const knownOf = (name) => Array.from(columns[`value:${name}`]).filter((each) => Number.isFinite(each));
  const varying = metadata.listed.filter((name) => new Set(knownOf(name)).size > 1);
  const metrics = varying.slice(0, 4).map((name) => {
    const values = columns[`value:${name}`];
    const known = knownOf(name);
    const positive = known.filter((each) => each > 0).sort((a, b) => a - b);
    const logarithmic = positive.length === known.length && positive.at(-1) > 30 * positive[0];
    const [low, high] = extent(logarithmic ? known.map(Math.log10) : known);
    const place = linear([low, high], [0, 1]);
    const ends = [low, high].map((each) => amount(logarithmic ? 10 ** each : each, quantityOf(name)[1]));
    return { title: name, at: (row) => place(logarithmic ? Math.log10(values[row]) : values[row]), ends };
  });
  return [...axes, ...metrics];
}

// What is chosen along axes: by place, a part of it between 0 and 1.
function isChosen(page, axes, row) {
  return [...page.brushes].every(([place, [low, high]]) => axes[place].at(row) >= low && axes[place].at(row) <= high);
}

// An axis to drag along; a click chooses all of it again.
function brush(page, place, x, { top, height, at }) {
  const chosen = page.brushes.get(place);
  const mark = ([low, high]) => ({ y: top + height * (0.97 - 0.94 * high), height: height * 0.94 * (high - low) });
  const shade = svg("rect", { class: "brush", x: x - 6, width: 12, ...mark(chosen ?? [0, 0]) });
  const area = svg("rect", { class: "axis", x: x - 14, y: top, width: 28, height });
  let start = null;
  const between = (event) => [start, at(event)].sort((a, b) => a - b);
  area.addEventListener("pointerdown", (event) => { start = at(event); area.setPointerCapture(event.pointerId); });
  area.addEventListener("pointermove", (event) => {
    if (start !== null) for (const [key, value] of Object.entries(mark(between(event)))) shade.setAttribute(key, value);
  });
  area.addEventListener("pointerup", (event) => {
    const part = between(event);
    start = null;
    if (part[1] - part[0] < 0.01) page.brushes.delete(place);
    else page.brushes.set(place, part);
    showParallel(page);
  });
  return [shade, area];
}

function showParallel(page) {
  page.brushes ??= new Map();
  const target = find("parallel-picture");
  const axes = parallelAxes(page);
  const all = selectedRows(page.columns, page.state, null, true);
  const rows = all.filter((row) => isChosen(page, axes, row));
  const every = Math.max(1, Math.ceil(rows.length / MOST_LINES));
  const drawn = rows.filter((_, at) => at % every === 0);
  const step = Math.max(92, Math.min(190, (target.clientWidth - 130) / Math.max(1, axes.length - 1)));
  const [left, top, height] = [60, 44, 300];
  const width = left + step * (axes.length - 1) + 90;
  const spread = (row) => ((row * 0.618034) % 1) * 0.05 - 0.025;
  const y = (at, row) => top + height * (1 - (at * 0.94 + 0.03 + spread(row)));
  const paths = metadata.labels.names.map(() => []);
  for (const row of drawn) {
    const points = axes.map((axis, place) => [left + place * step, axis.at(row)]).filter(([, at]) => Number.isFinite(at));
    paths[page.columns.label[row]].push(points.map(([x, at], place) => `${place ? "L" : "M"}${x.toFixed(1)},${y(at, row).toFixed(1)}`).join(""));
  }
  // Stable runs lie below the others.
  const lines = metadata.labels.colours.map((colour, code) => svg("path", { d: paths[code].join(""), fill: "none", stroke: metadata.labels.names[code] === "stable" ? "var(--edge)" : colour, "stroke-width": 1.2, "stroke-opacity": 0.55 })).reverse();
  const rules = axes.flatMap((axis, place) => {
    const x = left + place * step;
    const ticks = axis.ends.length > 12 ? [[axis.ends[0], 0], [axis.ends.at(-1), 1]] : axis.ends.map((text, at) => [text, axis.ends.length > 1 ? at / (axis.ends.length - 1) : 0.5]);
    return [
      svg("line", { class: "rule", x1: x, x2: x, y1: top, y2: top + height }),
      word(x, place % 2 ? top - 10 : top - 26, axis.title, { class: "title", "text-anchor": "middle" }),
      ...ticks.map(([text, at]) => word(x + 5, y(at, 0) + y(at, 0) * 0 + 4, String(text).length > 14 ? `${String(text).slice(0, 13)}…` : text, { class: "haloed" })),
    ];
  });
  const at = (event) => {
    const box = target.querySelector("svg").getBoundingClientRect();
    const down = ((event.clientY - box.top) * (top + height + 14)) / box.height;
    return Math.min(1, Math.max(0, (0.97 - (down - top) / height) / 0.94));
  };
  const brushes = axes.flatMap((_, place) => brush(page, place, left + place * step, { top, height, at }));
  const few = every > 1 ? `; ${drawn.length} of them are drawn` : "";
  const counts = metadata.labels.names.map((name, code) => [rows.filter((row) => page.columns.label[row] === code).length, name]);
  const told = counts.filter(([count]) => count).map(([count, name]) => `${count} ${name}`).join(", ");
  const note = element("p", { class: "reading" }, `${rows.length} of ${all.length} runs${told ? `: ${told}` : ""}${few}.`);
  if (page.brushes.size) showRuns(page, rows, `${rows.length} runs that were chosen along axes`);
  target.replaceChildren(...[
    element("div", { class: "scroll" }, svg("svg", { viewBox: `0 0 ${width} ${top + height + 14}`, width, height: top + height + 14, class: "plot wide", role: "img", "aria-label": "Parallel coordinates of runs" }, ...lines, ...brushes, ...rules)), note,
  ]);
}
