"use strict";

// The figures, in the page's own colours, light or dark.
function theme() {
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const axis = { gridcolor: colour("--line"), linecolor: colour("--line"), zeroline: false, automargin: true, exponentformat: "power" };
  const space = { gridcolor: colour("--line"), color: colour("--quiet") };
  return {
    layout: {
      font: { color: colour("--text"), size: 12 },
      paper_bgcolor: "rgba(0,0,0,0)",
      plot_bgcolor: "rgba(0,0,0,0)",
      margin: { l: 10, r: 10, t: 30, b: 10 },
      xaxis: axis,
      yaxis: axis,
      scene: { xaxis: space, yaxis: space, zaxis: space },
      hoverlabel: { bgcolor: colour("--panel"), font: { color: colour("--text") } },
      modebar: { bgcolor: "rgba(0,0,0,0)", color: colour("--quiet"), activecolor: colour("--text") },
    },
  };
}

// Only what is named here: Plotly's own choice has a button that sends the chart to its makers.
const flat = [["toImage"], ["zoom2d", "pan2d", "resetScale2d"]];
const spatial = [["toImage"], ["orbitRotation", "pan3d", "zoom3d", "resetCameraDefault3d"]];

const figures = JSON.parse(document.getElementById("figures").textContent);
const places = [...document.querySelectorAll("[data-figure]")];
const drawn = places.map((place) => {
  const { data, layout } = figures[place.dataset.figure];
  layout.template = theme();
  if (layout.scene && place.clientWidth < 600) {
    const eye = layout.scene.camera.eye;
    for (const axis of ["x", "y", "z"]) eye[axis] *= 1.7; // a narrow page needs some distance
  }
  return Plotly.newPlot(place, data, layout, {
    responsive: true,
    displaylogo: false,
    displayModeBar: "hover",
    modeBarButtons: layout.scene ? spatial : flat,
  });
});
Promise.all(drawn).then(() => document.documentElement.classList.add("drawn"));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  for (const place of places) Plotly.relayout(place, { template: theme() });
});

// Tables: a click on a heading sorts by it, numbers first from the largest, a second click turns.
for (const table of document.querySelectorAll("table.sortable")) {
  const body = table.tBodies[0];
  const headings = [...table.tHead.rows[0].cells];
  headings.forEach((heading, column) => {
    heading.firstElementChild.addEventListener("click", () => {
      const key = (row) => row.cells[column].dataset.value ?? row.cells[column].textContent;
      const rows = [...body.rows];
      const numeric = rows.every((row) => key(row) !== "" && !Number.isNaN(Number(key(row))));
      const first = numeric ? "descending" : "ascending";
      const second = numeric ? "ascending" : "descending";
      const order = heading.getAttribute("aria-sort") === first ? second : first;
      const sign = order === "ascending" ? 1 : -1;
      const compare = numeric
        ? (a, b) => Number(key(a)) - Number(key(b))
        : (a, b) => key(a).localeCompare(key(b), undefined, { numeric: true });
      rows.sort((a, b) => sign * compare(a, b));
      body.append(...rows);
      for (const other of headings) other.removeAttribute("aria-sort");
      heading.setAttribute("aria-sort", order);
    });
  });
}
