// Elements; text goes in as text, never as markup.

function element(tag, given = {}, ...inner) {
  const made = document.createElement(tag);
  for (const [key, value] of Object.entries(given)) {
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else if (value === true) made.setAttribute(key, "");
    else if (value !== null && value !== false && value !== undefined) made.setAttribute(key, value);
  }
  made.append(...inner.filter((each) => each !== null && each !== undefined));
  return made;
}

function table(header, rows) {
  const heads = header.map((name) => element("th", { scope: "col" }, name));
  const lines = rows.map(([first, ...rest]) =>
    element("tr", {}, element("th", { scope: "row" }, first), ...rest.map((cell) => element("td", {}, cell))));
  return element("table", {}, element("thead", {}, element("tr", {}, ...heads)), element("tbody", {}, ...lines));
}

function pairsOf(rows) {
  return element("dl", { class: "pairs" }, ...rows.map(([name, value, title]) =>
    element("div", {}, element("dt", { title }, name), element("dd", {}, value))));
}

function choice(name, options, chosen, onchange) {
  const list = element("select", { onchange: (event) => onchange(event.target.value) },
    ...options.map(([value, text]) => element("option", { value, selected: value === (chosen ?? "") }, text)));
  return element("label", {}, name, list);
}

// A slider over the values of an axis; its left end means all of them.
function slider(axis, place, oninput) {
  const label = (at) => (at < 0 ? "all" : axis.ticks[at]);
  const output = element("output", {}, label(place));
  const range = element("input", {
    type: "range", min: -1, max: axis.ticks.length - 1, value: place, "aria-label": axis.title,
    "aria-valuetext": label(place),
    oninput: (event) => {
      const at = Number(event.target.value);
      output.textContent = label(at);
      event.target.setAttribute("aria-valuetext", label(at));
      oninput(at);
    },
  });
  return element("label", {}, axis.title, element("span", {}, range, " ", output));
}
