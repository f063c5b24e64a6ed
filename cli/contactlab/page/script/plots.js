// Small plots in SVG: scales, axes with units, lines.

function svg(tag, given = {}, ...inner) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [key, value] of Object.entries(given)) if (value !== null && value !== undefined) made.setAttribute(key, value);
  made.append(...inner.filter((each) => each !== null && each !== undefined));
  return made;
}

function linear([low, high], [from, to]) {
  const span = high - low || 1;
  return (value) => from + ((value - low) / span) * (to - from);
}

// Round numbers within limits, some `count` of them.
function roundTicks(low, high, count = 4) {
  const rough = (high - low) / count;
  if (!(rough > 0)) return [low];
  const power = 10 ** Math.floor(Math.log10(rough));
  const steps = [0.5, 1, 2, 5, 10].map((each) => each * power);
  const place = steps.findIndex((each) => each >= rough);
  const ticks = multiples(low, high, steps[place]);
  return ticks.length > 1 ? ticks : multiples(low, high, steps[place - 1]); // one shows no scale
}

function multiples(low, high, step) {
  const found = [];
  for (let at = Math.ceil(low / step - 1e-9); at * step <= high + 1e-9 * step; at++) found.push(Number((at * step).toPrecision(10)));
  return found;
}

// Ticks with as many digits as tell neighbors apart, at least four.
function tickTexts(ticks) {
  const size = Math.max(...ticks.map(Math.abs)) / Math.abs(ticks[1] - ticks[0]);
  const most = Number.isFinite(size) ? Math.max(4, Math.ceil(Math.log10(size)) + 1) : 4;
  return ticks.map((tick) => digits(tick, most));
}

function extent(values, zero = false) {
  let [low, high] = zero ? [0, 0] : [Infinity, -Infinity];
  for (const value of values) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  if (!(low <= high)) return [0, 1];
  if (low === high) return [low - (Math.abs(low) || 1) / 10, high + (Math.abs(high) || 1) / 10];
  return [low, high];
}

const pathOf = (xs, ys) => Array.from(xs, (x, at) => `${at ? "L" : "M"}${x.toFixed(1)},${ys[at].toFixed(1)}`).join("");

const word = (x, y, text, given = {}) => svg("text", { x, y, ...given }, text);

// The frame of a plot: grid, ticks and titles of both axes; `box` has left, top, width and height.
function frame(box, x, y, titles, showX = true) {
  const parts = [svg("rect", { class: "frame", x: box.left, y: box.top, width: box.width, height: box.height })];
  const [across, up] = [linear(x, [box.left, box.left + box.width]), linear(y, [box.top + box.height, box.top])];
  const bottom = box.top + box.height;
  const [, name, unit] = titles.y.match(/^(.*) \[(.*)\]$/) ?? [null, titles.y, ""];
  const [shown, factor] = smallUnit(unit, Math.max(...y.map(Math.abs)));
  const ticks = roundTicks(...y.map((end) => end * factor), Math.max(2, Math.round(box.height / 34)));
  const texts = tickTexts(ticks);
  for (const [place, tick] of ticks.entries()) {
    const height = up(tick / factor);
    parts.push(svg("line", { class: "grid", x1: box.left, x2: box.left + box.width, y1: height, y2: height }));
    parts.push(word(box.left - 5, height + 4, texts[place], { "text-anchor": "end" }));
  }
  for (const tick of roundTicks(...x, Math.max(2, Math.round(box.width / 90)))) {
    parts.push(svg("line", { class: "grid", x1: across(tick), x2: across(tick), y1: box.top, y2: bottom }));
    if (showX) parts.push(word(across(tick), bottom + 14, number(tick), { "text-anchor": "middle" }));
  }
  parts.push(word(box.left, box.top - 5, withUnit(name, shown), { class: "title" }));
  if (showX && titles.x) parts.push(word(box.left + box.width, bottom + 28, titles.x, { class: "title", "text-anchor": "end" }));
  return { parts, across, up };
}
