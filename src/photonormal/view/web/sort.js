// A click on a column's name sorts its table; another click turns the order. Blank cells stay last.
for (const table of document.querySelectorAll("table")) {
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) =>
    head.firstElementChild.addEventListener("click", () => {
      const down = head.getAttribute("aria-sort") === "ascending";
      heads.forEach((h) => h.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", down ? "descending" : "ascending");
      const value = (row) => {
        const cell = row.cells[column],
          number = parseFloat(cell.dataset.value);
        return Number.isNaN(number) ? cell.textContent.trim() : number;
      };
      const before = (a, b) => {
        const x = value(a),
          y = value(b);
        if ((x === "") !== (y === "")) return x === "" ? 1 : -1;
        const order = typeof x === "number" && typeof y === "number" ? x - y : String(x).localeCompare(String(y));
        return down ? -order : order;
      };
      table.tBodies[0].append(...[...table.tBodies[0].rows].sort(before));
    }),
  );
}
document.body.dataset.ready = "yes";
