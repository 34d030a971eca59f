"use strict";
// Joins the parts: one clock, one `seek`, and everything follows.

(() => {
  const content = JSON.parse(document.getElementById("content").textContent);
  const motion = new Motion(content);
  motion.addExecuted(content.executed);
  const root = document.documentElement;
  const slider = document.getElementById("slider");
  const now = document.getElementById("now");
  const clock = document.getElementById("clock");
  const state = { time: 0, playing: false, step: -1 };

  // ---- light and dark: the system's choice until the user chooses
  const system = matchMedia("(prefers-color-scheme: dark)");
  const setTheme = (dark) => (root.dataset.theme = dark ? "dark" : "light");
  setTheme(system.matches);

  // ---- the picture
  const watched = Boolean(content.live && content.resting); // where its unit reports the arm; no plan
  // An arm at rest: nothing is played or plotted.
  document.body.classList.toggle("resting", Boolean(content.resting));
  document.body.classList.toggle("watched", watched);
  const looked = content.looked ?? false; // a refusal of what was seen
  const boards = content.boards.length
    ? content.boards.map((board) => [board.T[3], board.T[7], board.T[11]])
    : content.cubes.filter((cube) => cube.track[0].T).map((cube) => [3, 7, 11].map((i) => cube.track[0].T[i]));
  const forward = boards.length ? boards.reduce((sum, p) => sum + p[0], 0) / boards.length : 0.4;
  let stage = null;
  try {
    stage = new Stage(document.getElementById("canvas"), [0.6 * forward, 0, 0.24]);
  } catch (error) {
    document.getElementById("legend").textContent = `No 3D picture: ${error.message}`;
  }
  const cell = stage && new Cell3D(content, motion, stage.scene);
  const trace = stage && new Trace(content, motion, stage.scene);
  if (stage) {
    stage.shown = [...cell.passed(), ...boards.map((place) => new THREE.Vector3(...place))];
    if (content.misses) stage.shown.push(...Marks.places(content));
    if (looked && cell.view) stage.shown.push(...cell.view.corners);
    stage.view("room");
  }

  // ---- the page
  fillHeading(content, motion);
  fillRefused(content, (t) => seek(t));
  if (content.refused) cell?.mark(content.refused.pair);
  const [names, labels, ghosts] = stage ? [new Names(content, cell, stage), new Labels(content, stage), new Ghosts(motion, cell)] : [];
  const seen = cell?.view ? new Seen(content.camera, cell, stage) : null;
  const marks = content.misses ? new Marks(content, cell, stage) : null;
  fillProvenance(content);
  const rows = (marks ? fillMisses : fillSteps)(content, (index) => seek(motion.steps[index].start));
  const parts = fillBar(content);
  const plots = new Plots(content, motion, (t) => seek(t));
  slider.max = motion.duration;
  let live = null;

  // Called by the user, while playing (follow), or for the arm (live: at joint positions q).
  function seek(t, follow = false, q = undefined) {
    state.time = Math.min(motion.duration, Math.max(0, t));
    if (!follow) pause();
    if (!q) live?.left();
    const index = live?.current ?? motion.stepAt(state.time);
    slider.value = state.time;
    clock.innerHTML = `${clockText(state.time)} <span>/ ${clockText(motion.duration)}</span>`;
    const clearance = watched ? null : trace ? trace.at(state.time) : clearanceAt(content, motion, state.time);
    cell?.pose(state.time, q);
    plots.at(state.time, clearance, watched ? q : undefined);
    if (watched && q && !fitted) fit();
    if (index !== state.step) enterStep(index);
    showNow(motion.steps[index], clearance);
    stage?.moved();
  }

  // Bring the arm into the picture where it is first seen.
  let fitted = false;
  function fit() {
    fitted = true;
    stage?.shown.push(...cell.joints());
    stage?.view("room");
  }

  function enterStep(index) {
    rows[state.step]?.removeAttribute("aria-current");
    state.step = index;
    const row = rows[index];
    row.setAttribute("aria-current", "true");
    // Scroll the list only, never the page.
    const list = document.getElementById("list");
    const top = row.offsetTop - list.offsetTop;
    if (top < list.scrollTop + 30 || top > list.scrollTop + list.clientHeight - 40) list.scrollTop = top - list.clientHeight / 3;
    parts.forEach((part, i) => part.classList.toggle("done", i <= index));
    marks?.show(index);
    ghosts?.at(index);
  }

  function showNow(step, clearance) {
    const role = element("span", "role");
    role.style.background = `var(--${step.role})`;
    const title = element("b");
    title.append(role, step.name);
    const facts = [];
    if (content.misses?.length > 1) facts.push(marks.miss.why);
    if (step.held) facts.push(`holds ${step.held}`);
    if (step.threaded) facts.push(`stays threaded on ${step.threaded}`);
    if (clearance && !watched) facts.push(`${clearance.sampled ? "" : "≥ "}${millimetres(clearance.mm)} ${clearance.pair.join(" – ")}`);
    else if (step.kind === "look") facts.push("the camera takes images");
    now.replaceChildren(title, element("span", "muted", facts.join(" · ")));
  }

  // ---- playing
  let before = 0;
  function tick(stamp) {
    if (!state.playing) return;
    const rate = Number(document.getElementById("rate").value);
    const passed = before ? (stamp - before) / 1e3 : 0;
    before = stamp;
    seek(state.time + rate * passed, true);
    if (state.time >= motion.duration) pause();
    else requestAnimationFrame(tick);
  }
  function play() {
    if (state.playing) return;
    live?.left();
    if (state.time >= motion.duration) seek(0);
    state.playing = true;
    before = 0;
    document.body.classList.add("playing");
    requestAnimationFrame(tick);
  }
  function pause() {
    state.playing = false;
    document.body.classList.remove("playing");
  }
  const toggle = () => (state.playing ? pause() : play());
  function stepBy(count) {
    const here = motion.steps[state.step];
    const back = count < 0 && state.time > here.start + 0.3 ? 0 : count;
    seek(motion.steps[Math.min(motion.steps.length - 1, Math.max(0, state.step + back))].start);
  }

  document.getElementById("play").addEventListener("click", toggle);
  document.getElementById("previous").addEventListener("click", () => stepBy(-1));
  document.getElementById("next").addEventListener("click", () => stepBy(1));
  slider.addEventListener("input", () => seek(Number(slider.value)));
  addEventListener("keydown", (event) => {
    if (event.target.closest?.("select, summary, input:not(#slider)") || event.ctrlKey || event.metaKey || event.altKey) return;
    const jump = event.shiftKey ? 0.1 : 1;
    const action = {
      " ": toggle,
      ArrowLeft: () => seek(state.time - jump),
      ArrowRight: () => seek(state.time + jump),
      ArrowUp: () => stepBy(-1),
      ArrowDown: () => stepBy(1),
      Home: () => seek(0),
      End: () => seek(motion.duration),
    }[event.key];
    if (!action || (event.key === " " && event.target.closest?.("button"))) return;
    event.preventDefault();
    action();
  });

  // ---- views and what is drawn
  const views = document.getElementById("views");
  if (stage) {
    for (const name of ["room", "top", "front", "side"]) views.append(button(name, () => stage.view(name)));
    const switchOn = (name, on, change) => {
      const made = button(name, () => {
        const pressed = made.getAttribute("aria-pressed") !== "true";
        made.setAttribute("aria-pressed", String(pressed));
        change(pressed);
        stage.moved();
      });
      made.setAttribute("aria-pressed", String(on));
      change(on);
      views.append(made);
    };
    if (marks || content.resting) trace.show(false);
    else switchOn("trace", true, (on) => trace.show(on));
    const known = motion.steps.some((step) => step.kind === "move" && step.clearance !== null);
    if (!marks && !content.resting) switchOn("clearance", known, (on) => {
      trace.colour(on ? "clearance" : "role");
      fillLegend(content, trace.mode);
    });
    switchOn("checked", false, (on) => cell.showChecked(on));
    if (boards.length) switchOn("labels", false, (on) => labels.show(on));
    if (!marks && !content.resting) switchOn("ghosts", false, (on) => ghosts.show(on));
    if (seen) switchOn("camera", looked, (on) => (marks ? (cell.view.visible = on) : seen.show(on)));
  }
  const showTheme = () => {
    cell?.theme(root.dataset.theme === "dark");
    stage?.theme(root.dataset.theme === "dark");
    trace?.colour(trace.mode);
  };
  document.getElementById("theme").addEventListener("click", () => {
    setTheme(root.dataset.theme !== "dark");
    showTheme();
  });
  system.addEventListener("change", (event) => {
    setTheme(event.matches);
    showTheme();
  });
  showTheme();

  // #t=12.5 opens at a time, #step=3 at a step.
  const [, key, value] = location.hash.match(/^#(t|step)=([\d.]+)$/) || [];
  const first = key === "step" ? motion.steps[Math.min(Number(value), motion.steps.length - 1)].start : Number(value ?? content.refused?.time_s ?? 0);
  seek(first);

  // ---- a running execution
  if (content.live) {
    const kept = JSON.parse(sessionStorage.getItem("a465") || "null");
    sessionStorage.removeItem("a465");
    if (kept) {
      setTheme(kept.dark);
      showTheme();
      stage?.look(kept.from, kept.at);
    }
    live = new LiveView(content, motion, {
      seek: (t, q) => seek(t, true, q),
      pause,
      ghost: (q) => {
        cell?.haunt("executed", q);
        stage?.moved();
      },
      known: (yes) => cell?.known(yes),
      changed: () => {
        plots.executedChanged();
        trace?.drawExecuted();
        stage?.draw();
      },
      leave: () => sessionStorage.setItem("a465", JSON.stringify({
        dark: root.dataset.theme === "dark",
        from: stage?.camera.position.toArray(),
        at: stage?.controls.target.toArray(),
      })),
    });
  }
  window.a465 = { content, motion, state, seek, stage, cell, trace, marks, live, names, labels, ghosts, seen };
})();
