// Rows are shown that are of the kind chosen and hold the text that is looked for.
const rows = [...document.querySelector("tbody").rows];
const texts = rows.map((row) => row.textContent.toLowerCase());
const find = document.getElementById("find");
const kinds = [...document.querySelectorAll(".choice button")];
let kind = "";

const show = () => {
  const wanted = find.value.trim().toLowerCase();
  rows.forEach((row, k) => {
    row.hidden = (kind && row.dataset.kind !== kind) || !texts[k].includes(wanted);
  });
  document.getElementById("none").hidden = rows.some((row) => !row.hidden);
};

for (const button of kinds) {
  button.addEventListener("click", () => {
    kind = button.dataset.kind;
    kinds.forEach((other) => other.setAttribute("aria-pressed", String(other === button)));
    show();
  });
}
find.addEventListener("input", show);
