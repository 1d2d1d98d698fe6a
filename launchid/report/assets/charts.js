"use strict";
// uPlot panels that share a cursor and a zoom: drag along x, along y or over both, double-click to see all again.

const CHART_FONT = '12px system-ui, "DejaVu Sans", sans-serif';
const LATE = 1e5;                           // abscissae beyond it are shown from an origin of their own: stamps since 1970

// What all panels have in common; `of`: title, sync (key of those that share x), xlim (a list, or a function), ylim (a
// list, or a function of the x that is shown), x (label), abscissa (its name), log (of x and y), series, and what is
// drawn `under` and `over` the curves.
function panelOptions(of, width, height) {
  const axis = more => ({stroke: "#111", font: CHART_FONT, labelFont: CHART_FONT, labelSize: 18, labelGap: 0,
    grid: {stroke: "#dcdcdc", width: 1}, ticks: {stroke: "#999", size: 4, width: 1},
    values: (u, ticks) => ticks.map(v => v === null ? "" : shortest(v)), ...more});
  const follows = typeof of.ylim === "function";
  const origin = () => { const low = limits(of.xlim)[0]; return Math.abs(low) < LATE ? 0 : Math.floor(low); };
  const x = {size: 30, values: (u, ticks) => ticks.map(v => v === null ? "" : shortest(v - origin())),
    label: of.x ? () => origin() ? of.x.replace(" [", " \u2212 " + origin() + " [") : of.x : undefined};
  return {
    title: of.title, width, height, series: [{label: of.abscissa, value: (u, v) => v === null ? "" : shortest(v, 13)},
      ...of.series],
    cursor: {sync: {key: of.sync, setSeries: false, scales: ["x", null]}, drag: {x: true, y: !follows, uni: 30, dist: 4},
      points: {size: 6}},
    scales: {
      x: {time: false, distr: of.log && of.log[0] ? 3 : 1, range: (u, low, high) => {   // asked before y's
        u.zoomed = low > u.data[0][0] || high < u.data[0][u.data[0].length - 1];
        return u.shown = u.zoomed ? [low, high] : limits(of.xlim); }},
      y: {distr: of.log && of.log[1] ? 3 : 1, range: (u, low, high) => follows ? of.ylim(u.shown) :
        !u.zoomed || low === null ? of.ylim : of.log && of.log[1] ? [low, high] : uPlot.rangeNum(low, high, 0.08, true)}},
    axes: [axis(x), axis({size: 62})],
    legend: {markers: {width: 2, dash: (u, k) => isDashed(u, k) ? "dashed" : "solid",   // told apart in grey, too
      fill: (u, k) => k && !isDashed(u, k) ? u.series[k].stroke(u, k) : null}},
    hooks: {setLegend: [u => u.root.classList.toggle("read", u.legend.idx !== null)], drawAxes: [u => inside(u, of.under)], draw: [u => inside(u, of.over)]},
  };
}
function isDashed(u, k) { return Boolean(u.series[k].dash && u.series[k].dash.length); }
function limits(of) { return typeof of === "function" ? of() : of; }
function shortest(v, digits) { return v === null || v === undefined ? "\u2212" :
  String(Number(v.toPrecision(digits || 5))).replace(/-/g, "\u2212"); }

// Drawing in units of the page, clipped to the panel.
function inside(u, draw) {
  if (!draw) return;
  const g = u.ctx, scale = uPlot.pxRatio, box = u.bbox;
  g.save(); g.beginPath(); g.rect(box.left, box.top, box.width, box.height); g.clip(); g.scale(scale, scale);
  draw(g, u, {left: box.left / scale, top: box.top / scale, right: (box.left + box.width) / scale,
    bottom: (box.top + box.height) / scale, X: x => u.valToPos(x, "x") + box.left / scale,
    Y: y => u.valToPos(y, "y") + box.top / scale});
  g.restore();
}

// ---- a figure of the report: see launchid/charts/figure.py

function drawFigure(root, figure) {
  root.style.gridTemplateColumns = "repeat(" + figure.columns + ", minmax(0, 1fr))";
  const plots = figure.panels.map(of => {
    const place = document.createElement("div");
    place.style.gridRow = (of.row + 1) + " / span " + of.rows;
    place.style.gridColumn = (of.column + 1) + " / span " + of.columns;
    root.append(place);
    const all = of.bands.map(b => ({x: b.x, y: b.high, low: figure.arrays[b.low], label: b.label, color: b.color,
      width: 0, size: 0, dash: []})).concat(of.series);
    const [x, y] = [all.map(s => figure.arrays[s.x]), all.map(s => figure.arrays[s.y])];
    const data = x.length ? uPlot.join(x.map((each, k) => [each, y[k]])) : [[...of.xlim]];
    const series = all.map(s => ({label: s.label, stroke: s.color, width: s.width, dash: s.dash,
      points: {show: s.size > 0, size: s.size, stroke: s.color, fill: s.color}, value: (u, v, k, row) => s.low ? inBand(figure.arrays[s.x], s.low, figure.arrays[s.y], u.data[0][row]) :
        v === null || v === undefined ? "" : shortest(v),
      ...(s.width ? {} : {paths: () => null})}));
    const options = panelOptions({...of, series, sync: root.id + of.group, under: (g, u, on) => { spans(g, on, of.marks);
      for (const b of of.bands) fill(g, on, figure.arrays[b.x], figure.arrays[b.low], figure.arrays[b.high], b.color); },
      over: (g, u, on) => words(g, on, of.marks)}, place.clientWidth, of.height);
    const plot = new uPlot(options, data, place);
    plot.root.querySelectorAll(".u-series").forEach((row, k) => { row.hidden = k > 0 && (
      !all[k - 1].label || all.findIndex(s => s.label === all[k - 1].label) < k - 1); });
    return [place, plot, of.height];
  });
  window.addEventListener("resize", () => plots.forEach(([place, plot, height]) =>
    plot.setSize({width: place.clientWidth, height})));
}
function fill(g, on, x, low, high, color) {  // between two curves, broken where one is unknown
  const known = k => low[k] !== null && high[k] !== null;
  g.fillStyle = color;
  for (let k = 0; k < x.length;) {
    const from = k;
    while (k < x.length && known(k)) k++;
    g.beginPath();
    for (let j = from; j < k; j++) g.lineTo(on.X(x[j]), on.Y(high[j]));
    for (let j = k - 1; j >= from; j--) g.lineTo(on.X(x[j]), on.Y(low[j]));
    g.fill(); k++;
  }
}
function inBand(x, low, high, at) {          // its ends nearest to the cursor
  if (at === undefined || at < x[0] || at > x[x.length - 1]) return "";
  const k = x.reduce((best, each, j) => Math.abs(each - at) < Math.abs(x[best] - at) ? j : best, 0);
  return low[k] === null || high[k] === null ? "" : shortest(low[k]) + " .. " + shortest(high[k]);
}
function spans(g, on, marks) {
  for (const m of marks) if (m.to !== undefined) {
    g.fillStyle = m.color;
    if (m.axis === "x") g.fillRect(on.X(m.from), on.top, on.X(m.to) - on.X(m.from), on.bottom - on.top);
    else g.fillRect(on.left, on.Y(m.to), on.right - on.left, on.Y(m.from) - on.Y(m.to));
  }
}
function words(g, on, marks) {
  g.font = CHART_FONT; g.textBaseline = "top"; g.textAlign = "left";
  for (const m of marks) {
    if (m.words !== undefined) {
      const x = on.X(m.at[0]) + 4, y = m.at[1] === null ? on.top + 3 : on.Y(m.at[1]) - 3;
      m.words.split("\n").forEach((line, k) => {  // on the other side where it would be cut
        const width = g.measureText(line).width, from = x + width > on.right ? Math.max(on.left + 2, x - width - 8) : x;
        g.fillStyle = "rgba(255,255,255,0.8)"; g.fillRect(from - 1, y + 13 * k - 1, width + 2, 14);
        g.fillStyle = "#111"; g.fillText(line, from, y + 13 * k);
      });
    } else if (m.to === undefined) {
      g.strokeStyle = m.color; g.lineWidth = m.width; g.setLineDash(m.dash); g.beginPath();
      if (m.axis === "x") { g.moveTo(on.X(m.from), on.top); g.lineTo(on.X(m.from), on.bottom); }
      else { g.moveTo(on.left, on.Y(m.from)); g.lineTo(on.right, on.Y(m.from)); }
      g.stroke(); g.setLineDash([]);
    }
  }
}
function drawFigures() {                    // each in the place of its picture, which stays where no script runs
  const hint = " Drag to zoom, double-click to see all; the legend shows the values at the cursor.";
  document.querySelectorAll(".chart").forEach((root, k) => {
    drawFigure(root, JSON.parse(root.querySelector("script").textContent));
    root.parentElement.querySelector("img").hidden = true;
    if (k === 0) root.parentElement.querySelector("figcaption").append(hint);
  });
}
