"use strict";
// A running execution: the state that the page's server is polled for, and the arm at the positions that the
// controller reports.

const LIVE_TEXTS = { waits: "waiting", runs: "live", pauses: "pausing, the arm still moves", stands: "paused, the arm has stopped", lost: "connection lost" };
const LIVE_SMOOTH_MS = 150; // longest interpolation from one sample to the next
const LIVE_REDRAW_MS = 500; // between two redraws of all samples
const LIVE_AGAIN_MS = 1000; // after a failed request
const LIVE_LINES = 200;

// Calls on.news(state) for every answer, and on.state for what is shown of it. If the plan, or the run, is not that of
// this page, the page is reloaded.
function followRun(mark, on) {
  const run = { id: null, version: 0, plan: null, state: "waits" };
  const show = (shown) => {
    run.state = shown.state;
    on.state(shown);
  };
  const ask = async () => {
    const answer = await fetch(`state?after=${run.version}`);
    if (!answer.ok) throw new Error(answer.statusText);
    return answer.json();
  };
  (async () => {
    while (run.state !== "ended") {
      const now = await ask().catch(() => null);
      if (!now) {
        show({ state: "lost", text: "the arm may be moving; the last state is shown" });
        await new Promise((done) => setTimeout(done, LIVE_AGAIN_MS));
        continue;
      }
      run.id ??= now.run;
      if (now.run !== run.id || (now.plan?.mark ?? null) !== mark) {
        on.leave?.();
        location.reload();
        return;
      }
      Object.assign(run, { version: now.version, plan: now.plan });
      on.news(now);
      show(now);
    }
  })();
  return run;
}

function showState({ state, text }) {
  document.getElementById("live").dataset.state = state === "ended" && text !== "done" ? "failed" : state;
  document.getElementById("live-state").textContent = [LIVE_TEXTS[state] || state, text].filter(Boolean).join(": ");
}

function showTold(lines) {
  const list = document.getElementById("told");
  for (const line of lines) {
    const row = document.createElement("li");
    row.textContent = line;
    list.append(row);
  }
  while (list.children.length > LIVE_LINES) list.firstChild.remove();
  list.scrollTop = list.scrollHeight;
}

class LiveView {
  // page: {seek(t, q), pause(), ghost(q), known(yes), changed(), leave()}: callbacks of the page.
  constructor(content, motion, page) {
    Object.assign(this, { motion, page, step: null, sample: null, shown: null });
    this.button = document.getElementById("follow");
    this.facts = document.getElementById("live-facts");
    for (const part of [document.getElementById("live"), document.getElementById("messages"), this.button]) part.hidden = false;
    this.button.addEventListener("click", () => this.follow());
    this.setFollowing(true);
    this.motion.addExecuted([]);
    this.run = followRun(content.live, {
      news: (value) => this.take(value),
      state: showState,
      leave: () => page.leave(),
    });
  }

  // Index of the present step, while the page follows it.
  get current() {
    return this.following && this.step ? this.step.index : null;
  }

  take({ lines, samples, step }) {
    showTold(lines);
    samples.forEach((sample) => this.add(sample));
    // A move is placed by its samples; other steps have none, and come after those of the move before.
    const entered = step && (step.index !== this.step?.index || step.name !== this.step.name);
    if (entered && step.t !== null && (!this.sample || this.motion.steps[step.index].kind !== "move")) this.place = step.t;
    this.step = step;
    if (samples.length) this.redrawSoon();
    if (samples.length || entered) this.show();
  }

  add(sample) {
    const q = sample.counts && this.motion.positions(sample.counts);
    this.sample = { ...sample, q };
    this.page.known(Boolean(q));
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
    const to = { t, q: this.sample?.q ?? this.motion.q(t) };
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
    if (sample?.facts) facts.push(sample.facts);
    else if (this.step) facts.push(this.step.name);
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
