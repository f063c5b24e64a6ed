// One run over time: motion, forces and depth with units, where labels apply, contact modes; forces in the cone.

const LINES = ["var(--hue-0,#1845fb)", "var(--hue-1,#ff5e02)"];

// When each label of a run first applies [s].
function eventsOf(row, end) {
  const details = metadata.details[row];
  const step = details?.settings.timestep;
  if (!Number.isFinite(step)) return [];
  const found = details.labels.filter(([label, , at]) => label !== "stable" && Number.isFinite(at)).map(([label, , at]) => ({ label, time: at * step }));
  return found.filter((each) => each.time <= end);
}

function seriesOf(series, row) {
  const run = series.runs[row];
  const signals = run.signals.map(([name, unit, panel], index) => ({
    name, unit, panel, times: series.columns[`${row}:t${index}`], values: series.columns[`${row}:v${index}`],
  }));
  const lanes = run.bands.map(([pair, end], index) => ({
    pair, end, starts: series.columns[`${row}:s${index}`], modes: series.columns[`${row}:m${index}`],
  }));
  const touching = lanes.filter((lane) => lane.modes.some((mode) => mode > 0));
  return { signals, lanes, touching };
}

const greatest = (signal) => signal.values.reduce((most, value) => Math.max(most, Math.abs(value)), 0);

// The contact that bears most comes first.
function byForce({ signals, touching }) {
  const force = (pair) => greatest(signals.find((each) => each.name === `${pair} normal`) ?? { values: [] });
  return touching.map((lane) => lane.pair).sort((a, b) => force(b) - force(a));
}

function panelsOf({ signals }, chosen) {
  const motion = signals.filter((each) => each.panel === "motion" && each.name === chosen.motion);
  const own = (panel) => signals.filter((each) => each.panel === panel && each.name.startsWith(`${chosen.pair} `));
  return [
    { height: 110, lines: motion, title: motion.map((each) => withUnit(each.name, each.unit)).join(), zero: false },
    { height: 110, lines: own("force"), title: "contact force [N]", zero: true },
    { height: 80, lines: own("depth"), title: "depth [m]", zero: true },
  ].filter((panel) => panel.lines.length);
}

const LEFT = 62;
const LANE = 16;

function timelinePlot(series, row, chosen, width) {
  const data = seriesOf(series, row);
  const panels = panelsOf(data, chosen);
  const end = Math.max(...data.lanes.map((lane) => lane.end), ...panels.flatMap((panel) => panel.lines.map((line) => line.times.at(-1) ?? 0)), 1e-9);
  const inner = width - LEFT - 8;
  const events = eventsOf(row, end);
  const parts = [];
  let top = 20;
  for (const [place, panel] of panels.entries()) {
    const last = place === panels.length - 1;
    const box = { left: LEFT, top, width: inner, height: panel.height };
    const made = frame(box, [0, end], extent(panel.lines.flatMap((line) => Array.from(line.values)), panel.zero), { y: panel.title, x: "simulated time [s]" }, last);
    panel.up = made.up;
    parts.push(...made.parts);
    panel.lines.forEach((line, at) => parts.push(svg("path", {
      d: pathOf(Array.from(line.times, made.across), Array.from(line.values, made.up)), fill: "none", stroke: LINES[at], "stroke-width": 1.5,
    })));
    if (panel.lines.length > 1) {
      panel.lines.forEach((line, at) => parts.push(word(LEFT + inner - (panel.lines.length - 1 - at) * 78, top - 5, line.name.slice(chosen.pair.length + 1), { style: `fill:${LINES[at]}`, "text-anchor": "end", class: "key" })));
    }
    for (const event of events) {
      const x = made.across(event.time);
      parts.push(svg("line", { class: "event", x1: x, x2: x, y1: top, y2: top + panel.height }));
    }
    top += panel.height + 26;
  }
  const across = linear([0, end], [LEFT, LEFT + inner]);
  top += 10;
  for (const lane of data.touching.slice(0, 8)) {
    lane.starts.forEach((start, at) => parts.push(svg("rect", {
      x: across(start), width: Math.max(0.5, across(lane.starts[at + 1] ?? lane.end) - across(start)), y: top, height: LANE - 4,
      fill: lane.modes[at] ? metadata.modes[lane.modes[at]][1] : "var(--band)",
    }, svg("title", {}, `${lane.pair}: ${metadata.modes[lane.modes[at]][0]}`))));
    parts.push(word(LEFT + 2, top - 3, lane.pair, { class: "lane" }));
    top += LANE + 12;
  }
  const picture = svg("svg", { viewBox: `0 0 ${width} ${top}`, width, height: top, class: "plot" }, ...parts);
  return { picture, panels, across, end, inner, height: top, events, idle: data.lanes.length - data.touching.length };
}

function valueAt(line, time) {
  let [low, high] = [0, line.times.length - 1];
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (line.times[middle] <= time) low = middle;
    else high = middle - 1;
  }
  return line.values[low];
}

// One cursor through all panels; what it is over is read out below them.
function addCursor(plot, reading) {
  const line = svg("line", { class: "cursor", y1: 14, y2: plot.height, visibility: "hidden" });
  plot.picture.append(line);
  plot.picture.addEventListener("pointermove", (event) => {
    const shown = plot.picture.getBoundingClientRect();
    const x = ((event.clientX - shown.left) / shown.width) * (plot.inner + LEFT + 8);
    const time = ((x - LEFT) / plot.inner) * plot.end;
    if (time < 0 || time > plot.end) return;
    for (const side of ["x1", "x2"]) line.setAttribute(side, x);
    line.setAttribute("visibility", "visible");
    const values = plot.panels.flatMap((panel) => panel.lines.map((each) => `${each.name} ${amount(valueAt(each, time), each.unit)}`));
    reading.textContent = `${number(time)} s: ${values.join(", ")}`;
  });
}

// Tangential over normal force at each stored time: within the cone a contact sticks, on it, it slides.
function conePlot(series, row, pair, width) {
  const { signals } = seriesOf(series, row);
  const [normal, tangential] = ["normal", "tangential"].map((name) => signals.find((each) => each.name === `${pair} ${name}`));
  const friction = metadata.details[row]?.friction[pair];
  if (!friction || !normal || !greatest(normal)) return null;
  const most = greatest(normal);
  const box = { left: LEFT, top: 20, width: width - LEFT - 8, height: 150 };
  const high = Math.max(greatest(tangential), friction * most) * 1.05;
  const { parts, across, up } = frame(box, [0, most * 1.02], [0, high], { y: "tangential force [N]", x: "normal force [N]" });
  parts.push(svg("path", { class: "boundary", d: pathOf([0, most], [0, friction * most].map(up)).replace(/M[\d.]+/, `M${across(0)}`).replace(/L[\d.]+/, `L${across(most)}`) }));
  parts.push(svg("path", {
    class: "dots", stroke: LINES[0],
    d: Array.from(normal.values, (value, at) => (value > 0 ? `M${across(value).toFixed(1)},${up(tangential.values[at]).toFixed(1)}h.01` : "")).join(""),
  }));
  parts.push(word(across(most) - 4, up(friction * most) + 16, `μ = ${number(friction)}`, { "text-anchor": "end", class: "key" }));
  return svg("svg", { viewBox: `0 0 ${width} 205`, width, height: 205, class: "plot", role: "img", "aria-label": `Forces of ${pair} against the friction cone` }, ...parts);
}

function showTimeline(series, row) {
  const target = document.getElementById("timeline");
  if (!series.runs[row]) {
    const why = metadata.details[row]?.trace === null ? "No trace of this run was kept." : "The page does not hold its time series; see --traces, or the commands below.";
    target.replaceChildren(element("p", { class: "caption" }, why));
    return;
  }
  const data = seriesOf(series, row);
  const motions = data.signals.filter((each) => each.panel === "motion").map((each) => each.name);
  const pairs = byForce(data);
  const chosen = { motion: motions[0], pair: pairs[0] ?? "" };
  const box = element("div", {});
  const reading = element("p", { class: "reading", "aria-live": "off" });
  const redraw = () => {
    const width = Math.max(260, Math.min(640, target.clientWidth || 400));
    const plot = timelinePlot(series, row, chosen, width);
    addCursor(plot, reading);
    const events = plot.events.map((each) => `${each.label} from ${number(each.time)} s`).join(", ");
    reading.textContent = events ? `Dashed: ${events}.` : "";
    const idle = plot.idle ? `${plot.idle} other ${plot.idle === 1 ? "pair never touches" : "pairs never touch"}.` : "";
    const legend = metadata.modes.slice(1).flatMap(([name, colour]) => [element("i", { style: `background:${colour}` }), `${name}\u2003`]);
    box.replaceChildren(...[
      plot.picture, reading,
      data.touching.length ? element("p", { class: "caption modes" }, ...legend, idle) : null,
      conePlot(series, row, chosen.pair, width),
    ].filter(Boolean));
  };
  const controls = element("div", { class: "controls" },
    motions.length > 1 ? choice("coordinate", motions.map((name) => [name, name]), chosen.motion, (name) => { chosen.motion = name; redraw(); }) : null,
    pairs.length > 1 ? choice("contact", pairs.map((name) => [name, name]), chosen.pair, (name) => { chosen.pair = name; redraw(); }) : null);
  target.replaceChildren(controls, box);
  redraw();
}
