"use strict";
// What a refusal marks in the picture: both bodies in red and named, their nearest points, places out of reach.

const CIRCLE_M = 0.03; // radius of the circle at a place
const CIRCLE_POINTS = 48;
const CLOSE_M = [0.045, 0.16]; // least and usual half height of a close-up
const LABEL_GAP = 6;
const RED = { opacity: [1, 0.7] }; // of the two bodies: one inside the other is seen

class Marks {
  constructor(content, cell, stage) {
    Object.assign(this, { content, cell, stage });
    this.views = ["marks", "close-marks"].map((id) => document.getElementById(id));
    document.body.classList.add("refusal");
    const [{ pair, away }] = content.misses;
    const missed = pair.length || away !== null;
    const title = content.misses.length > 1 ? "Nearest misses" : missed ? "Nearest miss" : "The arm";
    document.getElementById("list-title").textContent = title;
    fillAdvice(content);
    if (!stage) return;
    for (const cube of cell.cubes) cube.mesh.material.color.set(CUBE_COLOURS[2]); // none of them red
    this.camera = new THREE.PerspectiveCamera(stage.camera.fov, 1, 0.005, 30);
    this.camera.up.set(0, 0, 1);
    stage.over.push(() => this.draw());
  }

  show(index) {
    this.miss = this.content.misses[index];
    this.cell?.mark(this.miss.pair, RED.opacity);
    const list = document.querySelector("#miss dl");
    list.replaceChildren();
    document.querySelector("#miss h2").textContent = this.miss.points ? "Checked again here" : "Marked";
    for (const [name, value] of missFacts(this.miss)) list.append(element("dt", "", name), element("dd", "", value));
    document.getElementById("miss").hidden = !list.children.length;
    if (this.stage) this.aim();
  }

  // What is joined by a line: the nearest points of the bodies, or the tool and where it should be.
  ends() {
    const { points, places, away, distance } = this.miss;
    if (points) {
      const [one, other] = points.map((p) => new THREE.Vector3(...p));
      // of bodies that overlap, the deepest points may be on their far sides
      return distance > 0 ? [one, other] : [one.lerp(other, 0.5)];
    }
    return away === null ? [] : [this.tool(), Marks.centre(places[0])];
  }

  static centre({ T }) {
    return new THREE.Vector3(T[3], T[7], T[11]);
  }

  // Points of all misses.
  static places(content) {
    const each = ({ points, places }) => [...(points || []).map((p) => new THREE.Vector3(...p)), ...places.map(Marks.centre)];
    return content.misses.flatMap(each);
  }

  tool() {
    this.cell.triad.updateMatrixWorld(true);
    return new THREE.Vector3().setFromMatrixPosition(this.cell.triad.matrixWorld);
  }

  // The close-up: across the line between the points, else as the whole picture is seen.
  aim() {
    const ends = this.ends();
    const points = ends.length ? ends : this.miss.places.map(Marks.centre);
    const frame = document.getElementById("close");
    frame.hidden = !points.length;
    if (!points.length) return;
    const { camera, stage } = this;
    const middle = points.reduce((sum, p) => sum.add(p), new THREE.Vector3()).divideScalar(points.length);
    const far = Math.max(...points.map((p) => p.distanceTo(middle)));
    const line = points.length > 1 && far > 0 ? points[0].clone().sub(middle).normalize() : new THREE.Vector3();
    stage.camera.updateMatrixWorld(true);
    frame.classList.toggle("right", middle.clone().project(stage.camera).x < 0); // beside what it shows
    const back = stage.camera.position.clone().sub(stage.controls.target).normalize();
    back.addScaledVector(line, -back.dot(line));
    if (back.length() < 0.1) back.set(1, -1, 0.3);
    const half = far > 0 ? Math.min(Math.max(3 * far, CLOSE_M[0]), Math.max(CLOSE_M[1], 1.5 * far)) : CLOSE_M[1];
    camera.position.copy(middle).addScaledVector(back.normalize(), half / Math.tan((camera.fov * Math.PI) / 360));
    camera.lookAt(middle);
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld(true);
    stage.draw();
  }

  // ---- drawn over the picture at every frame
  draw() {
    if (!this.miss) return;
    const [whole, close] = this.views;
    this.over(whole, this.stage.camera, true);
    const frame = document.getElementById("close");
    if (frame.hidden) return;
    this.stage.inset(this.camera, frame);
    this.over(close, this.camera, false);
  }

  over(svg, camera, named) {
    const { miss } = this;
    const [width, height] = [svg.clientWidth, svg.clientHeight];
    const flat = (p) => {
      const v = p.clone().project(camera);
      return { x: ((v.x + 1) / 2) * width, y: ((1 - v.y) / 2) * height };
    };
    const made = [];
    const labels = [];
    for (const { T } of miss.places) {
      const pose = matrix(T);
      const ring = Array.from({ length: CIRCLE_POINTS }, (_, i) => {
        const turn = (2 * Math.PI * i) / CIRCLE_POINTS;
        return flat(new THREE.Vector3(CIRCLE_M * Math.cos(turn), CIRCLE_M * Math.sin(turn), 0).applyMatrix4(pose));
      });
      made.push(shape("path", { d: `M${ring.map((p) => `${p.x} ${p.y}`).join("L")}Z`, class: "ring" }));
    }
    const ends = this.ends().map(flat);
    const [a, b = a] = ends;
    if (a) {
      const middle = { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2 };
      if (miss.points && named) made.push(shape("circle", { cx: middle.x, cy: middle.y, r: 15, class: "ring" }));
      made.push(shape("line", { x1: a.x, y1: a.y, x2: b.x, y2: b.y, class: "between" }));
      for (const p of b === a ? [a] : [a, b]) made.push(shape("circle", { cx: p.x, cy: p.y, r: 3, class: "point" }));
      if (named) labels.push({ at: middle, dx: 40, dy: -54, text: miss.points ? distanceText(miss) : awayText(miss), strong: true });
    }
    if (named) {
      miss.pair.forEach((name, i) => {
        const at = this.middle(name, flat) || a;
        if (at) labels.push({ at, dx: 70, dy: i ? 26 : -20, left: a && at.x !== a.x ? at.x < a.x : !i, text: name });
      });
      if (this.cell.view?.visible) labels.push({ at: flat(this.cell.view.corner), dx: 20, dy: -24, text: "what the camera sees" });
      for (const place of miss.places) labels.push({ at: flat(Marks.centre(place)), dx: 50, dy: 34, left: true, text: place.name });
    }
    svg.replaceChildren(...made);
    placeLabels(svg, labels, width, height, named ? ["close", "views"].map((id) => document.getElementById(id)) : []);
  }

  // The middle of a body in the picture.
  middle(name, flat) {
    let part = null;
    this.cell.named.get(name)?.traverse((one) => (part ||= one.isMesh ? one : null));
    if (!part) return null;
    part.geometry.computeBoundingBox();
    const { min, max } = part.geometry.boundingBox;
    return flat(min.clone().lerp(max, 0.5).applyMatrix4(part.matrixWorld));
  }
}

function shape(tag, attributes, text = "") {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.textContent = text;
  return made;
}

// Each label beside its place, inside the picture, and none over another or over one of the `others`, elements.
function placeLabels(svg, labels, width, height, others) {
  const all = svg.getBoundingClientRect();
  const taken = others.filter((one) => one.getClientRects().length).map((one) => {
    const { left, top, width: w, height: h } = one.getBoundingClientRect();
    return { x: left - all.left, y: top - all.top, w, h };
  });
  for (const { at, dx, dy, left, text, strong } of labels) {
    const words = shape("text", { class: strong ? "strong" : "" }, text);
    svg.append(words);
    const [w, h] = [words.getComputedTextLength() + 12, 20];
    const within = (v, most) => Math.min(Math.max(v, 4), Math.max(4, most - 4));
    const places = Array.from({ length: 60 }, (_, k) => {
      const toLeft = Boolean(left) !== (k % 2 === 1); // the usual side, then the other, ever further up and down
      const shift = LABEL_GAP * Math.ceil(Math.floor(k / 2) / 2) * (Math.floor(k / 2) % 2 ? 1 : -1);
      return { x: within(toLeft ? at.x - dx - w : at.x + dx, width - w), y: within(at.y + dy - h / 2 + shift, height - h), w, h };
    });
    const free = (p) => taken.every((t) => p.x + p.w < t.x || t.x + t.w < p.x || p.y + p.h < t.y || t.y + t.h < p.y);
    const box = places.find(free) || places[0];
    taken.push(box);
    const near = { x: Math.min(Math.max(at.x, box.x), box.x + w), y: Math.min(Math.max(at.y, box.y), box.y + h) };
    const style = strong ? "strong" : "";
    svg.insertBefore(shape("line", { x1: at.x, y1: at.y, x2: near.x, y2: near.y, class: "leader" }), words);
    svg.insertBefore(shape("rect", { x: box.x, y: box.y, width: w, height: h, rx: 5, class: style }), words);
    words.setAttribute("x", box.x + 6);
    words.setAttribute("y", box.y + 14);
  }
}

// The depth of an overlap may be measured through the far side of a body, so it is not told.
function distanceText({ distance }) {
  return distance > 0 ? `${millimetres(1e3 * distance)} apart` : "inside each other";
}

function awayText({ away, turned }) {
  const parts = [];
  if (away >= 5e-5) parts.push(millimetres(1e3 * away));
  if (turned >= 5e-4) parts.push(`${((180 / Math.PI) * turned).toFixed(1)}°`);
  return parts.length ? `missed by ${parts.join(" and ")}` : "this pose alone can be reached";
}

function missFacts(miss) {
  const mm = (p) => `${p.map((v) => (1e3 * v).toFixed(1)).join(", ")} mm`;
  const rows = [];
  if (miss.points) rows.push(["bodies", miss.pair.join(" – ")], ["distance", distanceText(miss).replace(" apart", "")]);
  const drawn = miss.points ? Math.hypot(...miss.points[0].map((v, i) => v - miss.points[1][i])) : 0;
  if (miss.distance > 0 && drawn - miss.distance > 5e-5) rows.push(["as drawn", `${millimetres(1e3 * drawn)}, of which ${millimetres(1e3 * (drawn - miss.distance))} are padding`]);
  if (miss.points && miss.required !== null) rows.push(["required", millimetres(1e3 * miss.required)]);
  if (miss.distance > 0) miss.pair.forEach((name, i) => rows.push([`point of ${name}`, mm(miss.points[i])]));
  for (const { name, T } of miss.places) rows.push([name, mm([T[3], T[7], T[11]])]);
  if (miss.away !== null) rows.push(["the tool there", awayText(miss)]);
  return rows;
}

// One row for each miss, below where it is; returns them.
function fillMisses(content, onStep) {
  const list = document.getElementById("list");
  const many = content.misses.length > 1; // of a single one the refusal says why
  let where = null;
  return content.misses.map((miss, index) => {
    if (many && miss.where !== where) list.append(element("h3", "", (where = miss.where)));
    const row = button("", () => onStep(index));
    row.append(element("b", "", many ? miss.way || "here" : [miss.where, miss.way].filter(Boolean).join(", ")));
    if (many) row.append(element("span", "muted", miss.why));
    list.append(row);
    return row;
  });
}

function fillAdvice(content) {
  const box = document.getElementById("advice");
  box.hidden = !content.advice.length;
  for (const text of content.advice) box.querySelector("ul").append(element("li", "", text));
}
