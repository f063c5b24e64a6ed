// What the page holds: names and texts as JSON, numbers as packed columns.

const embedded = (id) => document.getElementById(id).textContent;

const ARRAYS = {
  u1: Uint8Array, u2: Uint16Array, u4: Uint32Array, f4: Float32Array, f8: Float64Array,
};

function bytesOf(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
}

async function inflated(text) {
  const stream = new Blob([bytesOf(text)]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

const text = async (id) => new TextDecoder().decode(await inflated(embedded(id)));
const metadata = JSON.parse(await text("metadata"));

// Each column's bytes are ordered by significance: all first bytes, then all second ones, ...
async function unpacked(packed) {
  const bytes = await inflated(packed.bytes);
  const columns = {};
  let start = 0;
  for (const [name, kind, length] of packed.columns) {
    const array = new ARRAYS[kind](length);
    const width = array.BYTES_PER_ELEMENT;
    const raw = new Uint8Array(array.buffer);
    for (let place = 0; place < width; place++) {
      const from = start + place * length;
      for (let index = 0; index < length; index++) raw[index * width + place] = bytes[from + index];
    }
    columns[name] = array;
    start += width * length;
  }
  return columns;
}

// The charting library is unpacked once the page is painted.
async function drawing() {
  const code = await text("bundle");
  await new Promise((resolve, reject) => {
    window.addEventListener("drawing", resolve, { once: true });
    const script = document.createElement("script");
    script.type = "module";
    script.textContent = `${code}\nwindow.dispatchEvent(new Event("drawing"));`;
    script.onerror = reject;
    document.head.append(script);
  });
}

const latest = new WeakMap();

// Drawing takes a while: only the latest request is shown; the others resolve to null.
async function draw(target, spec) {
  const box = document.createElement("div");
  latest.set(target, box);
  const { view } = await window.vegaEmbed(box, spec, { actions: false, renderer: "svg", tooltip: false });
  if (latest.get(target) !== box) {
    view.finalize();
    return null;
  }
  target.replaceChildren(box);
  return view;
}

const NARROW = 560;

function wrapped(text, most) {
  const lines = [""];
  for (const word of text.split(" ")) {
    const last = lines.length - 1;
    if (lines[last] && lines[last].length + 1 + word.length > most) lines.push(word);
    else lines[last] = `${lines[last]} ${word}`.trim();
  }
  return lines;
}

// On narrow pages legends go below the chart.
function legendBelow(spec, room) {
  if (room < NARROW) spec.config.legend = { ...spec.config.legend, orient: "bottom", columns: 1 };
  return spec;
}

function fitted(spec, room) {
  spec.width = Math.min(spec.width, room < NARROW ? room - 90 : room - 300);
  const letter = 6.5; // width of a letter of a subtitle, of 11 pixels, in any font
  if (spec.title?.subtitle) spec.title.subtitle = wrapped(spec.title.subtitle.join(" "), room / letter);
  return legendBelow(spec, room);
}


// Significant digits, with a power of ten below a thousandth, as format_digits in amounts.py.
function digits(value, most = 3) {
  if (!Number.isFinite(value)) return "-";
  const short = Number(value.toPrecision(most));
  if (short !== 0 && Math.abs(short) < 1e-3) return short.toExponential();
  return String(Math.abs(value) >= 10 ** most && Math.abs(value) < 1e5 ? Math.round(value) : short);
}

const number = (value) => digits(value, 4);
const axisOf = (name) => metadata.axes.find((axis) => axis.name === name);
const quantityOf = (name) => metadata.quantities.find((each) => each[0] === name);
const unitless = (unit) => ["", "1", "any"].includes(unit);
const withUnit = (name, unit) => (unitless(unit) ? name : `${name} [${unit}]`);

// The prefix and factor with which a unit shows a size as a number from 0.1 on.
const PREFIXES = [["", 1], ["m", 1e3], ["µ", 1e6], ["n", 1e9]];

function smallUnit(unit, size) {
  const least = 0.1; // from here on, SI units are printed without a prefix
  const takesPrefix = /^(m|s|N|J|W|rad)(?![\w^])/.test(unit);
  const [prefix, factor] = (takesPrefix && PREFIXES.find(([, each]) => size * each >= least)) || PREFIXES[0];
  return [prefix + unit, factor];
}

// A number with its unit, as format_amount in amounts.py.
function amount(value, unit, most = 3) {
  if (!Number.isFinite(value) || unitless(unit)) return digits(value, most);
  const [name, factor] = smallUnit(unit, Math.abs(value));
  return `${digits(value * factor, most)} ${name}`;
}
