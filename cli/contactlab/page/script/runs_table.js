// The table of all runs: sorted, filtered, searched, with columns to choose, and as CSV.

const FIRST_ROWS = 40; // so that the run below them is near

function columnsOf(page) {
  const { columns } = page;
  return [
    { name: "run", text: (row) => idOf(columns, row).slice(0, 8), key: (row) => row },
    { name: "label", text: (row) => metadata.labels.names[columns.label[row]], key: (row) => columns.rank[row] },
    { name: "as expected", text: (row) => ["-", "no", "yes"][columns.expected[row]], key: (row) => columns.expected[row] },
    ...metadata.axes.map((axis) => ({
      name: axis.name, title: axis.title, text: (row) => axisText(columns, axis, row), key: (row) => axisCodes(columns, axis.name)[row],
    })),
    ...metadata.quantities.map(([name, unit]) => {
      const values = columns[`value:${name}`];
      const most = values.reduce((most, value) => (Number.isFinite(value) ? Math.max(most, Math.abs(value)) : most), 0);
      const [shown, factor] = smallUnit(unit, most);
      return { name, title: withUnit(name, shown), numeric: true, text: (row) => number(values[row] * factor), key: (row) => (Number.isNaN(values[row]) ? -Infinity : values[row]) };
    }),
  ];
}

function startTable(page) {
  const all = columnsOf(page);
  const shown = new Set(["run", "label", ...metadata.axes.map((axis) => axis.name), ...metadata.listed]);
  if (page.columns.expected.some((each) => each > 0)) shown.add("as expected");
  const view = { sort: "label", down: false, words: "", most: FIRST_ROWS, shown };
  const body = element("div", { class: "scroll" });
  const status = element("span", { class: "caption", role: "status" });
  const search = element("input", { type: "search", placeholder: `search: ${[metadata.labels.names[0], metadata.axes.find((axis) => !axis.binned)?.ticks[0]].filter(Boolean).join(" ")}`, "aria-label": "search runs", oninput: (event) => { view.words = event.target.value; show(); } });
  const boxes = all.slice(1).map((column) => element("label", {},
    element("input", { type: "checkbox", checked: shown.has(column.name), onchange: (event) => { shown[event.target.checked ? "add" : "delete"](column.name); show(); } }),
    column.title ?? column.name));
  const chosen = () => all.filter((column) => view.shown.has(column.name));
  const download = element("button", { onclick: () => save(asCsv(page, all, found()), "runs.csv") }, "CSV");

  function found() {
    const words = view.words.toLowerCase().split(/\s+/).filter(Boolean);
    const texts = all.filter((column) => !column.numeric);
    const rows = selectedRows(page.columns, page.state, null, true).filter((row) => {
      if (!words.length) return true;
      const text = texts.map((column) => column.text(row)).join(" ").toLowerCase();
      return words.every((each) => text.includes(each));
    });
    const { key } = all.find((column) => column.name === view.sort);
    const sign = view.down ? -1 : 1;
    return rows.sort((a, b) => sign * (key(a) - key(b)) || a - b);
  }

  function show() {
    const rows = found();
    const heads = chosen().map((column) => element("th", { scope: "col", "aria-sort": column.name === view.sort ? (view.down ? "descending" : "ascending") : null, class: column.numeric ? "number" : null },
      element("button", { class: "plain", "data-sort": column.name, onclick: () => { view.down = view.sort === column.name ? !view.down : Boolean(column.numeric); view.sort = column.name; show(); body.querySelector(`[data-sort="${CSS.escape(column.name)}"]`).focus(); } },
        column.title ?? column.name, column.name === view.sort ? (view.down ? " ↓" : " ↑") : "")));
    const lines = rows.slice(0, view.most).map((row) => element("tr", {}, ...chosen().map((column) => {
      if (column.name === "run") return element("th", { scope: "row" }, element("button", { class: "plain", onclick: () => openRun(page, row) }, column.text(row)));
      if (column.name === "label") return element("td", { class: "nowrap" }, swatch(page.columns.label[row]), ` ${column.text(row)}`);
      return element("td", { class: column.numeric ? "number" : null }, column.text(row));
    })));
    body.replaceChildren(element("table", { class: "runs" }, element("thead", {}, element("tr", {}, ...heads)), element("tbody", {}, ...lines)));
    const more = element("button", { class: "plain", onclick: () => { view.most += 400; show(); } }, `${Math.min(400, rows.length - view.most)} more`);
    if (rows.length > view.most) body.append(more);
    status.textContent = rows.length > view.most ? `${view.most} of ${rows.length} runs; search or choose chips for fewer` : `${rows.length} ${rows.length === 1 ? "run" : "runs"}`;
  }

  find("run-table").replaceChildren(
    element("div", { class: "controls" }, search, element("details", { class: "columns-menu" }, element("summary", {}, "Columns"), element("div", {}, ...boxes)), download, status),
    body);
  show();
  return show;
}

function asCsv(page, all, rows) {
  const quoted = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
  const value = (column, row) => (column.name === "run" ? idOf(page.columns, row) : column.numeric ? String(column.key(row)).replace("-Infinity", "") : column.text(row));
  return [all.map((column) => column.name), ...rows.map((row) => all.map((column) => value(column, row)))].map((line) => line.map(quoted).join(",")).join("\n");
}

function save(text, name) {
  const link = element("a", { href: URL.createObjectURL(new Blob([text], { type: "text/csv" })), download: name });
  link.click();
  URL.revokeObjectURL(link.href);
}
