// The map over two axes. Each panel shows one value of the facet's axis, or all.

const GAP = 0.03;
const EDGE = 0.2;
const WIDEST = 560;

const axisCodes = (columns, name) => columns[`axis:${name}`];

function chosenRows(columns, state, facet) {
  const picks = Object.entries(state.only).filter(([name]) => ![state.x, state.y, state.facet].includes(name));
  if (facet !== null) picks.push([state.facet, facet]);
  const tests = picks.map(([name, place]) => [axisCodes(columns, name), place]);
  const rows = [];
  for (let row = 0; row < words.runs; row++) {
    if (tests.every(([codes, place]) => codes[row] === place)) rows.push(row);
  }
  return rows;
}

// One panel: its cells from the lower left, row by row.
function panelOf(columns, state, facet) {
  const x = axisOf(state.x);
  const y = axisOf(state.y);
  const across = x.words.length;
  const up = y ? y.words.length : 1;
  const rows = Array.from({ length: across * up }, () => []);
  const xs = axisCodes(columns, x.name);
  const ys = y ? axisCodes(columns, y.name) : null;
  for (const row of chosenRows(columns, state, facet)) rows[(ys ? ys[row] : 0) * across + xs[row]].push(row);
  const summed = words.summed ? sumsOf(columns, state, x, y) : null;
  const cells = rows.map((own, place) => (summed ? summed(own, place) : cellOf(columns, own)));
  return { x, y, across, up, cells, facet };
}

// A cell of runs: how many there are, of each label, and one number of them.
function cellOf(columns, rows) {
  const counts = new Array(words.labels.names.length).fill(0);
  for (const row of rows) counts[columns.label[row]]++;
  return { rows, counts, size: rows.length, number: (state) => cellNumber(columns, state, rows) };
}

// A cell of a page that has sums in place of runs: `rows` are those that it has.
function sumsOf(columns, state, x, y) {
  const [one, other] = [words.axes.indexOf(x), y ? words.axes.indexOf(y) : -1];
  const turned = y !== undefined && other < one;
  const name = y ? `sum:${Math.min(one, other)}:${Math.max(one, other)}` : `sum:${one}:`;
  const labels = words.labels.names.length;
  return (rows, place) => {
    const [at, up] = [place % x.words.length, Math.floor(place / x.words.length)];
    const own = turned ? at * y.words.length + up : place;
    const counts = Array.from(columns[`${name}:labels`].subarray(own * labels, (own + 1) * labels));
    const number = ({ what, stat }) => columns[`${name}:${what}:${stat}`][own];
    return { rows, counts, size: counts.reduce((sum, count) => sum + count, 0), number };
  };
}

function statistic(values, kind, better) {
  if (!values.length) return NaN;
  if (kind === "mean") return values.reduce((sum, value) => sum + value, 0) / values.length;
  if (kind === "worst") {
    return better === "higher" ? Math.min(...values) : values.reduce((most, value) => Math.max(most, Math.abs(value)), 0);
  }
  const ordered = Float64Array.from(values).sort();
  const half = ordered.length >> 1;
  return ordered.length % 2 ? ordered[half] : (ordered[half - 1] + ordered[half]) / 2;
}

function cellNumber(columns, state, rows) {
  const values = columns[`value:${state.what}`];
  const known = rows.map((row) => values[row]).filter(Number.isFinite);
  return statistic(known, state.stat, quantityOf(state.what)[2]);
}

function piece(x, y, start, stop) {
  const width = 1 - 2 * GAP;
  return { x: x + GAP + start * width, x2: x + GAP + stop * width, y: y + GAP, y2: y + 1 - GAP };
}

// Where on a piece its letter stands: not too near the sides of the cell.
const onPiece = (start, stop) => Math.min(Math.max((start + stop) / 2, EDGE), 1 - EDGE);

const failures = words.labels.names.filter((name) => name !== "stable").length;

function mainFailure(counts) {
  let main = -1;
  for (let code = 0; code < failures; code++) if (counts[code] > (main < 0 ? 0 : counts[main])) main = code;
  return main;
}

function labelLayers(panel) {
  const cells = [];
  const texts = [];
  panel.cells.forEach(({ counts, size }, place) => {
    const [x, y] = [place % panel.across, Math.floor(place / panel.across)];
    const main = mainFailure(counts);
    let before = 0;
    counts.forEach((count, code) => {
      if (!count) return;
      const [start, stop] = [before / size, (before + count) / size];
      cells.push({ ...piece(x, y, start, stop), label: words.labels.legend[code] });
      if (code === main) texts.push({ x: x + onPiece(start, stop), y: y + 0.5, text: words.labels.letters[main] });
      before += count;
    });
  });
  return { cells, words: texts };
}

function numberLayers(state, panel) {
  const cells = [];
  const texts = [];
  panel.cells.forEach((cell, place) => {
    const [x, y] = [place % panel.across, Math.floor(place / panel.across)];
    const value = cell.number(state);
    if (!Number.isFinite(value)) return;
    cells.push({ ...piece(x, y, 0, 1), value });
    if (panel.across <= 12) texts.push({ x: x + 0.5, y: y + 0.5, text: String(Number(value.toPrecision(3))) });
  });
  return { cells, words: texts };
}

// Where a critical value lies along an axis, in cells; beyond its ends nowhere.
function along(value) {
  const { marks } = words.boundary;
  const after = marks.findIndex((mark) => mark >= value);
  if (after < 0 || value < marks[0]) return NaN;
  if (after === 0) return 0.5;
  return after - 0.5 + (value - marks[after - 1]) / (marks[after] - marks[after - 1]);
}

// The lines of a closed form: for each row or column its least and its largest critical value.
function boundaryLines(columns, panel) {
  if (!words.boundary || words.summed) return [];
  const across = panel.x.name === words.boundary.axis;
  if (!across && panel.y?.name !== words.boundary.axis) return [];
  const lines = [];
  for (let code = 0; code < (across ? panel.up : panel.across); code++) {
    const own = panel.cells.filter((_, place) =>
      (across ? Math.floor(place / panel.across) : place % panel.across) === code);
    const values = own.flatMap((cell) => cell.rows.map((row) => columns.boundary[row])).filter(Number.isFinite);
    if (!values.length) continue;
    const ends = [Math.min(...values), Math.max(...values)].map(along).filter(Number.isFinite);
    for (const place of new Set(ends)) {
      const part = String(lines.length);
      for (const order of [0, 1]) {
        lines.push(across ? { x: place, y: code + order, order, part } : { x: code + order, y: place, order, part });
      }
    }
  }
  return lines;
}

function worded(axis, list) {
  return {
    ...axis,
    values: list.map((_, index) => index + 0.5),
    labelExpr: `${JSON.stringify(list)}[floor(datum.value)]`,
  };
}

// Fills a specification of the map with the data and the sides of one panel.
function filled(template, panel, layers, room) {
  const spec = structuredClone(template);
  const ups = panel.y ? panel.y.words : [""];
  const width = Math.min(Math.max(Math.min(room, WIDEST) / panel.across, 8), 112);
  const height = Math.min(Math.max(340 / panel.up, 13), 56);
  const widest = Math.max(...panel.x.words.map((word) => word.length));
  for (const layer of spec.layer) {
    const name = layer.data.name;
    layer.data = { name: `${name}${panel.facet ?? ""}`, values: layers[name] ?? [] };
    const { x, y } = layer.encoding;
    if (!x) continue;
    x.scale.domain = [0, panel.across];
    y.scale.domain = [0, panel.up];
    x.axis = { ...worded(x.axis, panel.x.words), title: panel.x.title, labelAngle: widest * 7 > width ? -35 : 0 };
    y.axis = { ...worded(y.axis, ups), title: panel.y ? panel.y.title : null };
  }
  return { ...spec, width: width * panel.across, height: height * panel.up };
}

function scaled(spec, layers, state) {
  const values = layers.flatMap((each) => each.cells.map((cell) => cell.value));
  const [name, unit, , resolution] = quantityOf(state.what);
  const sizes = values.filter((value) => value > resolution).sort((a, b) => a - b);
  const decades = sizes.length && Math.min(...values) >= 0 && sizes.at(-1) >= 30 * sizes[0];
  const { color } = spec.layer[0].encoding;
  const domain = decades ? [sizes[0], sizes.at(-1)] : [Math.min(...values), Math.max(...values)];
  color.scale = { scheme: "cividis", type: decades ? "log" : "linear", domain, clamp: true, zero: false, nice: false };
  if (!decades) delete color.scale.clamp;
  if (decades) delete color.scale.zero;
  color.legend.title = `${state.stat} ${titled(name, unit)}`;
}

function mapSpec(columns, state, room) {
  const facets = state.facet ? axisOf(state.facet).words.map((_, place) => place) : [null];
  const panels = facets.map((facet) => panelOf(columns, state, facet));
  const isLabel = state.what === "label";
  const layers = panels.map((panel) => (isLabel ? labelLayers(panel) : numberLayers(state, panel)));
  layers.forEach((each, index) => { each.boundary = boundaryLines(columns, panels[index]); });
  const template = words.specs[isLabel ? "labels" : "number"];
  const abreast = Math.max(1, Math.min(3, facets.length, Math.floor(room / 260)));
  const parts = panels.map((panel, index) => filled(template, panel, layers[index], room / abreast - 90));
  for (const part of parts) {
    if (isLabel) part.layer[0].encoding.color.legend.values = usedLabels(layers);
    else scaled(part, layers, state);
  }
  if (facets.length === 1) return { spec: parts[0], panels };
  const { config, $schema } = template;
  const titled = parts.map(({ config: _config, $schema: _schema, ...part }, index) => ({
    ...part, title: `${axisOf(state.facet).title} ${axisOf(state.facet).words[index]}`,
  }));
  return { spec: { $schema, config, concat: titled, columns: abreast, spacing: 24 }, panels };
}

function usedLabels(layers) {
  const used = new Set(layers.flatMap((each) => each.cells.map((cell) => cell.label)));
  return words.labels.legend.filter((name) => used.has(name));
}

function cellWords(state, panel, place) {
  const [x, y] = [place % panel.across, Math.floor(place / panel.across)];
  const { size, counts, number: value } = panel.cells[place];
  const where = [`${panel.x.title} ${panel.x.words[x]}`];
  if (panel.y) where.push(`${panel.y.title} ${panel.y.words[y]}`);
  if (panel.facet !== null) where.unshift(`${state.facet} ${axisOf(state.facet).words[panel.facet]}`);
  if (!size) return `${where.join(", ")}: no run`;
  const told = counts.flatMap((count, code) => (count ? [`${count} ${words.labels.names[code]}`] : []));
  if (state.what !== "label") {
    const [name, unit] = quantityOf(state.what);
    told.unshift(`${state.stat} ${name} ${number(value(state))} ${["1", "any"].includes(unit) ? "" : unit}`.trim());
  }
  return `${where.join(", ")}: ${size} ${size === 1 ? "run" : "runs"}; ${told.join(", ")}`;
}

function mapTable(state, panels) {
  const one = (panel, place) => cellWords(state, panel, place).split(": ").slice(1).join(": ");
  return panels.map((panel) => {
    const ups = panel.y ? panel.y.words : ["all"];
    const rows = ups.map((word, y) => [word, ...panel.x.words.map((_, x) => one(panel, y * panel.across + x))]).reverse();
    const corner = `${panel.y ? `${panel.y.title} \\ ` : ""}${panel.x.title}`;
    const made = table([corner, ...panel.x.words], rows);
    if (panel.facet !== null) made.prepend(element("caption", {}, `${state.facet} ${axisOf(state.facet).words[panel.facet]}`));
    return made;
  });
}
