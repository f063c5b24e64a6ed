const table = document.querySelector("table.atlas");
const body = table.tBodies[0];
const filter = document.querySelector(".atlas-filter input");
const count = document.querySelector(".atlas-filter span");
const text = (row, column) => row.cells[column].textContent.trim();
const shown = () => {
  const words = filter.value.toLowerCase().split(/\s+/);
  let found = 0;
  for (const row of body.rows) {
    row.hidden = !words.every((word) => row.textContent.toLowerCase().includes(word));
    found += !row.hidden;
  }
  count.textContent = `${found} of ${body.rows.length}`;
};
filter.addEventListener("input", shown);
[...table.tHead.rows[0].cells].forEach((head, column) => {
  head.querySelector("button").addEventListener("click", () => {
    const down = head.getAttribute("aria-sort") === "ascending";
    for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
    const rows = [...body.rows].sort((a, b) =>
      text(a, column).localeCompare(text(b, column), "en", { numeric: true }));
    body.append(...(down ? rows.reverse() : rows));
  });
});
shown();
