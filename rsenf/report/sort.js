"use strict";
// Sorts the table by the heading that is pressed: up, then down. What isn't known stays last.
for (const button of document.querySelectorAll("th button")) {
  button.addEventListener("click", () => {
    const heading = button.closest("th"), body = heading.closest("table").tBodies[0];
    const up = heading.getAttribute("aria-sort") !== "ascending", column = heading.cellIndex;
    const number = heading.classList.contains("n");
    const keyOf = row => row.cells[column].dataset.key;
    const rows = Array.from(body.rows);
    rows.sort((a, b) => {
      const x = keyOf(a), y = keyOf(b);
      if (x === undefined || y === undefined) return (x === undefined) - (y === undefined);
      const order = number ? x - y : x.localeCompare(y, undefined, {numeric: true});
      return up ? order : -order;
    });
    for (const other of heading.parentNode.cells) other.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", up ? "ascending" : "descending");
    body.append(...rows);
  });
}
