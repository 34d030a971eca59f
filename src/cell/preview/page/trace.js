"use strict";
// The tool's path, coloured by role or by clearance; the executed path over it; the closest pair at the cursor.

const TRACE_STEP_S = 0.05;

// Clearance in mm at time t, with the pair and, if sampled, its nearest points.
function clearanceAt(content, motion, t) {
  const index = motion.stepAt(t);
  const step = motion.steps[index];
  if (step.kind !== "move") return null;
  if (step.clearance === null) return null;
  const samples = content.clearance[index];
  if (!samples || !samples.time.length) return { mm: 1e3 * motion.proved(t), pair: step.closest, points: null, sampled: false };
  let k = samples.time.findIndex((time) => time >= t - step.start);
  if (k < 0) k = samples.time.length - 1;
  if (k > 0 && t - step.start - samples.time[k - 1] < samples.time[k] - (t - step.start)) k -= 1;
  return {
    mm: 1e3 * samples.distance[k],
    pair: samples.pairs[k].map((i) => samples.names[i]),
    points: samples.points[k],
    sampled: true,
  };
}

class Trace {
  constructor(content, motion, scene) {
    Object.assign(this, { content, motion, scene, mode: "role" });
    this.times = [];
    const points = [];
    for (const step of motion.steps) {
      if (step.kind !== "move") continue;
      const count = Math.max(1, Math.ceil((step.end - step.start) / TRACE_STEP_S));
      for (let i = 0; i <= count; i++) {
        // Just inside the step, so that every point has its own step's colour.
        const t = step.start + ((step.end - step.start - 1e-6) * i) / count;
        this.times.push(t);
        points.push(...position(motion.toolPose(motion.q(t))));
      }
    }
    this.points = points;
    this.ahead = this.line(1.8, 0.5);
    this.done = this.line(3.2, 1);
    this.drawExecuted();
    this.closest = thickSegments([0, 0, 0, 0, 0, 0], CLEARANCE_RAMP[0][1], 3);
    this.closest.material.depthTest = false;
    this.closest.visible = false;
    scene.add(this.closest);
    this.colour("role");
  }

  clearance(t) {
    return clearanceAt(this.content, this.motion, t);
  }

  line(width, opacity) {
    const material = new THREE.LineMaterial({ linewidth: width, vertexColors: true, transparent: opacity < 1, opacity });
    const made = new THREE.Line2(new THREE.LineGeometry().setPositions(this.points), material);
    made.frustumCulled = false;
    this.scene.add(made);
    return made;
  }

  // mode: role or clearance
  colour(mode) {
    this.mode = mode;
    const roles = Object.fromEntries(ROLES.map((role) => [role, styleColour(role)]));
    const found = new Map();
    const colours = [];
    for (const t of this.times) {
      const hex = mode === "role"
        ? roles[this.motion.steps[this.motion.stepAt(t)].role]
        : clearanceColour((this.clearance(t) || { mm: NaN }).mm);
      if (!found.has(hex)) found.set(hex, new THREE.Color(hex).toArray());
      colours.push(...found.get(hex));
    }
    for (const line of [this.ahead, this.done]) line.geometry.setColors(colours);
    this.done.geometry.instanceCount = this.shown || 0;
  }

  // Redraw, as there may be more samples.
  drawExecuted() {
    const { executed: old, motion } = this;
    if (old) {
      this.scene.remove(old);
      old.geometry.dispose();
      old.material.dispose();
    }
    this.executed = motion.executed.some(({ q }) => q.length > 1) ? executedLine(motion) : null;
    if (!this.executed) return;
    this.executed.visible = this.ahead.visible;
    this.scene.add(this.executed);
  }

  show(visible) {
    for (const line of [this.ahead, this.done, this.executed]) if (line) line.visible = visible;
  }

  at(t) {
    let passed = this.times.findIndex((time) => time > t);
    if (passed < 0) passed = this.times.length;
    this.shown = Math.max(0, passed - 1);
    this.done.geometry.instanceCount = this.shown;
    const now = this.clearance(t);
    this.closest.visible = Boolean(now && now.points);
    if (this.closest.visible) {
      this.closest.geometry.setPositions(now.points);
      this.closest.material.color.set(clearanceColour(now.mm));
    }
    return now;
  }
}

function position(pose) {
  return [pose.elements[12], pose.elements[13], pose.elements[14]];
}

function executedLine(motion) {
  const points = [];
  for (const { q } of motion.executed) {
    const path = q.map((v) => position(motion.toolPose(v)));
    for (let i = 1; i < path.length; i++) points.push(...path[i - 1], ...path[i]);
  }
  const made = thickSegments(points, styleColour("executed"), 1.6);
  // It mostly coincides with the planned line, and is drawn over it.
  Object.assign(made.material, { polygonOffset: true, polygonOffsetFactor: -4, polygonOffsetUnits: -4, transparent: true });
  made.renderOrder = 1;
  return made;
}
