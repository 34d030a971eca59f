"use strict";
// Colours. Those of roles are in style.css, with their light and dark variants.

const CUBE_COLOURS = ["#d9503f", "#2f7fc4", "#eeb333", "#3a9d62", "#8c62bf", "#e37d4a", "#3aa3a8", "#b5527f"];
const JOINT_COLOURS = ["#4c8dd6", "#e08a34", "#35a37f", "#cb5f8c", "#8a72d0", "#a38f35", "#5aa6b8", "#b56a4d"];
const ROLES = ["transit", "approach", "along", "retract", "home", "gripper", "look"];

// Colour of a clearance in mm: red up to 2 mm, amber at 10, green from 60; logarithmic in between.
const CLEARANCE_RAMP = [[2, "#cf3b34"], [5, "#e2703a"], [10, "#e5ab3c"], [25, "#86ad4c"], [60, "#2f9e76"]];

function styleColour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

function mixHex(a, b, share) {
  const part = (hex, i) => parseInt(hex.slice(1 + 2 * i, 3 + 2 * i), 16);
  const mixed = [0, 1, 2].map((i) => Math.round(part(a, i) + share * (part(b, i) - part(a, i))));
  return "#" + mixed.map((v) => v.toString(16).padStart(2, "0")).join("");
}

function clearanceColour(mm) {
  const ramp = CLEARANCE_RAMP;
  if (!(mm > ramp[0][0])) return ramp[0][1];
  for (let i = 1; i < ramp.length; i++) {
    const [low, from] = ramp[i - 1];
    const [high, to] = ramp[i];
    if (mm <= high) return mixHex(from, to, Math.log(mm / low) / Math.log(high / low));
  }
  return ramp[ramp.length - 1][1];
}

function clearanceGradient() {
  const low = Math.log(CLEARANCE_RAMP[0][0]);
  const span = Math.log(CLEARANCE_RAMP[CLEARANCE_RAMP.length - 1][0]) - low;
  const stops = CLEARANCE_RAMP.map(([mm, colour]) => `${colour} ${(100 * (Math.log(mm) - low)) / span}%`);
  return `linear-gradient(90deg, ${stops.join(", ")})`;
}
