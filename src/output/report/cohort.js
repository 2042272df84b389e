"use strict";
(() => {
  const byId = (id) => document.getElementById(id);
  const table = document.querySelector(".cases");
  const body = table.tBodies[0];
  const rows = [...body.rows];
  const heads = [...table.tHead.rows[0].cells];
  const first = 3; // the cells before are the tick, the name and the state

  // ---- sorting: what is not there comes last either way ----
  const key = (row, cell) => {
    if (cell < first) return row.cells[cell].textContent;
    const text = row.cells[cell].textContent;
    return text === "" ? NaN : Number(text);
  };
  const compare = (a, b) => (typeof a === "number" ? a - b : a.localeCompare(b, "en", { numeric: true }));
  heads.forEach((head, cell) => {
    head.querySelector("button")?.addEventListener("click", () => {
      const down = head.getAttribute("aria-sort") === "ascending";
      heads.forEach((other) => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", down ? "descending" : "ascending");
      const there = (row) => !Number.isNaN(key(row, cell));
      rows.sort((a, b) => {
        if (there(a) !== there(b)) return there(a) ? -1 : 1;
        const order = there(a) ? compare(key(a, cell), key(b, cell)) : 0;
        return (down ? -order : order) || a.dataset.number - b.dataset.number;
      });
      body.append(...rows);
    });
  });

  // ---- finding ----
  byId("find").addEventListener("input", (event) => {
    const wanted = event.target.value.trim().toLowerCase();
    for (const row of rows) {
      const text = (row.cells[1].textContent + " " + row.cells[2].textContent).toLowerCase();
      row.hidden = !text.includes(wanted);
    }
  });

  // ---- a structure's columns instead of the whole's ----
  byId("structure").addEventListener("change", (event) => {
    const group = event.target.value;
    document.body.classList.toggle("by-structure", group !== "");
    for (const cell of table.querySelectorAll("[data-group]"))
      cell.classList.toggle("shown", cell.dataset.group === group);
    show();
  });

  // ---- comparing: a column a case, what it is off the first ----
  const make = (name, text, className) => {
    const element = document.createElement(name);
    if (text !== undefined) element.textContent = text;
    if (className) element.className = className;
    return element;
  };
  const show = () => {
    const picked = rows.filter((row) => row.querySelector("input").checked);
    byId("compare").hidden = picked.length === 0;
    if (picked.length === 0) return;
    const compared = make("table", undefined, "compared");
    const head = compared.createTHead().insertRow();
    head.append(make("th", ""));
    for (const row of picked) {
      const cell = make("th", row.cells[1].textContent);
      const picture = row.querySelector("img");
      if (picture) {
        const copy = make("img");
        copy.src = picture.src;
        copy.alt = "Structures of " + row.cells[1].textContent;
        cell.prepend(copy);
      }
      head.append(cell);
    }
    const lines = compared.createTBody();
    heads.forEach((title, cell) => {
      if (cell < first || getComputedStyle(title).display === "none") return;
      const line = lines.insertRow();
      line.append(make("th", title.textContent));
      const from = key(picked[0], cell);
      picked.forEach((row, n) => {
        const value = line.insertCell();
        value.textContent = row.cells[cell].textContent;
        const off = key(row, cell) - from;
        if (n > 0 && Number.isFinite(off) && off !== 0) {
          const part = from !== 0 ? " (" + (off > 0 ? "+" : "") + ((100 * off) / Math.abs(from)).toFixed(0) + " %)" : "";
          value.append(make("span", (off > 0 ? "+" : "") + Number(off.toPrecision(4)) + part, "off"));
        }
      });
    });
    byId("compared").replaceChildren(compared);
  };
  body.addEventListener("change", show);
})();
