"use strict";
// One chart over the plan's clock: curves, limits, a linked cursor, click or drag to seek.

const SVG = "http://www.w3.org/2000/svg";
const WIDTH = 1000; // of the drawing, scaled to the element
const HEIGHT = 100;

class Chart {
  // y: {low, high, map} with map from value to the axis' scale.
  constructor(element, duration, onSeek) {
    Object.assign(this, { element, duration, onSeek });
    this.svg = document.createElementNS(SVG, "svg");
    this.svg.setAttribute("viewBox", `0 0 ${WIDTH} ${HEIGHT}`);
    this.svg.setAttribute("preserveAspectRatio", "none");
    element.replaceChildren(this.svg);
    const seek = (event) => this.onSeek(this.timeOf(event));
    element.addEventListener("pointerdown", (event) => {
      element.setPointerCapture(event.pointerId);
      this.dragging = true;
      seek(event);
    });
    element.addEventListener("pointermove", (event) => {
      this.hover?.setAttribute("d", vertical(this.x(this.timeOf(event))));
      if (this.dragging) seek(event);
    });
    for (const end of ["pointerup", "pointercancel"]) element.addEventListener(end, () => (this.dragging = false));
  }

  timeOf(event) {
    const box = this.element.getBoundingClientRect();
    return Math.min(1, Math.max(0, (event.clientX - box.left) / box.width)) * this.duration;
  }

  x(t) {
    return (WIDTH * t) / this.duration;
  }

  y(value) {
    const { low, high, map = (v) => v } = this.axis;
    return HEIGHT * (1 - (map(value) - map(low)) / (map(high) - map(low)));
  }

  // Clear the chart and set an axis, its tick values and their labels.
  clear(axis, ticks) {
    this.axis = axis;
    this.svg.replaceChildren();
    this.element.querySelectorAll(".tick").forEach((tick) => tick.remove());
    for (const [value, label] of ticks) {
      this.path(horizontal(this.y(value)), "grid");
      this.label("y", label, { top: `${this.y(value)}%` });
    }
    const step = [1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600].find((s) => this.duration / s <= 7) || 7200;
    for (let t = 0; t <= this.duration - 0.4 * step || t === 0; t += step) {
      this.label("x", t ? clockText(t, false) : "0", { left: `${this.x(t) / 10}%` });
    }
  }

  label(kind, text, style) {
    const made = document.createElement("span");
    made.className = `tick ${kind}`;
    made.textContent = text;
    Object.assign(made.style, style);
    this.element.append(made);
  }

  path(d, className, stroke) {
    const made = document.createElementNS(SVG, "path");
    made.setAttribute("d", d);
    made.setAttribute("class", className);
    if (stroke) made.style.stroke = stroke;
    this.svg.append(made);
    return made;
  }

  // points: [[t, value], ..]; a null value breaks the curve.
  curve(points, className, stroke) {
    let pen = "M";
    let d = "";
    for (const [t, value] of points) {
      if (value === null) {
        pen = "M";
        continue;
      }
      d += `${pen}${this.x(t).toFixed(1)} ${this.y(value).toFixed(2)}`;
      pen = "L";
    }
    return this.path(d, `curve ${className}`, stroke);
  }

  limit(value, note) {
    this.path(horizontal(this.y(value)), "limit");
    if (note) this.label("note", note, { top: `${this.y(value)}%` });
  }

  // Add the cursor and hover line above the curves.
  finish() {
    this.hover = this.path("", "hover");
    this.cursor = this.path("", "cursor");
    this.at(this.time || 0);
  }

  // Raise the cursor and hover line above what was drawn since.
  raise() {
    this.svg.append(this.hover, this.cursor);
  }

  at(t) {
    this.time = t;
    this.cursor?.setAttribute("d", vertical(this.x(t)));
  }
}

function vertical(x) {
  return `M${x.toFixed(1)} 0V${HEIGHT}`;
}

function horizontal(y) {
  return `M0 ${y.toFixed(2)}H${WIDTH}`;
}

function clockText(seconds, tenths = true) {
  const whole = tenths ? Math.floor(seconds * 10 + 1e-6) / 10 : Math.round(seconds);
  const minutes = Math.floor(whole / 60);
  const rest = whole - 60 * minutes;
  return `${minutes}:${(tenths ? rest.toFixed(1) : String(rest)).padStart(tenths ? 4 : 2, "0")}`;
}
