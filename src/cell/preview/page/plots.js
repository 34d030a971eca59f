"use strict";
// Joint positions, velocities and accelerations against their limits, a live table of them, and clearance.

const PLOT_SAMPLES = 1400;
const QUANTITIES = [
  { name: "position", order: 0, unit: "°" },
  { name: "velocity", order: 1, unit: "°/s" },
  { name: "acceleration", order: 2, unit: "°/s²" },
];
const DEGREES = 180 / Math.PI;
const MILLIMETRES = 1e3;

class Plots {
  constructor(content, motion, onSeek) {
    Object.assign(this, { content, motion, order: 0, chosen: -1 });
    this.chart = new Chart(document.getElementById("joint-chart"), motion.duration, onSeek);
    this.clearance = new Chart(document.getElementById("clearance-chart"), motion.duration, onSeek);
    this.closest = document.getElementById("closest");
    const tabs = document.getElementById("tabs");
    for (const { name, order } of QUANTITIES) {
      const tab = button(name, () => this.show(order));
      tab.setAttribute("role", "tab");
      tabs.append(tab);
    }
    this.tabs = [...tabs.children];
    this.slides = motion.chain.map((joint) => !joint.revolute);
    this.makeReadout();
    this.show(0);
    this.drawClearance();
    if (content.executed.length || content.live) this.makeDifference(onSeek);
  }

  limits(order) {
    const { velocity, acceleration } = this.motion.joints;
    return order === 1 ? velocity : acceleration;
  }

  // How many of the displayed units, degrees or mm, a joint's unit has.
  shown(joint) {
    return this.slides[joint] ? MILLIMETRES : DEGREES;
  }

  // A value as a share of its range (position: 0 lower to 1 upper) or of its limit (-1 to 1).
  share(order, joint, value) {
    const { lower, upper } = this.motion.joints;
    return order ? value / this.limits(order)[joint] : (value - lower[joint]) / (upper[joint] - lower[joint]);
  }

  show(order) {
    this.order = order;
    this.tabs.forEach((tab, i) => tab.setAttribute("aria-selected", String(i === order)));
    const chart = this.chart;
    const { joints, duration } = this.motion;
    if (order === 0) {
      chart.clear({ low: -0.04, high: 1.04 }, [[0, "min"], [0.25, ""], [0.5, "50 %"], [0.75, ""], [1, "max"]]);
      chart.limit(0);
      chart.limit(1, "joint limits");
    } else {
      chart.clear({ low: -1.08, high: 1.08 }, [[-1, "−100"], [-0.5, "−50"], [0, "0 %"], [0.5, "50"], [1, "100"]]);
      const planned = this.content.speed ** order;
      for (const sign of [-1, 1]) {
        chart.limit(sign, sign > 0 ? "registers" : "");
        if (planned < 0.98) chart.limit(sign * planned, sign > 0 ? `planned, ${Math.round(100 * planned)} %` : "");
      }
    }
    const times = Array.from({ length: PLOT_SAMPLES + 1 }, (_, i) => (duration * i) / PLOT_SAMPLES);
    const values = times.map((t) => this.motion.q(t, order));
    this.curves = joints.names.map((_, j) =>
      chart.curve(times.map((t, i) => [t, this.share(order, j, values[i][j])]), "", JOINT_COLOURS[j % JOINT_COLOURS.length]));
    if (order === 0) this.drawExecuted();
    chart.finish();
    this.choose(this.chosen);
    const unit = QUANTITIES[order].unit;
    this.heads[1].textContent = this.slides.includes(true) ? `${unit}, ${unit.replace("°", "mm")}` : unit;
    this.heads[3].textContent = order ? "peak" : "range";
    const peaks = order ? this.motion.peaks(order) : null;
    this.rows.forEach((row, j) => {
      const limit = order ? this.limits(order)[j] * this.shown(j) : 0;
      row.peak.textContent = order
        ? `${Math.round(100 * this.share(order, j, peaks[j]))} % of ${limit.toFixed(limit < 20 ? 1 : 0)}`
        : `${signed(joints.lower[j] * this.shown(j), 0)} … ${signed(joints.upper[j] * this.shown(j), 0)}`;
    });
    this.at(this.time || 0);
  }

  drawExecuted() {
    this.executed = this.motion.executed.flatMap(({ times, q }) =>
      this.motion.joints.names.map((_, j) =>
        this.chart.curve(q.map((v, i) => [times[i], this.share(0, j, v[j])]), "executed")));
  }

  makeDifference(onSeek) {
    document.getElementById("difference").hidden = false;
    this.off = document.getElementById("off");
    this.difference = new Chart(document.getElementById("difference-chart"), this.motion.duration, onSeek);
    this.drawDifference();
  }

  // Redraw after more samples.
  executedChanged() {
    this.drawDifference();
    if (this.order !== 0) return;
    this.executed.forEach((curve) => curve.remove());
    this.drawExecuted();
    this.chart.raise();
  }

  // Executed minus planned, in degrees, joint by joint.
  drawDifference() {
    const top = Math.max(0.012, 1.1 * this.motion.farthest.degrees); // under a few counts it is rounding
    const tick = roundDown(0.9 * top);
    this.difference.clear({ low: -top, high: top }, [-tick, 0, tick].map((v) => [v, v ? `${signed(v, 4).replace(/\.?0+$/, "")}°` : "0"]));
    this.motion.joints.names.forEach((_, j) => this.motion.executed.forEach(({ times, off }) =>
      this.difference.curve(times.map((t, i) => [t, off[i][j]]), "off", JOINT_COLOURS[j % JOINT_COLOURS.length])));
    this.difference.finish();
  }

  makeReadout() {
    const table = document.getElementById("readout");
    table.innerHTML = "<thead><tr><th>joint</th><th></th><th></th><th></th></tr></thead><tbody></tbody>";
    this.heads = [...table.querySelectorAll("th")];
    this.rows = this.motion.joints.names.map((name, j) => {
      const colour = JOINT_COLOURS[j % JOINT_COLOURS.length];
      const row = table.tBodies[0].insertRow();
      const [label, value, bar, peak] = [0, 1, 2, 3].map(() => row.insertCell());
      label.innerHTML = `<span class="dot" style="background:${colour}"></span>`;
      label.append(name);
      bar.innerHTML = `<span class="range"><i style="background:${colour}"></i></span>`;
      peak.className = "muted";
      row.title = "Show this joint alone";
      row.addEventListener("click", () => this.choose(this.chosen === j ? -1 : j));
      return { row, value, knob: bar.querySelector("i"), peak };
    });
  }

  choose(joint) {
    this.chosen = joint;
    this.curves.forEach((curve, j) => curve.classList.toggle("faint", joint >= 0 && j !== joint));
    this.rows.forEach(({ row }, j) => row.classList.toggle("chosen", j === joint));
  }

  drawClearance() {
    const chart = this.clearance;
    const series = [];
    const proved = [];
    this.motion.steps.forEach((step, i) => {
      if (step.kind !== "move" || step.clearance === null) {
        proved.push([step.start, null]);
        return series.push([step.start, null]);
      }
      const samples = this.content.clearance[i];
      if (samples && samples.time.length) {
        samples.time.forEach((time, k) => series.push([step.start + time, 1e3 * samples.distance[k]]));
        proved.push(...this.motion.provedOver(step));
      } else {
        // Only the certified figures are known: draw bars.
        series.push([step.start, null], ...this.motion.provedOver(step));
      }
    });
    const known = series.map(([, mm]) => mm).filter((mm) => mm !== null);
    const top = Math.min(500, Math.max(20, ...known));
    const inside = series.map(([t, mm]) => [t, mm === null ? null : Math.min(top, Math.max(0, mm))]);
    const under = proved.map(([t, mm]) => [t, mm === null ? null : Math.min(top, Math.max(0, mm))]);
    // 5 and 10 would overlap on a long axis.
    const ticks = [0, 5, 10, 25, 50, 100, 200, 400].filter((mm) => mm <= top && (mm !== 5 || top < 60));
    chart.clear({ low: 0, high: 1.06 * top, map: Math.sqrt }, ticks.map((mm) => [mm, mm === 0 ? "0 mm" : String(mm)]));
    chart.curve(under, "proved");
    // One stroke for each run of one colour, with the colours of the trace.
    let run = [];
    let colour = "";
    const flush = () => run.length > 1 && chart.curve(run, "strong", colour);
    inside.forEach(([t, mm], i) => {
      if (mm === null) {
        flush();
        run = [];
        return;
      }
      const following = inside[i + 1];
      const here = clearanceColour(steppedClearance(following?.[1] ?? mm, mm));
      run.push([t, mm]);
      if (here !== colour && run.length > 1) {
        flush();
        run = [[t, mm]];
      }
      colour = here;
    });
    flush();
    chart.finish();
  }

  // The joints at time t, or at q; `now`: the clearance there.
  at(t, now, q = undefined) {
    this.time = t;
    this.chart.at(t);
    this.clearance.at(t);
    if (this.difference) {
      this.difference.at(t);
      const off = this.motion.offAt(t);
      const worst = off && off.reduce((best, v, j) => (Math.abs(v) > Math.abs(off[best]) ? j : best), 0);
      this.off.textContent = off ? `${this.motion.joints.names[worst]} ${signed(off[worst], 4)}°` : "no sample here";
    }
    const values = (this.order === 0 && q) || this.motion.q(t, this.order);
    const digits = this.order === 0 ? 2 : 1;
    this.rows.forEach(({ value, knob }, j) => {
      value.textContent = signed(values[j] * this.shown(j), digits);
      const share = this.share(this.order, j, values[j]);
      knob.style.left = `${100 * Math.min(1, Math.max(0, this.order ? 0.5 + share / 2 : share))}%`;
    });
    if (now !== undefined) {
      this.closest.textContent = now ? `${millimetres(now.mm)} · ${now.pair.join(" – ")}` : this.motion.steps[this.motion.stepAt(t)].kind === "move" ? "not known" : "at rest";
    }
  }
}

// With a true minus sign, and none before a zero.
function signed(value, digits) {
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text.replace("-", "−");
}

// The largest of 1, 2, 5 times a power of ten that is not above a value.
function roundDown(value) {
  const decade = 10 ** Math.floor(Math.log10(value));
  return decade * [5, 2, 1].find((n) => n * decade <= value * (1 + 1e-9));
}

// The smaller of two clearances, rounded in steps of 20 %, so that a curve has few colours and strokes.
function steppedClearance(a, b) {
  return 1.2 ** Math.round(Math.log(Math.max(0.5, Math.min(a, b))) / Math.log(1.2));
}

function millimetres(mm) {
  return `${mm.toFixed(mm < 99.95 ? 1 : 0)} mm`;
}
