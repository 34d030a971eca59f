"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const [xs, ys, what] = ["x", "y", "what"].map(id => document.getElementById(id));
const canvas = document.getElementById("map"), pen = canvas.getContext("2d");
const COLOURS = ["#c0392b", "#e2983a", "#8e5bb5", "#2f6fb3", "#b5739d", "#7a6a4f", "#4aa3b5", "#c9b037", "#5d6d7e", "#999999"];
const GOOD = "#2f9e87", EDGE = { left: 64, right: 12, top: 10, bottom: 44 };
const WORDS = { why: "reason", ok: "share that passed", margin_deg: "margin of the joints, deg",
  hole_std_mm: "standard deviation of the least certain hole, mm", clearance_mm: "clearance, mm", motion_s: "motion, s", insertion: "insertion probability of the least certain cube" };

function options(select, entries) {
  for (const [value, text] of entries) select.add(new Option(text, value));
}
options(xs, data.axes.map((a, k) => [k, a.name]));
options(ys, data.axes.map((a, k) => [k, a.name]));
options(what, Object.keys(WORDS).filter(key => key in data.maps[0]).map(key => [key, WORDS[key]]));
ys.selectedIndex = Math.min(1, data.axes.length - 1);

function found() {
  const x = +xs.value, y = +ys.value;
  const straight = data.maps.find(m => m.x === x && m.y === y);
  const turned = data.maps.find(m => m.x === y && m.y === x);
  return straight ? { map: straight, at: (i, j) => j * data.axes[x].cells + i }
    : turned ? { map: turned, at: (i, j) => i * data.axes[y].cells + j } : null;
}

const WORSE = ["hole_std_mm", "motion_s"];  // the larger, the worse

function shade(part) {
  const mix = (a, b) => Math.round(a + (b - a) * part);
  return `rgb(${mix(192, 47)},${mix(57, 158)},${mix(43, 135)})`;
}

function goodness(value, least, most) {
  const part = most > least ? (value - least) / (most - least) : 1;
  return WORSE.includes(what.value) ? 1 - part : part;
}

let size = { width: 720, height: 480 };  // px of the page

function fit() {
  const width = canvas.clientWidth, height = Math.max(300, Math.round(width * 2 / 3)), dots = devicePixelRatio || 1;
  size = { width, height };
  canvas.style.height = `${height}px`;
  [canvas.width, canvas.height] = [width * dots, height * dots];
  pen.setTransform(dots, 0, 0, dots, 0, 0);
}

function place(x, y) {
  const wide = size.width - EDGE.left - EDGE.right, high = size.height - EDGE.top - EDGE.bottom;
  return [EDGE.left + x * wide, size.height - EDGE.bottom - y * high];
}

function inCell(part, axis) {
  return data.axes[axis].grid ? (part * (data.axes[axis].cells - 1) + 0.5) / data.axes[axis].cells : part;
}

function draw() {
  const ink = getComputedStyle(document.body).color;
  fit();
  const here = found(), [ax, ay] = [data.axes[+xs.value], data.axes[+ys.value]], key = what.value;
  const legend = document.getElementById("legend");
  legend.replaceChildren();
  if (here) {
    const values = here.map[key].filter(v => v !== null && v !== undefined);
    const least = Math.min(...values), most = Math.max(...values);
    for (let i = 0; i < ax.cells; i++) for (let j = 0; j < ay.cells; j++) {
      const k = here.at(i, j), n = here.map.n[k];
      if (!n) continue;
      const share = here.map.ok[k] / n;
      let colour, strength = 1;
      if (key === "why") {
        colour = share >= 0.5 || here.map.why[k] < 0 ? GOOD : COLOURS[here.map.why[k]];
        strength = 0.25 + 0.75 * (share >= 0.5 ? share : 1 - share);
      } else if (key === "ok") colour = shade(share);
      else if (here.map[key][k] === null) continue;
      else colour = shade(goodness(here.map[key][k], least, most));
      const [x0, y0] = place(i / ax.cells, j / ay.cells), [x1, y1] = place((i + 1) / ax.cells, (j + 1) / ay.cells);
      pen.globalAlpha = strength;
      pen.fillStyle = colour;
      pen.fillRect(x0, y1, x1 - x0 + 0.5, y0 - y1 + 0.5);
    }
    pen.globalAlpha = 1;
    const entries = key === "why" ? [[GOOD, "most pass"], ...data.reasons.map((r, k) => [COLOURS[k], r])]
      : key === "ok" ? [[shade(0), "none"], [shade(1), "all"]]
        : [least, most].map(v => [shade(goodness(v, least, most)), `${v}${v === least ? " (least)" : " (largest)"}`]);
    for (const [colour, text] of entries) {
      const swatch = document.createElement("span");
      swatch.style.cssText = `display:inline-block;width:12px;height:12px;margin:0 4px 0 12px;background:${colour}`;
      legend.append(swatch, String(text));
    }
  } else legend.textContent = "There is no map of these two values: the page has 15. The dots are of all that it draws.";
  for (const point of data.points) {
    const [x, y] = place(inCell(point[1][+xs.value], +xs.value), inCell(point[1][+ys.value], +ys.value));
    pen.fillStyle = point[3] < 0 ? GOOD : COLOURS[point[3]];
    pen.strokeStyle = ink;
    pen.lineWidth = 0.4;
    pen.beginPath();
    pen.arc(x, y, 2.2, 0, 7);
    pen.fill();
    pen.stroke();
  }
  const [left, bottom] = place(0, 0), [right, top] = place(1, 1);
  pen.strokeStyle = ink;
  pen.lineWidth = 0.5;
  pen.strokeRect(left, top, right - left, bottom - top);
  pen.fillStyle = ink;
  pen.font = "13px system-ui, sans-serif";
  const text = (words, x, y, align) => { pen.textAlign = align; pen.fillText(words, x, y); };
  text(ax.low, EDGE.left, size.height - 26, "left");
  text(ax.high, size.width - EDGE.right, size.height - 26, "right");
  text(ax.name, (EDGE.left + size.width) / 2, size.height - 8, "center");
  text(ay.low, EDGE.left - 6, size.height - EDGE.bottom, "right");
  text(ay.high, EDGE.left - 6, EDGE.top + 12, "right");
  pen.save();
  pen.translate(14, size.height / 2);
  pen.rotate(-Math.PI / 2);
  text(ay.name, 0, 0, "center");
  pen.restore();
}

canvas.addEventListener("click", event => {
  const box = canvas.getBoundingClientRect(), [px, py] = [event.clientX - box.left, event.clientY - box.top];
  let best = null, least = 144;
  for (const point of data.points) {
    const [x, y] = place(inCell(point[1][+xs.value], +xs.value), inCell(point[1][+ys.value], +ys.value));
    const off = (x - px) ** 2 + (y - py) ** 2;
    if (off < least) [best, least] = [point, off];
  }
  const told = document.getElementById("told");
  if (!best) { told.textContent = ""; return; }
  const values = data.axes.map((a, k) => `${a.name} ${best[2][k]}`).join(", ");
  const why = best[3] < 0 ? "passed" : data.reasons[best[3]];
  told.textContent = `Point ${best[0]}: ${values}: ${why}. Its files and its plan: a465 study ${data.study} --point ${best[0]}`;
});
for (const select of [xs, ys, what]) select.addEventListener("change", draw);
addEventListener("resize", draw);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
draw();
