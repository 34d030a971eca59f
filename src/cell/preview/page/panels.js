"use strict";
// The page around the picture: heading, list of steps, time bar, legend, provenance.

function element(tag, className = "", text = "") {
  const made = document.createElement(tag);
  made.className = className;
  made.textContent = text;
  return made;
}

function button(text, onClick) {
  const made = element("button", "", text);
  made.type = "button";
  made.addEventListener("click", onClick);
  return made;
}

function fillHeading(content, motion) {
  const title = content.task.name || content.task.kind || content.task.task || "plan";
  document.title = `${title} · a465 plan ${content.sha256.slice(0, 8)}`;
  document.getElementById("title").textContent = title;
  const cubes = (content.task.cubes || content.task.transfers || content.cubes).length;
  const moves = content.steps.filter((step) => step.kind === "move");
  const known = content.live && content.resting ? [] : moves.map((step) => step.clearance).filter((c) => c !== null);
  const erring = moves.map((step) => step.clearance_with_errors).filter((c) => c !== null);
  document.getElementById("summary").textContent = [
    content.unit === "none" ? `${motion.chain.length} joints, no unit` : content.unit,
    cubes ? `${cubes} cube${cubes === 1 ? "" : "s"}` : "",
    content.misses ? "there is no plan" : "",
    content.misses ? "" : content.resting ? content.steps[0].name : `${moves.length} move${moves.length === 1 ? "" : "s"} in ${content.motions} motion${content.motions === 1 ? "" : "s"}, ${clockText(content.motion_s)} of motion at speed ${content.speed}`,
    content.misses ? armShape(content.arm) : "",
    known.length ? `least clearance ${millimetres(1e3 * Math.min(...known))} (${armShape(content.arm)})` : "",
    erring.length ? `${millimetres(1e3 * Math.min(...erring))} with the arm's errors` : "",
    content.less_clearance,
    content.executed.length ? `executed within ${motion.farthest.degrees.toFixed(3)}° of the plan` : "",
  ].filter(Boolean).join(" · ");
  const code = document.getElementById("code");
  code.hidden = content.code === null;
  code.innerHTML = `code <b>${content.code}</b>`;
  code.addEventListener("click", async () => {
    const copied = await navigator.clipboard?.writeText(content.code).then(() => true, () => false);
    code.title = copied ? "Copied" : content.code;
    code.classList.toggle("copied", Boolean(copied));
  });
}

// Why the motion is refused; a click goes back to that moment.
function fillRefused(content, seek) {
  const { refused, what } = content;
  const line = document.getElementById("refused");
  line.hidden = !refused && !what;
  if (what) line.append(element("b", "", "refused"), ` ${what}`);
  if (!refused) return;
  line.append(element("b", "", "refused"), ` ${refused.what} `, button("show", () => seek(refused.time_s)));
}

// The arm's shape for which clearances hold: assumed bodies with padded links, or without padding.
function armShape(arm) {
  const most = Math.max(0, ...arm.bodies.map((body) => body.padding));
  return most > 0 ? `assumed arm, links padded ${millimetres(1e3 * most)}` : "arm not padded";
}

// Steps grouped by cube. A step without a cube joins the group after it, the last looks that before.
function stepGroups(content) {
  const groups = [];
  content.steps.forEach((step, index) => {
    const last = groups[groups.length - 1];
    if (last && (step.cube === null || last.cube === step.cube)) last.indices.push(index);
    else if (last && last.cube === null) Object.assign(last, { cube: step.cube }).indices.push(index);
    else groups.push({ cube: step.cube, indices: [index] });
  });
  return groups;
}

// The task's entry of a cube: {cube, from, to}.
function taskEntry(content, cube) {
  return (content.task.cubes || content.task.transfers || [])[cube] || {};
}

function groupTitle(content, cube) {
  const entry = taskEntry(content, cube);
  const name = entry.cube || content.cubes[cube]?.name || `cube ${cube + 1}`;
  if (!entry.from || !entry.to) return name;
  return name.endsWith(entry.from) ? `${name} → ${entry.to}` : `${name}   ${entry.from} → ${entry.to}`;
}

// The cube's index in the scene determines its colour, in the list and in the picture.
function cubeColour(content, cube) {
  const index = content.cubes.findIndex((c) => c.name === taskEntry(content, cube).cube);
  return CUBE_COLOURS[(index < 0 ? cube : index) % CUBE_COLOURS.length];
}

// A step's name without the cube, which the group's title has.
function shortName(step, entry) {
  const [before, after] = step.name.split(/: (.*)/s);
  return after && (before === entry.cube || /^cube \d+$/.test(before)) ? after : step.name;
}

function fillSteps(content, onStep) {
  const list = document.getElementById("list");
  const buttons = [];
  for (const { cube, indices } of stepGroups(content)) {
    const head = element("h3");
    if (cube !== null) {
      const swatch = element("i");
      swatch.style.background = cubeColour(content, cube);
      head.append(swatch);
    }
    head.append(cube === null ? "the task" : groupTitle(content, cube));
    list.append(head);
    for (const index of indices) {
      const step = content.steps[index];
      const row = button("", () => onStep(index));
      const stripe = element("span", "stripe");
      stripe.style.background = `var(--${step.role})`;
      const entry = taskEntry(content, step.cube);
      const seconds = element("span", "figure", content.resting || step.kind === "look" ? "" : `${(step.end - step.start).toFixed(1)} s`);
      const known = step.kind === "move" && step.clearance !== null;
      const mm = element("span", "figure", known ? millimetres(1e3 * step.clearance) : "");
      if (step.kind === "move") {
        const clearance = known
          ? `; clearance ${step.certified ? "certified" : "sampled"}: ${millimetres(1e3 * step.clearance)}, ${step.closest.join(" – ")}`
          : "";
        const erring = step.clearance_with_errors === null ? "" : `; with the arm's errors: ${millimetres(1e3 * step.clearance_with_errors)}`;
        row.title = `${step.role}${step.held ? `, holding ${step.held}` : ""}${step.threaded ? `, stays threaded on ${step.threaded} (proved)` : ""}${clearance}${erring}${step.joined ? "; continues without a stop" : ""}`;
        row.classList.toggle("joined", step.joined);
        mm.style.color = known && step.clearance < 0.005 ? clearanceColour(1e3 * step.clearance) : "";
      }
      row.append(stripe, element("span", "name", shortName(step, entry)), seconds, mm);
      list.append(row);
      buttons[index] = row;
    }
  }
  return buttons;
}

function fillBar(content) {
  const bar = document.getElementById("bar");
  const cubes = document.getElementById("cubes");
  const percent = (t) => `${(100 * t) / content.duration_s}%`;
  const parts = content.steps.map((step) => {
    const part = element("i");
    part.title = step.name;
    Object.assign(part.style, { left: percent(step.start), width: percent(step.end - step.start), background: `var(--${step.role})` });
    bar.append(part);
    return part;
  });
  for (const { cube, indices } of stepGroups(content)) {
    if (cube === null) continue;
    const [start, end] = [content.steps[indices[0]].start, content.steps[indices[indices.length - 1]].end];
    const label = element("span", "", groupTitle(content, cube).split(/ {3}| → /)[0]);
    Object.assign(label.style, { left: percent(start), width: percent(end - start), borderColor: cubeColour(content, cube) });
    cubes.append(label);
  }
  return parts;
}

function fillLegend(content, mode) {
  const legend = document.getElementById("legend");
  legend.replaceChildren();
  if (mode === "clearance") {
    const ramp = element("i", "ramp");
    ramp.style.background = clearanceGradient();
    const label = element("span", "", "2 mm ");
    label.append(ramp, "60 mm clearance");
    legend.append(label);
  } else {
    const used = new Set(content.steps.filter((step) => step.kind === "move").map((step) => step.role));
    for (const role of ROLES.filter((r) => used.has(r))) {
      const label = element("span");
      const line = element("i");
      line.style.background = `var(--${role})`;
      label.append(line, role);
      legend.append(label);
    }
  }
  if (content.executed.length || content.live) {
    const label = element("span");
    const line = element("i");
    line.style.background = "var(--executed)";
    label.append(line, "executed");
    legend.append(label);
  }
}

function fillProvenance(content) {
  const list = document.querySelector("#provenance dl");
  const rows = [
    ["sha256", content.sha256],
    ["unit", content.unit],
    ["speed", String(content.speed)],
  ];
  const flatten = (value, path) => {
    if (value !== null && typeof value === "object") {
      for (const [key, inner] of Object.entries(value)) flatten(inner, path ? `${path}.${key}` : key);
    } else rows.push([path, String(value)]);
  };
  flatten(content.provenance, "");
  flatten(content.notes, "notes");
  for (const [key, value] of rows) list.append(element("dt", "", key), element("dd", "", value));
}
