// Tabs: one part of the page at a time, drawn when it is first shown.

function startTabs(page, drawn) {
  const links = [...document.querySelectorAll("nav a")];
  const list = document.querySelector("nav");
  list.setAttribute("role", "tablist");
  const sections = links.map((link) => find(link.hash.slice(1)));
  const open = async (name, focus = false) => {
    const place = Math.max(0, sections.findIndex((section) => section.id === name));
    for (const [at, link] of links.entries()) {
      link.setAttribute("aria-selected", at === place);
      link.tabIndex = at === place ? 0 : -1;
      sections[at].hidden = at !== place;
    }
    if (focus) links[place].focus();
    page.state.tab = place ? sections[place].id : null;
    writeState(page.state);
    await drawn[sections[place].id]?.();
  };
  links.forEach((link, at) => {
    link.id = `tab-${sections[at].id}`;
    link.setAttribute("role", "tab");
    link.setAttribute("aria-controls", sections[at].id);
    sections[at].setAttribute("role", "tabpanel");
    sections[at].setAttribute("aria-labelledby", link.id);
    link.addEventListener("click", (event) => { event.preventDefault(); open(sections[at].id); });
    link.addEventListener("keydown", (event) => {
      const move = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!move) return;
      event.preventDefault();
      open(sections[(at + move + links.length) % links.length].id, true);
    });
  });
  for (const each of document.querySelectorAll("[data-tab]")) {
    each.addEventListener("click", (event) => { event.preventDefault(); open(each.dataset.tab); });
  }
  return open;
}

// Chips: labels, and the values of axes that a map does not show; a pressed one filters every tab.
function chip(text, pressed, onclick, mark = null) {
  return element("button", { class: "chip", type: "button", "aria-pressed": String(pressed), onclick }, ...[mark, text].filter(Boolean));
}

function showLabelChips(page, changed) {
  const counts = metadata.labels.names.map(() => 0);
  for (const code of page.columns.label) counts[code]++;
  const chips = metadata.labels.names.map((name, code) => chip(
    metadata.aggregated ? name : `${name} ${counts[code]}`, page.state.labels.includes(code), () => {
      const { labels } = page.state;
      page.state.labels = labels.includes(code) ? labels.filter((each) => each !== code) : [...labels, code];
      showLabelChips(page, changed);
      find("chips").children[code].focus();
      changed();
    }, swatch(code)));
  if (!metadata.aggregated) find("chips").replaceChildren(...chips);
}

const MOST_CHIPS = 12;

function valueChips(axis, place, onchange) {
  const made = [-1, ...axis.ticks.keys()].map((at) => chip(at < 0 ? "all" : axis.ticks[at], at === place, () => onchange(at)));
  return element("div", { class: "values", role: "group", "aria-label": axis.title }, element("span", {}, axis.title), element("div", { class: "chips" }, ...made));
}
