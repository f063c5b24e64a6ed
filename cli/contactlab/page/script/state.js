// The view, kept in the address so that a link or a reload restores it.

// Where all runs are stable, a map of labels says nothing.
const allStable = metadata.labels.names.every((name) => name === "stable");
const START = { tab: null, what: (allStable && metadata.listed[0]) || "label", stat: "worst", x: metadata.mapAxes[0], y: metadata.mapAxes[1], facet: null };

function readState() {
  const given = new URLSearchParams(location.hash.slice(1));
  const state = { ...START, only: {}, limits: {}, labels: [], cell: null, run: null };
  for (const [key, value] of given) {
    if (key.startsWith("only.")) state.only[key.slice(5)] = Number(value);
    else if (key.startsWith("limit.")) state.limits[key.slice(6)] = Number(value);
    else if (key === "labels") state.labels = value.split(".").map(Number).filter((code) => code in metadata.labels.names);
    else if (key === "cell") state.cell = value.split(".").map(Number);
    else if (key in state) state[key] = value === "" ? null : value;
  }
  return checked(state);
}

function checked(state) {
  if (state.what !== "label" && !quantityOf(state.what)) state.what = START.what;
  if (!["worst", "median", "mean"].includes(state.stat)) state.stat = "worst";
  for (const side of ["x", "y", "facet"]) if (!axisOf(state[side])) state[side] = side === "x" ? START.x : null;
  for (const name of Object.keys(state.only)) {
    if (!axisOf(name) || !(state.only[name] < axisOf(name).ticks.length)) delete state.only[name];
  }
  if (metadata.aggregated) [state.facet, state.only, state.labels] = [null, {}, []];
  for (const name of Object.keys(state.limits)) if (!Number.isFinite(state.limits[name])) delete state.limits[name];
  return state;
}

function writeState(state) {
  const query = new URLSearchParams();
  for (const key of ["tab", "what", "stat", "x", "y", "facet"]) {
    if (state[key] !== START[key]) query.set(key, state[key] ?? "");
  }
  for (const [name, place] of Object.entries(state.only)) query.set(`only.${name}`, place);
  for (const [name, limit] of Object.entries(state.limits)) query.set(`limit.${name}`, limit);
  if (state.labels.length) query.set("labels", state.labels.join("."));
  if (state.cell) query.set("cell", state.cell.join("."));
  if (state.run) query.set("run", state.run);
  // Vega refers to gradients by the address, and a bare # at its end breaks that.
  history.replaceState(null, "", location.href.split("#")[0] + (query.size ? `#${query}` : ""));
}
