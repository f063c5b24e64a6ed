const table = document.querySelector("table.atlas");
const body = table.tBodies[0];
const filter = document.querySelector(".atlas-filter input");
const count = document.querySelector(".atlas-filter span");
const order = (row, column) => {
  const cell = row.cells[column];
  return cell.dataset.order ?? cell.textContent.trim();
};
const compared = (a, b) =>
  isNaN(a) || isNaN(b) ? a.localeCompare(b, "en", { numeric: true }) : a - b;
const shown = () => {
  const words = filter.value.toLowerCase().split(/\s+/).filter(Boolean);
  let found = 0;
  for (const row of body.rows) {
    row.hidden = !words.every((word) => row.textContent.toLowerCase().includes(word));
    found += !row.hidden;
  }
  count.textContent = `${found} of ${body.rows.length}`;
};
filter.addEventListener("input", shown);
for (const button of document.querySelectorAll(".atlas-filter button")) {
  button.addEventListener("click", () => {
    filter.value = filter.value === button.textContent ? "" : button.textContent;
    shown();
  });
}
[...table.tHead.rows[0].cells].forEach((head, column) => {
  head.querySelector("button").addEventListener("click", () => {
    const down = head.getAttribute("aria-sort") === "ascending";
    for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
    const [empty, rows] = [[], []];
    for (const row of body.rows) (order(row, column) === "-" ? empty : rows).push(row);
    rows.sort((a, b) => compared(order(a, column), order(b, column)) * (down ? -1 : 1));
    body.append(...rows, ...empty);
  });
});
shown();
