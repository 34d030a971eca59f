"use strict";
// The motion as sent: polynomial segments in encoder counts on one clock, and the arm's kinematics.

class Motion {
  constructor(content) {
    this.joints = content.joints;
    this.steps = content.steps;
    this.duration = content.duration_s;
    this.chain = content.arm.chain.map((joint) => ({
      T: matrix(joint.T),
      axis: new THREE.Vector3(...joint.axis),
      revolute: joint.revolute,
    }));
    this.T_end_tool = matrix(content.arm.T_end_tool);
    let at = content.steps.find((step) => step.kind === "move").counts;
    for (const step of this.steps) {
      if (step.kind === "move") {
        step.ends = [];
        step.knots = [step.counts];
        let time = step.start;
        for (const [ms, ...rows] of step.segments) {
          const knot = step.knots[step.knots.length - 1];
          step.ends.push((time += ms / 1e3));
          step.knots.push(knot.map((c, j) => rows.reduce((sum, row) => sum + row[j], c)));
        }
        at = step.knots[step.knots.length - 1];
      } else {
        step.counts = at;
      }
    }
  }

  // Index of the step at time t; of two, the later one.
  stepAt(t) {
    let low = 0;
    let high = this.steps.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.steps[middle].start <= t + 1e-9) low = middle;
      else high = middle - 1;
    }
    return low;
  }

  // Index of a move's segment at time t; of two, the later one.
  segmentAt(step, t) {
    const index = step.ends.findIndex((end) => t < end);
    return index < 0 ? step.ends.length - 1 : index;
  }

  // Certified clearance in m at time t: of the segment if the plan has it, otherwise of the whole move.
  proved(t) {
    const step = this.steps[this.stepAt(t)];
    if (step.kind !== "move") return null;
    return step.clearances.length ? step.clearances[this.segmentAt(step, t)] : step.clearance;
  }

  // The same over a whole move, in mm: [[t, mm], ..], constant over each segment.
  provedOver(step) {
    const bounds = step.clearances.length ? step.clearances : [step.clearance];
    const ends = step.clearances.length ? step.ends : [step.end];
    return bounds.flatMap((c, i) => [[i ? ends[i - 1] : step.start, 1e3 * c], [ends[i], 1e3 * c]]);
  }

  // Encoder counts (order 0) or their derivatives by time, at time t.
  counts(t, order = 0) {
    const step = this.steps[this.stepAt(t)];
    const still = step.counts.map((c) => (order ? 0 : c));
    if (step.kind !== "move" || !step.segments.length) return still;
    const index = this.segmentAt(step, t);
    const [ms, ...rows] = step.segments[index];
    const seconds = ms / 1e3;
    if (!seconds) return order ? still : step.knots[index + 1];
    const u = Math.min(1, Math.max(0, (t - step.ends[index] + seconds) / seconds));
    return step.knots[index].map((start, j) => {
      let value = order ? 0 : start;
      rows.forEach((row, k) => {
        let factor = 1;
        for (let d = 0; d < order; d++) factor *= k + 1 - d;
        if (k + 1 >= order) value += row[j] * factor * u ** (k + 1 - order);
      });
      return value / seconds ** order;
    });
  }

  // Joint positions (rad) or their derivatives.
  q(t, order = 0) {
    return this.positions(this.counts(t, order), order);
  }

  positions(counts, order = 0) {
    const { counts_per_rad: scale, counts_at_zero: zero } = this.joints;
    return counts.map((c, j) => (c - (order ? 0 : zero[j])) / scale[j]);
  }

  // How far the jaws are closed, 0 to 1.
  jaws(t) {
    const step = this.steps[this.stepAt(t)];
    const share = Math.min(1, Math.max(0, (t - step.start) / (step.end - step.start || 1)));
    const eased = share * share * (3 - 2 * share);
    return step.jaws[0] + (step.jaws[1] - step.jaws[0]) * eased;
  }

  // Pose of each joint's frame in the one before it.
  jointMatrix(index, q, into) {
    const { T, axis, revolute } = this.chain[index];
    const motion = new THREE.Matrix4();
    if (revolute) motion.makeRotationAxis(axis, q);
    else motion.makeTranslation(axis.x * q, axis.y * q, axis.z * q);
    return into.multiplyMatrices(T, motion);
  }

  // Pose of the tool in the base frame for joint positions q.
  toolPose(q) {
    const pose = new THREE.Matrix4();
    const step = new THREE.Matrix4();
    q.forEach((value, i) => pose.multiply(this.jointMatrix(i, value, step)));
    return pose.multiply(this.T_end_tool);
  }

  // Executed motion: joint positions on the plan's clock, and their deviation from the plan.
  addExecuted(executed) {
    this.farthest = { degrees: 0, joint: 0 };
    this.executed = executed.map(({ step, time, counts }) => {
      const times = time.map((t) => this.steps[step].start + t);
      const q = counts.map((c) => this.positions(c));
      const off = q.map((v, i) => this.offPlan(times[i], v));
      return { times, q, off };
    });
  }

  // Add a sample of the motion that begins with step `first`, at time t of the plan. Return its deviation.
  addSample(first, t, q) {
    let run = this.executed[this.executed.length - 1];
    if (!run || run.first !== first) this.executed.push((run = { first, times: [], q: [], off: [] }));
    const off = this.offPlan(t, q);
    run.times.push(t);
    run.q.push(q);
    run.off.push(off);
    return off;
  }

  // Joint positions minus the plan's at time t, in degrees; `farthest` keeps the largest.
  offPlan(t, q) {
    const planned = this.q(Math.min(t, this.duration));
    return q.map((value, joint) => {
      const degrees = ((value - planned[joint]) * 180) / Math.PI;
      if (Math.abs(degrees) > this.farthest.degrees) this.farthest = { degrees: Math.abs(degrees), joint };
      return degrees;
    });
  }

  // Deviation, in degrees, of the executed sample nearest to time t; null if none is within a second.
  offAt(t) {
    let best = null;
    for (const { times, off } of this.executed) {
      times.forEach((time, i) => {
        if (Math.abs(time - t) < (best ? Math.abs(best.time - t) : 1)) best = { time, off: off[i] };
      });
    }
    return best && best.off;
  }

  // Largest |derivative| of every joint over the whole plan, from five samples of each segment.
  peaks(order) {
    const peak = this.joints.names.map(() => 0);
    for (const step of this.steps) {
      if (step.kind !== "move") continue;
      step.segments.forEach(([ms], i) => {
        for (let k = 0; k <= 4; k++) {
          const t = step.ends[i] - (ms / 1e3) * (1 - k / 4) - (k === 4 ? 1e-6 : 0);
          this.q(t, order).forEach((v, j) => (peak[j] = Math.max(peak[j], Math.abs(v))));
        }
      });
    }
    return peak;
  }
}

// A 4x4 from the twelve numbers of its upper rows.
function matrix(rows) {
  return new THREE.Matrix4().set(...rows, 0, 0, 0, 1);
}
