// The map over two axes, one panel for each value of the facet axis if there is one.

const GAP = 0.03;
const EDGE = 0.2;
const WIDEST = 920;
const HIGHEST = 420;
const FENCE = 1.5;

const axisCodes = (columns, name) => columns[`axis:${name}`];

// A table lists what every chip chooses; on a map, an axis that it shows is not filtered by.
function selectedRows(columns, state, facet, everywhere = false) {
  const mapped = everywhere ? [] : [state.x, state.y, state.facet];
  const filters = Object.entries(state.only).filter(([name]) => !mapped.includes(name));
  const labels = new Set(state.labels);
  if (facet !== null) filters.push([state.facet, facet]);
  const tests = filters.map(([name, place]) => [axisCodes(columns, name), place]);
  const rows = [];
  for (let row = 0; row < metadata.runs; row++) {
    if (labels.size && !labels.has(columns.label[row])) continue;
    if (tests.every(([codes, place]) => codes[row] === place)) rows.push(row);
  }
  return rows;
}

// One panel; its cells are listed row by row from the lower left.
function panelOf(columns, state, facet) {
  const x = axisOf(state.x);
  const y = axisOf(state.y);
  const across = x.ticks.length;
  const up = y ? y.ticks.length : 1;
  const rows = Array.from({ length: across * up }, () => []);
  const xs = axisCodes(columns, x.name);
  const ys = y ? axisCodes(columns, y.name) : null;
  for (const row of selectedRows(columns, state, facet)) rows[(ys ? ys[row] : 0) * across + xs[row]].push(row);
  const aggregated = metadata.aggregated ? aggregatedCells(columns, x, y) : null;
  const cells = rows.map((own, place) => (aggregated ? aggregated(own, place) : cellOf(columns, own)));
  return { x, y, across, up, cells, facet, inferred: inferredLabel(state, facet) };
}

// As agreed in inferred_cells.py, of what is selected: the label of a cell that no run fills, or -1.
function inferredLabel(state, facet) {
  const shown = [state.x, state.y].filter((name) => name !== null && name !== undefined);
  const { refined, inferred } = metadata;
  if (shown.length !== refined.length || !shown.every((name) => refined.includes(name))) return () => -1;
  const chosen = { ...state.only, ...(facet === null ? {} : { [state.facet]: facet }) };
  const parts = inferred.filter(({ shared }) => Object.entries(shared).every(([name, place]) => !(name in chosen) || chosen[name] === place));
  const transposed = shown[0] !== refined[0];
  return (x, y) => {
    const labels = new Set(parts.map(({ codes }) => (transposed ? codes[x][y] : codes[y][x])));
    return labels.size === 1 ? [...labels][0] : -1;
  };
}

// A cell of runs: how many there are, how many have each label, and one number.
function cellOf(columns, rows) {
  const counts = new Array(metadata.labels.names.length).fill(0);
  for (const row of rows) counts[columns.label[row]]++;
  return { rows, counts, size: rows.length, number: (state) => cellNumber(columns, state, rows) };
}

// Cells of a page with too many runs; `rows` are the runs of a cell that it lists.
function aggregatedCells(columns, x, y) {
  const [one, other] = [metadata.axes.indexOf(x), y ? metadata.axes.indexOf(y) : -1];
  const transposed = y !== undefined && other < one;
  const name = y ? `cells:${Math.min(one, other)}:${Math.max(one, other)}` : `cells:${one}:`;
  const labels = metadata.labels.names.length;
  return (rows, place) => {
    const [at, up] = [place % x.ticks.length, Math.floor(place / x.ticks.length)];
    const own = transposed ? at * y.ticks.length + up : place;
    const counts = Array.from(columns[`${name}:labels`].subarray(own * labels, (own + 1) * labels));
    const number = ({ what, stat }) => columns[`${name}:${what}:${stat}`][own];
    return { rows, counts, size: counts.reduce((sum, count) => sum + count, 0), number };
  };
}

// As cell_statistics in map_cells.py.
function statistic(values, kind, better) {
  if (!values.length) return NaN;
  if (kind === "mean") return values.reduce((sum, value) => sum + value, 0) / values.length;
  if (kind === "worst") {
    const worse = better === "higher" ? (worst, value) => Math.min(worst, value) : (worst, value) => Math.max(worst, Math.abs(value));
    return values.reduce(worse, better === "higher" ? Infinity : 0);
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

// The position of a letter on its piece, not too near the sides of the cell.
const onPiece = (start, stop) => Math.min(Math.max((start + stop) / 2, EDGE), 1 - EDGE);

const failures = metadata.labels.names.filter((name) => name !== "stable").length;

function mainFailure(counts) {
  let main = -1;
  for (let code = 0; code < failures; code++) if (counts[code] > (main < 0 ? 0 : counts[main])) main = code;
  return main;
}

function labelLayers(panel) {
  const cells = [];
  const texts = [];
  const inferred = [];
  // As label_rows in heatmap.py.
  const leastShare = panel.across <= 12 ? 0.25 : 1;
  panel.cells.forEach(({ counts, size }, place) => {
    const [x, y] = [place % panel.across, Math.floor(place / panel.across)];
    const label = size ? -1 : panel.inferred(x, y);
    if (label >= 0) {
      inferred.push({ ...piece(x, y, 0, 1), label: metadata.labels.legend[label] });
      if (metadata.labels.letters[label]) texts.push({ x: x + 0.5, y: y + 0.5, text: metadata.labels.letters[label] });
    }
    const main = mainFailure(counts);
    let before = 0;
    counts.forEach((count, code) => {
      if (!count) return;
      const [start, stop] = [before / size, (before + count) / size];
      cells.push({ ...piece(x, y, start, stop), label: metadata.labels.legend[code] });
      const letter = metadata.labels.letters[code];
      if (code === main || (letter && stop - start >= leastShare)) texts.push({ x: x + onPiece(start, stop), y: y + 0.5, text: letter });
      before += count;
    });
  });
  return { cells, texts, inferred };
}

function numberLayers(state, panel) {
  const cells = [];
  const texts = [];
  panel.cells.forEach((cell, place) => {
    const [x, y] = [place % panel.across, Math.floor(place / panel.across)];
    const value = cell.number(state);
    if (!Number.isFinite(value)) return;
    cells.push({ ...piece(x, y, 0, 1), value });
    if (panel.across <= 12) texts.push({ x: x + 0.5, y: y + 0.5, text: digits(value) });
  });
  return { cells, texts };
}

// As boundary_rows in heatmap.py.
function boundaryLines({ cells, across }) {
  if (!quantityOf("oracle_expected")) return [];
  const expected = cells.map((cell) => cell.number({ what: "oracle_expected", stat: "worst" }));
  const lines = [];
  for (const [right, up] of [[1, 0], [0, 1]]) {
    expected.forEach((value, place) => {
      const [x, y] = [place % across, Math.floor(place / across)];
      const before = x >= right ? expected[place - right - up * across] : NaN;
      if (!Number.isFinite(value) || !Number.isFinite(before) || (value === 0) === (before === 0)) return;
      const part = String(lines.length);
      lines.push({ x, y, order: 0, part }, { x: x + up, y: y + right, order: 1, part });
    });
  }
  return lines;
}

function ticked(axis, ticks) {
  return {
    ...axis,
    values: ticks.map((_, index) => index + 0.5),
    labelExpr: `${JSON.stringify(ticks)}[floor(datum.value)]`,
  };
}

// Fills the map's specification with the data and the axes of one panel.
function filled(template, panel, layers, room) {
  const spec = structuredClone(template);
  const ups = panel.y ? panel.y.ticks : [""];
  const width = Math.min(Math.max(Math.min(room, WIDEST) / panel.across, 8), 210);
  const height = Math.min(Math.max(HIGHEST / panel.up, 13), 112);
  const widest = Math.max(...panel.x.ticks.map((tick) => tick.length));
  for (const layer of spec.layer) {
    const name = layer.data.name;
    layer.data = { name: `${name}${panel.facet ?? ""}`, values: layers[name] ?? [] };
    const { x, y } = layer.encoding;
    if (!x) continue;
    x.scale.domain = [0, panel.across];
    y.scale.domain = [0, panel.up];
    x.axis = { ...ticked(x.axis, panel.x.ticks), title: panel.x.title, labelAngle: widest * 7 > width ? -35 : 0 };
    y.axis = { ...ticked(y.axis, ups), title: panel.y ? panel.y.title : null };
  }
  return { ...spec, width: width * panel.across, height: height * panel.up };
}

// As number_scale in heatmap.py.
function withinFences(values) {
  const sorted = Float64Array.from(values).sort();
  const quantile = (share) => {
    const at = share * (sorted.length - 1);
    const low = Math.floor(at);
    return sorted[low] + (at - low) * ((sorted[low + 1] ?? sorted[low]) - sorted[low]);
  };
  const [first, third] = [quantile(0.25), quantile(0.75)];
  const reach = FENCE * (third - first) || Infinity;
  return [Math.max(sorted[0], first - reach), Math.min(sorted.at(-1), third + reach)];
}

function scaled(spec, layers, state) {
  const values = layers.flatMap((each) => each.cells.map((cell) => cell.value));
  const [name, unit, , resolution] = quantityOf(state.what);
  const sizes = values.filter((value) => value > resolution).sort((a, b) => a - b);
  const decades = sizes.length && Math.min(...values) >= 0 && sizes.at(-1) >= 30 * sizes[0];
  const { color } = spec.layer[0].encoding;
  const domain = decades ? withinFences(sizes.map(Math.log)).map(Math.exp) : values.length ? withinFences(values) : [0, 1];
  color.scale = { scheme: "cividis", type: decades ? "log" : "linear", domain, clamp: true, nice: false };
  if (!decades) color.scale.zero = false;
  color.legend.title = `${state.stat} ${withUnit(name, unit)}`;
}

function mapSpec(columns, state, room) {
  const facets = state.facet ? axisOf(state.facet).ticks.map((_, place) => place) : [null];
  const panels = facets.map((facet) => panelOf(columns, state, facet));
  const isLabel = state.what === "label";
  const layers = panels.map((panel) => (isLabel ? labelLayers(panel) : numberLayers(state, panel)));
  layers.forEach((each, index) => { each.boundary = boundaryLines(panels[index]); });
  const template = metadata.specs[isLabel ? "labels" : "number"];
  const perRow = Math.max(1, Math.min(3, facets.length, Math.floor(room / 260)));
  const parts = panels.map((panel, index) => filled(template, panel, layers[index], room / perRow - 90));
  for (const part of parts) {
    if (isLabel) part.layer[0].encoding.color.legend = null;
    else scaled(part, layers, state);
  }
  if (facets.length === 1) return { spec: parts[0], panels };
  const { config, $schema } = template;
  const concat = parts.map(({ config: _config, $schema: _schema, ...part }, index) => ({
    ...part, title: `${axisOf(state.facet).title} ${axisOf(state.facet).ticks[index]}`,
  }));
  return { spec: { $schema, config, concat, columns: perRow, spacing: 24 }, panels };
}

function cellText(state, panel, place) {
  const [x, y] = [place % panel.across, Math.floor(place / panel.across)];
  const { size, counts, number: value } = panel.cells[place];
  const where = [`${panel.x.title} ${panel.x.ticks[x]}`];
  if (panel.y) where.push(`${panel.y.title} ${panel.y.ticks[y]}`);
  if (panel.facet !== null) where.unshift(`${state.facet} ${axisOf(state.facet).ticks[panel.facet]}`);
  if (!size) {
    const label = panel.inferred(x, y);
    return `${where.join(", ")}: no run${label < 0 ? "" : `; ${metadata.labels.names[label]} is inferred, as at the corners of its cell`}`;
  }
  const parts = counts.flatMap((count, code) => (count ? [`${count} ${metadata.labels.names[code]}`] : []));
  if (state.what !== "label") {
    const [name, unit] = quantityOf(state.what);
    parts.unshift(`${state.stat} ${name} ${amount(value(state), unit, 4)}`);
  }
  return `${where.join(", ")}: ${size} ${size === 1 ? "run" : "runs"}; ${parts.join(", ")}`;
}

function mapTable(state, panels) {
  const one = (panel, place) => cellText(state, panel, place).split(": ").slice(1).join(": ");
  return panels.map((panel) => {
    const ups = panel.y ? panel.y.ticks : ["all"];
    const rows = ups.map((tick, y) => [tick, ...panel.x.ticks.map((_, x) => one(panel, y * panel.across + x))]).reverse();
    const corner = `${panel.y ? `${panel.y.title} \\ ` : ""}${panel.x.title}`;
    const made = table([corner, ...panel.x.ticks], rows);
    if (panel.facet !== null) made.prepend(element("caption", {}, `${state.facet} ${axisOf(state.facet).ticks[panel.facet]}`));
    return made;
  });
}
