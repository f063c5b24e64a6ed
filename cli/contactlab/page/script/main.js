// Joins the parts: the page follows the state, and the state follows the reader.

const MOST_FIRST = 4;
const find = (id) => document.getElementById(id);

async function start() {
  const columns = await unpacked(JSON.parse(embedded("columns")));
  const packed = JSON.parse(embedded("series"));
  const series = { runs: packed.runs, columns: await unpacked(packed.packed) };
  await drawing();
  const page = { columns, series, state: readState(), panels: [], focus: null, view: null };
  document.body.classList.add("live");
  document.querySelector("#labels details").open = false;
  for (const each of document.querySelectorAll("code[data-run]")) {
    each.replaceWith(element("button", { class: "plain", onclick: () => openRun(page, rowOf(columns, each.dataset.run)) }, each.dataset.run));
  }
  for (const each of document.querySelectorAll("[data-open]")) {
    each.addEventListener("click", (event) => { event.preventDefault(); openRun(page, rowOf(columns, each.dataset.open)); });
  }
  const drawn = {
    map: find("map") && once(() => startMap(page)),
    tradeoff: find("tolerances") && once(() => startEvaluation(page)),
    runs: () => { page.table = startTable(page); },
    parallel: () => showParallel(page),
  };
  const wanted = page.state.tab;
  const open = startTabs(page, drawn);
  page.refresh = async () => {
    writeState(page.state);
    if (page.state.tab === "parallel") showParallel(page);
    else if (page.state.tab === "runs") page.table();
    else if (page.picture) await showMap(page);
  };
  showLabelChips(page, page.refresh);
  const { run } = page.state;
  if (!page.state.cell) showFirst(page);
  await open(wanted);
  if (run) openRun(page, rowOf(columns, run), false);
  document.body.dataset.ready = "yes";
}

// What is drawn by the first call stays.
function once(make) {
  let made = null;
  return () => (made ??= make());
}

// The map.

async function startMap(page) {
  const picture = find("map-picture");
  page.picture = picture;
  picture.tabIndex = 0;
  picture.setAttribute("role", "application");
  picture.setAttribute("aria-label", "Map of runs; arrow keys move between cells, Enter opens one");
  picture.addEventListener("keydown", (event) => onKey(page, event));
  showControls(page);
  await showMap(page);
  if (page.state.cell) openCell(page, page.state.cell, false);
}

function showControls(page) {
  const { state } = page;
  const change = (key) => (value) => {
    state[key] = value || null;
    if (key === "x" && state.y === state.x) state.y = null;
    if (state.facet === state.x || state.facet === state.y) state.facet = null;
    state.cell = null;
    showControls(page);
    showMap(page);
  };
  const names = (without) => metadata.axes.filter((axis) => !without.includes(axis.name)).map((axis) => [axis.name, axis.title]);
  const none = [["", "none"]];
  const others = metadata.axes.filter((axis) => !metadata.aggregated && ![state.x, state.y, state.facet].includes(axis.name));
  const focused = document.activeElement?.closest?.("#map [data-key]")?.dataset.key;
  const made = {
    what: choice("color", [["label", "labels"], ...metadata.quantities.map(([name, unit]) => [name, withUnit(name, unit)])], state.what, change("what")),
    stat: state.what === "label" ? null : choice("statistic", [["worst", "worst"], ["median", "median"], ["mean", "mean"]], state.stat, change("stat")),
    x: choice("horizontal axis", names([]), state.x, change("x")),
    y: metadata.axes.length > 1 ? choice("vertical axis", [...none, ...names([state.x])], state.y, change("y")) : null,
    facet: metadata.axes.length > 2 && !metadata.aggregated ? choice("one map per value of", [...none, ...names([state.x, state.y])], state.facet, change("facet")) : null,
  };
  for (const axis of others) {
    const key = `only.${axis.name}`;
    const choose = (place) => {
      if (place < 0) delete state.only[axis.name];
      else state.only[axis.name] = place;
      if (axis.ticks.length <= MOST_CHIPS) showControls(page);
      page.refresh();
    };
    const place = state.only[axis.name] ?? -1;
    made[key] = axis.ticks.length <= MOST_CHIPS ? valueChips(axis, place, choose) : slider(axis, place, choose);
  }
  const controls = Object.entries(made).filter(([, each]) => each);
  for (const [key, each] of controls) each.dataset.key = key;
  const filters = controls.filter(([key]) => key.startsWith("only."));
  find("map-controls").replaceChildren(...controls.filter((each) => !filters.includes(each)).map(([, each]) => each));
  find("map-filters").replaceChildren(...filters.map(([, each]) => each));
  if (focused) find("map").querySelector(`[data-key="${CSS.escape(focused)}"] :is(select, input, [aria-pressed=true])`)?.focus();
}

async function showMap(page) {
  const picture = find("map-picture");
  const { spec, panels } = mapSpec(page.columns, page.state, picture.clientWidth);
  find("map-data").querySelector(".scroll").replaceChildren(...mapTable(page.state, panels));
  writeState(page.state);
  const view = await draw(picture, legendBelow(spec, picture.clientWidth));
  if (!view) return;
  Object.assign(page, { view, panels, focus: null });
  view.addEventListener("click", (_, item) => onCell(page, item, (cell) => openCell(page, cell)));
  view.addEventListener("mouseover", (_, item) => onCell(page, item, (cell) => focusCell(page, cell)));
}

function onCell(page, item, then) {
  const datum = item?.datum;
  if (datum?.x === undefined || datum.y === undefined) return;
  const name = item.mark?.group?.context ? item : item;
  const panel = page.panels.length === 1 ? 0 : panelOfItem(page, name);
  then([panel, Math.floor(datum.x), Math.floor(datum.y)]);
}

// The map that a mark belongs to, of several: its topmost group has the map's number.
function panelOfItem(page, item) {
  let group = item.mark.group;
  while (group && !/^concat_\d+_group$/.test(group.mark?.name ?? "")) group = group.mark?.group;
  return group ? Number(group.mark.name.match(/\d+/)[0]) : 0;
}

function focusCell(page, cell) {
  const [at, x, y] = cell;
  const panel = page.panels[at];
  page.focus = cell;
  for (const each of page.panels) {
    const ring = each === panel ? [{ x, x2: x + 1, y, y2: y + 1 }] : [];
    page.view.data(`ring${each.facet ?? ""}`, ring);
  }
  page.view.runAsync();
  find("map-cell").textContent = cellText(page.state, panel, y * panel.across + x);
}

function onKey(page, event) {
  const moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  if (event.target.id !== "map-picture") return;
  if (event.key === "Enter" && page.focus) {
    openCell(page, page.focus);
  } else if (event.key in moves) {
    focusCell(page, page.focus ? moved(page, moves[event.key]) : [0, 0, 0]);
  } else {
    return;
  }
  event.preventDefault();
}

// Beyond the side of a map is the next map.
function moved(page, [right, up]) {
  const [at, x, y] = page.focus;
  const { across, up: height } = page.panels[at];
  const next = x + right;
  const row = Math.min(Math.max(y + up, 0), height - 1);
  if (next < 0) return at > 0 ? [at - 1, across - 1, row] : [at, 0, row];
  if (next >= across) return at + 1 < page.panels.length ? [at + 1, 0, row] : [at, across - 1, row];
  return [at, next, row];
}

function openCell(page, cell, move = true) {
  const [at, x, y] = cell;
  const panel = page.panels[at];
  const cellRows = panel?.cells[y * panel.across + x]?.rows;
  if (!cellRows) return;
  const rows = [...cellRows].sort((a, b) => page.columns.rank[a] - page.columns.rank[b]);
  page.state.cell = cell;
  focusCell(page, cell);
  showRuns(page, rows, cellText(page.state, panel, y * panel.across + x));
  if (rows.length === 1) openRun(page, rows[0], move);
  else {
    closeRun(page);
    if (move) find("run-list").querySelector("button")?.focus();
  }
}

// Runs.

function showRuns(page, rows, title) {
  const list = listOf(page.columns, page.state, rows, (row) => openRun(page, row));
  const few = metadata.aggregated ? element("p", { class: "caption" }, `${rows.length} of these are listed.`) : null;
  find("run-list").replaceChildren(...[element("h3", {}, title), few, ...list].filter(Boolean));
}

// Before the reader selects anything: some runs that fail, the worst first.
function showFirst(page) {
  const stable = metadata.labels.names.indexOf("stable");
  const rows = Array.from({ length: metadata.runs }, (_, row) => row);
  const failed = rows.filter((row) => page.columns.label[row] !== stable);
  const worst = failed.sort((a, b) => page.columns.rank[a] - page.columns.rank[b]).slice(0, MOST_FIRST);
  const first = find("first") ?? document.querySelector("[data-open]");
  const row = rowOf(page.columns, first?.dataset.open ?? idOf(page.columns, 0));
  if (!page.state.run) openRun(page, row, false, true);
  const nearest = find("first") && row >= 0 ? nearestStable(page.columns, row) : null;
  if (nearest?.changes) find("first").lastElementChild.append(`; stable with ${nearest.changes.join(", ")}`);
  if (worst.length) showRuns(page, worst, worst.length < failed.length ? `The worst ${worst.length} of ${failed.length} runs that fail` : "Runs that fail");
  else showRuns(page, rows.slice(0, MOST_FIRST), "All runs are stable; the first of them");
}

function closeRun(page) {
  page.state.run = null;
  find("run").replaceChildren();
  find("run-more").replaceChildren();
  writeState(page.state);
}

// The run that is shown before the reader chose any is no part of the address.
function openRun(page, row, move = true, unasked = false) {
  if (row < 0) return;
  if (!unasked) page.state.run = idOf(page.columns, row);
  const { head, more } = runPanel(page.columns, row, (other) => openRun(page, other));
  find("run").replaceChildren(...head);
  find("run-more").replaceChildren(...more);
  showTimeline(page.series, row);
  writeState(page.state);
  if (move) {
    find("run").focus({ preventScroll: true });
    find("run").scrollIntoView({ block: "nearest", behavior: "instant" });
  }
}

// Accuracy against time.

async function startEvaluation(page) {
  const body = find("tolerances").querySelector("tbody");
  for (const row of body.querySelectorAll("tr[data-name]")) makeLimit(page, row);
  addLimits(page, body);
  await showEvaluation(page, Object.keys(page.state.limits).length > 0);
}

function makeLimit(page, row) {
  const { name } = row.dataset;
  const given = page.state.limits[name] ?? metadata.tradeoff.tolerances[name];
  const input = element("input", { class: "limit", value: given ?? "", inputmode: "decimal", "aria-label": `limit of ${name}` });
  input.addEventListener("input", () => {
    const text = input.value.trim();
    const limit = text.endsWith("%") ? Number(text.slice(0, -1)) / 100 : Number(text);
    const wrong = text === "" || !Number.isFinite(limit) || limit < 0;
    input.classList.toggle("wrong", wrong);
    input.setAttribute("aria-invalid", wrong);
    if (wrong) return;
    if (limit === metadata.tradeoff.tolerances[name]) delete page.state.limits[name];
    else page.state.limits[name] = limit;
    showEvaluation(page, true);
  });
  row.querySelector(".limit").replaceChildren(input);
}

// Tolerances of other metrics can be added; those in the address are there from the start.
function addLimits(page, body) {
  const known = Object.keys(page.columns).filter((name) => name.startsWith("worst:")).map((name) => name.slice(6));
  const present = () => [...body.querySelectorAll("tr[data-name]")].map((row) => row.dataset.name);
  const add = (name) => {
    const cells = ["limit", "worst", "margin"].map((kind) => element("td", { class: `number ${kind}` }));
    const row = element("tr", { "data-name": name }, element("th", { scope: "row" }, name), ...cells);
    body.querySelector(".none")?.remove();
    body.append(row);
    makeLimit(page, row);
    return row;
  };
  for (const name of Object.keys(page.state.limits)) {
    if (!known.includes(name)) delete page.state.limits[name];
    else if (!present().includes(name)) add(name);
  }
  const options = () => [["", "add a tolerance"], ...known.filter((name) => !present().includes(name)).map((name) => [name, name])];
  const list = element("select", { "aria-label": "add a tolerance" });
  const refill = () => list.replaceChildren(...options().map(([value, text]) => element("option", { value }, text)));
  list.addEventListener("change", () => {
    if (list.value) add(list.value).querySelector("input").focus();
    refill();
  });
  refill();
  find("tradeoff-command").before(list);
}

async function showEvaluation(page, edited) {
  const limits = limitsOf(page.state);
  const evaluated = evaluate(page.columns, limits);
  for (const row of find("tolerances").querySelectorAll("tr[data-name]")) showMargin(page, row, evaluated.recommended, limits);
  if (edited) find("recommendation-text").replaceChildren(...recommendationOf(page.columns, evaluated, limits));
  const changed = Object.entries(page.state.limits).map(([name, limit]) => ` --tolerance ${name}=${limit}`);
  find("tradeoff-command").textContent = `contactlab tradeoff ${metadata.store}${changed.join("")}`;
  writeState(page.state);
  if (!metadata.specs.tradeoff) return;
  const picture = find("chart-picture");
  const view = await draw(picture, fitted(chartSpec(page.columns, evaluated, limits), picture.clientWidth));
  view?.addEventListener("click", (_, item) => onPoint(page, item?.datum));
}

function showMargin(page, row, place, limits) {
  const { name } = row.dataset;
  const known = place !== null && name in limits;
  const margin = known ? marginOf(page.columns, name, place, limits[name]) : null;
  row.querySelector(".worst").textContent = known ? number(page.columns[`worst:${name}`][place]) : "-";
  row.querySelector(".margin").textContent = margin === null ? "-" : `x ${digits(margin)}`;
}

function onPoint(page, datum) {
  if (datum?.place === undefined) return;
  const rows = [];
  page.columns.configuration.forEach((place, row) => { if (place === datum.place) rows.push(row); });
  const title = configurationOf(datum.place).map(([name, value]) => `${name} ${value}`).join(", ");
  showRuns(page, rows, title || "All runs");
  closeRun(page);
  find("run-list").scrollIntoView({ block: "nearest", behavior: "instant" });
  find("run-list").querySelector("button")?.focus({ preventScroll: true });
}

// In a browser that lacks a feature, the page stays as it was written.
start().catch((error) => console.warn(`this page is not interactive: ${error.message}`));
