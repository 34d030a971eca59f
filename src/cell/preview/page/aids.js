"use strict";
// Aids to look: names of bodies, labels of boards, what the camera sees, and where the step begins and ends.

// The name of the body below the pointer.
class Names {
  constructor(content, cell, stage) {
    Object.assign(this, { cell, stage, tip: document.getElementById("tip") });
    this.facts = new Map([...content.bodies, ...content.cubes, ...content.arm.bodies].map((body) => [body.name, body]));
    this.ray = new THREE.Raycaster();
    const { canvas } = stage;
    canvas.addEventListener("pointermove", (event) => (event.buttons ? this.hide() : this.show(event)));
    for (const end of ["pointerleave", "pointerdown", "wheel"]) canvas.addEventListener(end, () => this.hide(), { passive: true });
  }

  // The nearest body along a ray through a point of the canvas; walls can be looked through, and are named if nothing is behind.
  at(x, y) {
    const { width, height } = this.stage.canvas.getBoundingClientRect();
    this.ray.setFromCamera(new THREE.Vector2((2 * x) / width - 1, 1 - (2 * y) / height), this.stage.camera);
    const hits = [];
    for (const [name, object] of this.cell.named) {
      if (!object.visible) continue;
      for (const { distance, object: part } of this.ray.intersectObject(object, true)) {
        hits.push({ name, distance, through: part.material.transparent });
      }
    }
    hits.sort((a, b) => a.through - b.through || a.distance - b.distance);
    return hits[0]?.name ?? null;
  }

  show({ offsetX, offsetY }) {
    const name = this.at(offsetX, offsetY);
    this.tip.hidden = name === null;
    if (name === null) return;
    const { kind, padding } = this.facts.get(name) || {};
    const facts = [kind && !name.includes(kind) ? kind : "", padding ? `padded ${millimetres(1e3 * padding)}` : ""];
    this.tip.textContent = [name, ...facts.filter(Boolean)].join(", ");
    const { offsetLeft, offsetTop, clientWidth, clientHeight } = this.stage.canvas;
    const left = Math.min(offsetLeft + offsetX + 14, offsetLeft + clientWidth - this.tip.offsetWidth - 6);
    const top = Math.min(offsetTop + offsetY + 16, offsetTop + clientHeight - this.tip.offsetHeight - 6);
    Object.assign(this.tip.style, { left: `${Math.max(6, left)}px`, top: `${top}px` });
  }

  hide() {
    this.tip.hidden = true;
  }
}

// Names of boards and numbers of their holes, over the picture.
class Labels {
  constructor(content, stage) {
    Object.assign(this, { content, stage, svg: document.getElementById("labels"), visible: false });
    stage.over.push(() => this.draw());
  }

  show(on) {
    this.visible = on;
    this.draw();
  }

  draw() {
    const made = [];
    const inset = document.getElementById("seen");
    this.inset = inset.hidden ? null : inset.getBoundingClientRect();
    if (this.visible) {
      for (const board of this.content.boards) {
        const T = matrix(board.T);
        const [x, y] = board.plate.centre;
        const edge = y - board.plate.size[1] / 2 - 0.015; // beside the plate, where no hole is
        this.add(made, board.name, new THREE.Vector3(x, edge, 0).applyMatrix4(T), "board");
        board.holes.forEach(([hx, hy], k) => this.add(made, String(k + 1), new THREE.Vector3(hx, hy, 0).applyMatrix4(T), "hole"));
      }
    }
    this.svg.replaceChildren(...made);
  }

  add(made, text, at, kind) {
    const v = at.project(this.stage.camera);
    if (v.z > 1) return; // behind
    const { left, top, width, height } = this.svg.getBoundingClientRect();
    const [x, y] = [((v.x + 1) / 2) * width, ((1 - v.y) / 2) * height];
    const box = this.inset;
    if (box && left + x > box.left && left + x < box.right && top + y > box.top && top + y < box.bottom) return;
    made.push(shape("text", { x, y, class: kind }, text));
  }
}

// What the camera sees, in a corner of the picture, as far as a slider says below its photograph.
class Seen {
  constructor({ T, corners, photograph }, cell, stage) {
    Object.assign(this, { cell, stage, frame: document.getElementById("seen") });
    const [[x0, y0], , [x1, y1]] = corners; // at depth 1 m; y down, as in the image
    this.frame.style.aspectRatio = (x1 - x0) / (y1 - y0);
    const near = 0.05;
    this.camera = new THREE.PerspectiveCamera();
    this.camera.projectionMatrix.makePerspective(x0 * near, x1 * near, -y0 * near, -y1 * near, near, 30);
    this.camera.projectionMatrixInverse.copy(this.camera.projectionMatrix).invert();
    this.camera.matrixAutoUpdate = false;
    this.camera.matrix.copy(matrix(T)).multiply(new THREE.Matrix4().makeScale(1, -1, -1)); // three.js looks along -z, y up
    this.camera.matrixWorldNeedsUpdate = true;
    if (photograph) {
      const [image, blend] = ["photograph", "blend"].map((id) => document.getElementById(id));
      const share = blend.querySelector("input");
      const fade = () => (image.style.opacity = share.value);
      image.src = photograph;
      image.hidden = blend.hidden = false;
      share.addEventListener("input", fade);
      fade();
    }
    document.getElementById("larger").addEventListener("click", () => {
      this.frame.classList.toggle("large");
      stage.draw();
    });
    stage.over.push(() => this.draw());
  }

  show(on) {
    this.frame.hidden = !on;
    this.cell.view.visible = on;
    this.stage.draw();
  }

  draw() {
    if (this.frame.hidden) return;
    const { view } = this.cell;
    view.visible = false; // the camera does not see itself
    this.stage.inset(this.camera, this.frame);
    view.visible = true;
  }
}

// The arm where the present step begins and where it ends.
class Ghosts {
  constructor(motion, cell) {
    Object.assign(this, { motion, cell, visible: false, step: 0 });
  }

  show(on) {
    this.visible = on;
    this.at(this.step);
  }

  at(step) {
    this.step = step;
    const { start, end } = this.motion.steps[step];
    this.cell.haunt("past", this.visible ? this.motion.q(start) : null);
    this.cell.haunt("future", this.visible ? this.motion.q(end) : null);
  }
}
