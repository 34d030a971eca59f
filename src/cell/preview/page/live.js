"use strict";
// A running execution: events of the page's server, and the arm at the positions that the controller reports.

const LIVE_TEXTS = { waits: "waiting", runs: "live", pauses: "pausing, the arm still moves", stands: "paused, the arm has stopped", lost: "connection lost" };
const LIVE_SMOOTH_MS = 150; // longest interpolation from one sample to the next
const LIVE_REDRAW_MS = 500; // between two redraws of all samples
const LIVE_LINES = 200;

// Calls `on[name](value)` for every event. If the plan is not that of this page, the page is reloaded.
function followRun(mark, on) {
  const source = new EventSource("events");
  const state = { source, plan: null, state: "waits" };
  const tell = (value) => {
    state.state = value.state;
    on.state(value);
  };
  const handlers = {
    ...on,
    plan: (value) => {
      if (value.mark !== mark) {
        source.close(); // further events belong to the other plan
        on.leave?.();
        location.reload();
        return;
      }
      state.plan = value;
    },
    state: (value) => {
      if (value.state === "ended") source.close();
      tell(value);
    },
  };
  for (const [name, handle] of Object.entries(handlers)) {
    source.addEventListener(name, (event) => handle(JSON.parse(event.data)));
  }
  source.onerror = () => {
    const refused = source.readyState === EventSource.CLOSED;
    tell({ state: "lost", text: refused ? "too many pages are open: close one and reload this one" : "the arm may be moving; the last state is shown" });
  };
  return state;
}

function showState({ state, text }) {
  document.getElementById("live").dataset.state = state === "ended" && text !== "done" ? "failed" : state;
  document.getElementById("live-state").textContent = [LIVE_TEXTS[state] || state, text].filter(Boolean).join(": ");
}

function showTold(lines, anew = false) {
  const list = document.getElementById("told");
  if (anew) list.replaceChildren();
  for (const line of lines) {
    const row = document.createElement("li");
    row.textContent = line;
    list.append(row);
  }
  while (list.children.length > LIVE_LINES) list.firstChild.remove();
  list.scrollTop = list.scrollHeight;
}

class LiveView {
  // page: {seek(t, q), pause(), ghost(q), changed(), leave()}: callbacks of the page.
  constructor(content, motion, page) {
    Object.assign(this, { motion, page, step: null, sample: null, shown: null });
    this.button = document.getElementById("follow");
    this.facts = document.getElementById("live-facts");
    for (const part of [document.getElementById("live"), document.getElementById("messages"), this.button]) part.hidden = false;
    this.button.addEventListener("click", () => this.follow());
    this.setFollowing(true);
    this.run = followRun(content.live, {
      past: (value) => this.past(value),
      told: ({ lines }) => showTold(lines),
      step: (value) => this.enter(value),
      sample: (value) => this.take(value),
      state: showState,
      leave: () => page.leave(),
    });
  }

  // Index of the present step, while the page follows it.
  get current() {
    return this.following && this.step ? this.step.index : null;
  }

  past({ lines, samples }) {
    showTold(lines, true);
    this.motion.addExecuted([]);
    samples.forEach((sample) => this.add(sample));
    this.redraw();
    if (samples.length) this.show();
  }

  enter(step) {
    this.step = step;
    // A move is placed by its samples, which come later; other steps have none.
    if (step.t !== null && (!this.sample || this.motion.steps[step.index].kind !== "move")) this.place = step.t;
    this.show();
  }

  take(sample) {
    this.add(sample);
    this.redrawSoon();
    this.show();
  }

  add(sample) {
    const q = this.motion.positions(sample.counts);
    this.sample = { ...sample, q };
    if (sample.t === null) return;
    this.place = sample.t;
    this.off = this.motion.addSample(sample.motion, sample.t, q);
  }

  // The user has left the present time: show the plan there, and the arm's position as a ghost.
  left() {
    if (!this.following) return;
    this.setFollowing(false);
    this.show();
  }

  follow() {
    this.page.pause();
    this.setFollowing(true);
    this.page.ghost(null);
    this.show();
  }

  setFollowing(following) {
    this.following = following;
    this.button.setAttribute("aria-pressed", String(following));
    document.body.classList.toggle("following", following);
  }

  // Animate from the picture's position to the latest sample.
  show() {
    const now = performance.now();
    this.from = this.shown;
    this.span = Math.max(1, Math.min(LIVE_SMOOTH_MS, now - (this.arrived || 0)));
    this.arrived = now;
    this.showFacts();
    if (!this.frame) this.frame = requestAnimationFrame(() => this.draw());
  }

  draw() {
    this.frame = 0;
    const t = this.place ?? 0;
    const to = { t, q: this.sample ? this.sample.q : this.motion.q(t) };
    const share = this.from ? Math.min(1, (performance.now() - this.arrived) / this.span) : 1;
    const mix = (a, b) => a + share * (b - a);
    this.shown = share < 1 ? { t: mix(this.from.t, to.t), q: to.q.map((v, j) => mix(this.from.q[j], v)) } : to;
    if (this.following) this.page.seek(this.shown.t, this.shown.q);
    else this.page.ghost(this.shown.q);
    if (share < 1) this.frame = requestAnimationFrame(() => this.draw());
  }

  showFacts() {
    const sample = this.sample;
    const facts = [];
    if (this.step) facts.push(this.step.name);
    if (this.off) {
      const worst = this.off.reduce((best, v, j) => (Math.abs(v) > Math.abs(this.off[best]) ? j : best), 0);
      facts.push(`${Math.abs(this.off[worst]).toFixed(3)}° off the plan (${this.motion.joints.names[worst]})`);
    }
    if (sample && sample.override < 1) facts.push(`speed ${Math.round(100 * sample.override)} %`);
    if (sample && sample.jaws !== null) facts.push(`jaws ${Math.round(100 * sample.jaws)} % closed`);
    this.facts.textContent = facts.join(" · ");
  }

  redrawSoon() {
    this.timer ??= setTimeout(() => this.redraw(), LIVE_REDRAW_MS);
  }

  redraw() {
    clearTimeout(this.timer);
    this.timer = null;
    this.page.changed();
  }
}
