// The view, kept in the address so that a link or a reload restores it.

const START = { what: "label", stat: "worst", x: metadata.mapAxes[0], y: metadata.mapAxes[1], facet: null };

function readState() {
  const given = new URLSearchParams(location.hash.slice(1));
  const state = { ...START, only: {}, limits: {}, cell: null, run: null };
  for (const [key, value] of given) {
    if (key.startsWith("only.")) state.only[key.slice(5)] = Number(value);
    else if (key.startsWith("limit.")) state.limits[key.slice(6)] = Number(value);
    else if (key === "cell") state.cell = value.split(".").map(Number);
    else if (key in state) state[key] = value === "" ? null : value;
  }
  return checked(state);
}

function checked(state) {
  if (state.what !== "label" && !quantityOf(state.what)) state.what = "label";
  if (!["worst", "median", "mean"].includes(state.stat)) state.stat = "worst";
  for (const side of ["x", "y", "facet"]) if (!axisOf(state[side])) state[side] = side === "x" ? START.x : null;
  for (const name of Object.keys(state.only)) {
    if (!axisOf(name) || !(state.only[name] < axisOf(name).ticks.length)) delete state.only[name];
  }
  if (metadata.aggregated) [state.facet, state.only] = [null, {}];
  for (const name of Object.keys(state.limits)) if (!Number.isFinite(state.limits[name])) delete state.limits[name];
  return state;
}

function writeState(state) {
  const query = new URLSearchParams();
  for (const key of ["what", "stat", "x", "y", "facet"]) {
    if (state[key] !== START[key]) query.set(key, state[key] ?? "");
  }
  for (const [name, place] of Object.entries(state.only)) query.set(`only.${name}`, place);
  for (const [name, limit] of Object.entries(state.limits)) query.set(`limit.${name}`, limit);
  if (state.cell) query.set("cell", state.cell.join("."));
  if (state.run) query.set("run", state.run);
  history.replaceState(null, "", `#${query}`);
}
