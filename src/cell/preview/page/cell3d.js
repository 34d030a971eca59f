"use strict";
// The cell: static bodies, the arm, the cubes. `pose(t)` moves everything to its position at time t.

const STILL = {
  table: { colour: "#e2e2e0", dark: "#3d444c", roughness: 0.85, rounding: 0.006 },
  board: { colour: "#d8c29a", roughness: 0.72, rounding: 0.003 },
  stand: { colour: "#a3a9af", roughness: 0.75, rounding: 0.004 },
  wall: { colour: "#aab4bd", roughness: 0.6, rounding: 0.004, opacity: 0.32 },
  post: { colour: "#aab4bd", roughness: 0.6, rounding: 0.004, opacity: 0.32 },
  zone: { colour: "#d08a3a", roughness: 1, rounding: 0.001, opacity: 0.1 },
};

const LOOKED_AT = 60; // samples of the plan, to fit the view

class Cell3D {
  constructor(content, motion, scene) {
    this.named = new Map();
    this.ghosts = {};
    this.content = content;
    this.motion = motion;
    this.scene = scene;
    this.addStill(content);
    this.addArm(content.arm);
    this.cubes = content.cubes.map((cube, i) => {
      const [x] = cube.shape.box || [0.04];
      const body = mesh(bodyGeometry(cube.shape, 0.07 * x), standardMaterial(CUBE_COLOURS[i % CUBE_COLOURS.length], 0.5));
      scene.add(body);
      this.named.set(cube.name, body);
      return { mesh: body, track: cube.track.map((p) => ({ start: p.start, held: p.held, T: p.T && matrix(p.T) })) };
    });
    if (content.camera) scene.add((this.view = cameraView(content.camera)));
    scene.add((this.triad = triad(0.05)));
  }

  addStill(content) {
    this.themed = [];
    this.bodies = [];
    const drawn = new Set(content.boards.map((board) => board.body));
    for (const body of content.bodies) {
      if (drawn.has(body.name)) continue;
      const look = STILL[body.kind] || STILL.stand;
      const material = standardMaterial(look.colour, look.roughness);
      const made = mesh(bodyGeometry(body.shape, look.rounding), material, matrix(body.T));
      if (look.opacity) {
        Object.assign(material, { transparent: true, opacity: look.opacity, depthWrite: false });
        made.castShadow = made.receiveShadow = false;
      }
      this.scene.add(made);
      this.bodies.push(made);
      this.named.set(body.name, made);
      if (look.dark) this.themed.push({ material, look });
      if (body.kind === "table" && body.shape.box) this.scene.add(tableGrid(body));
    }
    this.boards = content.boards.map(boardGroup);
    if (this.boards.length) this.scene.add(...this.boards);
    content.boards.forEach((board, i) => this.named.set(board.body, this.boards[i]));
  }

  addArm(arm) {
    const shell = standardMaterial("#f1ede5", 0.38);
    const cover = standardMaterial("#4a525b", 0.42);
    const tool = standardMaterial("#a3abb2", 0.35, 0.1);
    const finger = standardMaterial("#4a5158", 0.5);
    this.frames = this.addFrames();
    this.jaws = [];
    const seen = new Set();
    for (const body of arm.bodies) {
      const last = body.joint === this.motion.chain.length;
      const moves = body.open.some((v, i) => v !== body.holding[i]);
      let material = shell;
      if (moves) material = finger;
      else if (last && seen.has(body.joint)) material = tool;
      else if (last || body.shape.sphere || seen.has(body.joint)) material = cover;
      seen.add(body.joint);
      const open = matrix(body.open);
      const made = mesh(bodyGeometry(body.shape, moves ? 0.002 : 0.02), material, open);
      this.frames[body.joint].add(made);
      this.named.set(body.name, made);
      if (moves) this.jaws.push({ name: body.name, mesh: made, open, holding: matrix(body.holding) });
    }
  }

  // Every body as checked for collisions, with its padding, as a shell around the drawn body.
  showChecked(on) {
    if (on && !this.checked) this.checked = this.shells();
    for (const shell of this.checked || []) shell.visible = on;
  }

  shells() {
    const { arm, bodies, cubes } = this.content;
    const material = standardMaterial("#c2410c", 0.9);
    Object.assign(material, { transparent: true, opacity: 0.24, depthWrite: false });
    const shell = (body, pose, parent) => {
      const made = mesh(checkedGeometry(body.shape, body.padding), material, pose);
      made.castShadow = made.receiveShadow = false;
      parent.add(made);
      return made;
    };
    const moving = arm.bodies.map((body) => {
      const jaw = this.jaws.find(({ name }) => name === body.name);
      return jaw ? shell(body, undefined, jaw.mesh) : shell(body, matrix(body.open), this.frames[body.joint]);
    });
    const still = bodies.filter((body) => body.kind !== "zone").map((body) => shell(body, matrix(body.T), this.scene));
    return [...moving, ...still, ...cubes.map((cube, i) => shell(cube, undefined, this.cubes[i].mesh))];
  }

  // Bodies in red: those that are too close. What was red before gets its own colours again.
  mark(names, opacity = [1, 1]) {
    for (const [part, material, shadowed, ...shells] of this.marked || []) {
      Object.assign(part, { material, receiveShadow: shadowed });
      part.remove(...shells);
    }
    this.marked = [];
    const still = new Set(this.content.bodies.map((body) => body.name));
    names.forEach((name, i) => {
      const [red, through] = [1, 2].map(() => standardMaterial(styleColour("warn"), 0.5));
      Object.assign(red, { transparent: opacity[i] < 1, opacity: opacity[i] });
      Object.assign(through, { transparent: true, opacity: 0.3, depthTest: false, depthWrite: false });
      const parts = [];
      this.named.get(name)?.traverse((part) => part.isMesh && parts.push(part));
      for (const part of parts) {
        // a part of the arm may be behind or inside others
        const shells = still.has(name) ? [] : [Object.assign(new THREE.Mesh(part.geometry, through), { renderOrder: 2 })];
        this.marked.push([part, part.material, part.receiveShadow, ...shells]);
        part.material = red;
        if (red.transparent) part.receiveShadow = false; // as walls, whose shader there is already
        if (shells.length) part.add(...shells);
      }
    });
  }

  // Whether it is known where the arm is; else it is not drawn.
  known(yes) {
    this.frames[0].visible = this.triad.visible = yes;
  }

  theme(dark) {
    for (const { material, look } of this.themed) material.color.set(dark ? look.dark : look.colour);
  }

  // A frame for the base and for each joint, each a child of the one before.
  addFrames() {
    const frames = Array.from({ length: this.motion.chain.length + 1 }, () => new THREE.Group());
    frames.forEach((frame, i) => {
      frame.matrixAutoUpdate = false;
      (i ? frames[i - 1] : this.scene).add(frame);
    });
    return frames;
  }

  bend(frames, q) {
    q.forEach((value, i) => {
      this.motion.jointMatrix(i, value, frames[i + 1].matrix);
      frames[i + 1].matrixWorldNeedsUpdate = true;
    });
  }

  // Positions of the base and the joints.
  joints() {
    this.frames[0].updateMatrixWorld(true);
    return this.frames.map((frame) => new THREE.Vector3().setFromMatrixPosition(frame.matrixWorld));
  }

  // Positions of joints and finger tips during the plan, and of the base.
  passed() {
    const points = [];
    for (let i = 0; i <= LOOKED_AT; i++) {
      const q = this.motion.q((i / LOOKED_AT) * this.motion.duration);
      this.bend(this.frames, q);
      points.push(...this.joints());
      points.push(new THREE.Vector3().setFromMatrixPosition(this.motion.toolPose(q)));
    }
    return points;
  }

  // Another arm, as a ghost of one colour of the style at joint positions q; null hides it.
  haunt(colour, q) {
    if (q && !this.ghosts[colour]) {
      const ghost = (this.ghosts[colour] = this.addFrames());
      const material = standardMaterial(styleColour(colour), 0.6);
      // Drawn behind the arm where both coincide.
      Object.assign(material, { transparent: true, opacity: 0.45, depthWrite: false, polygonOffset: true,
        polygonOffsetFactor: 2, polygonOffsetUnits: 2 });
      for (const body of this.content.arm.bodies.filter(({ joint }) => joint > 0)) {
        const made = mesh(bodyGeometry(body.shape, 0.02), material, matrix(body.open));
        made.castShadow = made.receiveShadow = false;
        ghost[body.joint].add(made);
      }
    }
    const ghost = this.ghosts[colour];
    if (ghost) ghost[0].visible = Boolean(q);
    if (q) this.bend(ghost, q);
  }

  // Move everything to time t; the arm to joint positions q if given.
  pose(t, q = this.motion.q(t)) {
    this.bend(this.frames, q);
    const closed = this.motion.jaws(t);
    for (const jaw of this.jaws) {
      const between = jaw.open.clone();
      jaw.holding.elements.forEach((v, i) => (between.elements[i] += closed * (v - between.elements[i])));
      place(jaw.mesh, between);
    }
    const T_base_tool = this.motion.toolPose(q);
    for (const cube of this.cubes) {
      const now = cube.track.filter((p) => p.start <= t + 1e-9).pop();
      cube.mesh.visible = Boolean(now?.T); // the next part comes when the one before is put down
      if (now?.T) place(cube.mesh, now.held ? T_base_tool.clone().multiply(now.T) : now.T);
    }
    place(this.triad, T_base_tool);
    return T_base_tool;
  }
}

// Lines every 100 mm of the base frame on the table's top.
function tableGrid(body) {
  const [x, y, z] = body.shape.box;
  const [cx, cy, top] = [body.T[3], body.T[7], body.T[11] + z / 2 + 3e-4];
  const edge = 0.012;
  const [x0, x1, y0, y1] = [cx - x / 2 + edge, cx + x / 2 - edge, cy - y / 2 + edge, cy + y / 2 - edge];
  const points = [];
  for (let i = Math.ceil(x0 * 10); i <= x1 * 10; i++) points.push(i / 10, y0, top, i / 10, y1, top);
  for (let i = Math.ceil(y0 * 10); i <= y1 * 10; i++) points.push(x0, i / 10, top, x1, i / 10, top);
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points), 3));
  return new THREE.LineSegments(geometry,
    new THREE.LineBasicMaterial({ color: "#80868c", transparent: true, opacity: 0.35, depthWrite: false }));
}

// The camera as a small housing; its field of view as four edges to the table and a frame there.
function cameraView(camera) {
  const group = new THREE.Group();
  const T = matrix(camera.T);
  const eye = new THREE.Vector3().setFromMatrixPosition(T);
  const corners = camera.corners.map((c) => {
    const far = new THREE.Vector3(...c).applyMatrix4(T);
    const share = far.z < eye.z - 1e-6 ? eye.z / (eye.z - far.z) : 1;
    return eye.clone().lerp(far, share);
  });
  const points = [];
  corners.forEach((corner, i) => {
    points.push(...eye.toArray(), ...corner.toArray(), ...corner.toArray(), ...corners[(i + 1) % 4].toArray());
  });
  group.add(thickSegments(points, styleColour("accent"), 1.3, 0.55));
  [group.corner] = group.corners = corners;
  const housing = mesh(roundedBox([0.05, 0.05, 0.08], 0.006), standardMaterial("#30363c", 0.5, 0.3));
  const lens = mesh(roundedCylinder(0.019, 0.04, 0.004).translate(0, 0, 0.055), standardMaterial("#15181b", 0.3, 0.4));
  const body = new THREE.Group();
  body.add(housing, lens);
  place(body, T);
  group.add(body);
  return group;
}

// The tool's axes: x red, y green, z blue.
function triad(length) {
  const group = new THREE.Group();
  [[1, 0, 0, "#d9503f"], [0, 1, 0, "#3a9d62"], [0, 0, 1, "#2f7fc4"]].forEach(([x, y, z, colour]) => {
    group.add(thickSegments([0, 0, 0, x * length, y * length, z * length], colour, 3));
  });
  return group;
}

function thickSegments(points, colour, width, opacity = 1) {
  const geometry = new THREE.LineSegmentsGeometry().setPositions(points);
  const material = new THREE.LineMaterial({ color: colour, linewidth: width, transparent: opacity < 1, opacity });
  return new THREE.LineSegments2(geometry, material);
}
