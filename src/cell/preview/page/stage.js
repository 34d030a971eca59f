"use strict";
// Light, camera and rendering on demand.

const ABOUT_M = 0.09; // margin for the size of bodies around the points in view

class Stage {
  constructor(canvas, centre) {
    this.canvas = canvas;
    this.centre = new THREE.Vector3(...centre);
    this.shown = [this.centre];
    this.over = []; // called after each frame, to draw over it
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.renderer.setClearColor(0x000000, 0);
    this.renderer.toneMapping = THREE.NoToneMapping;
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = THREE.PCFShadowMap;
    this.renderer.shadowMap.autoUpdate = false;
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(36, 1, 0.02, 30);
    this.camera.up.set(0, 0, 1);
    this.controls = new THREE.OrbitControls(this.camera, canvas);
    this.controls.enableDamping = false;
    this.controls.maxPolarAngle = 0.97 * Math.PI;
    this.controls.minDistance = 0.12;
    this.controls.maxDistance = 6;
    this.controls.zoomToCursor = true;
    this.controls.addEventListener("change", () => this.draw());
    this.light();
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement);
    this.resize();
  }

  // Sky, sun with soft shadow, two weak lights without. No environment map: filtering one takes seconds in software.
  light() {
    this.sky = new THREE.HemisphereLight("#ffffff", "#d6d1c8", 1.35);
    this.sun = this.lamp("#fff6ea", 1.75, 0.6, -0.85, 2.2);
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.set(2048, 2048);
    Object.assign(this.sun.shadow.camera, { left: -1.1, right: 1.1, top: 1.1, bottom: -1.1, near: 0.4, far: 4.5 });
    this.sun.shadow.radius = 4;
    this.sun.shadow.bias = -2e-4;
    this.sun.shadow.normalBias = 0.004;
    this.fill = this.lamp("#e3ecff", 0.5, 1.6, -0.4, 0.5);
    this.rim = this.lamp("#ffffff", 0.5, -1.3, 1.2, 1.1);
    this.scene.add(this.sky);
  }

  lamp(colour, intensity, x, y, z) {
    const light = new THREE.DirectionalLight(colour, intensity);
    light.position.set(this.centre.x + x, this.centre.y + y, z);
    light.target.position.copy(this.centre);
    this.scene.add(light, light.target);
    return light;
  }

  theme(dark) {
    this.sky.intensity = dark ? 1.0 : 1.35;
    this.sun.intensity = dark ? 1.5 : 1.75;
    this.fill.intensity = dark ? 0.4 : 0.5;
    this.draw();
  }

  // room, top, front, side: at a distance at which all points of `shown` are in view, with a margin.
  view(name) {
    const from = { room: [0.95, -1.42, 0.92], top: [0, -0.001, 1], front: [1, 0, 0.12], side: [0, -1, 0.12] }[name];
    const back = new THREE.Vector3(...from).normalize();
    const right = new THREE.Vector3().crossVectors(this.camera.up, back).normalize();
    const up = new THREE.Vector3().crossVectors(back, right);
    const between = (axis) => {
      const along = this.shown.map((point) => point[axis]);
      return (Math.min(...along) + Math.max(...along)) / 2;
    };
    const middle = new THREE.Vector3(between("x"), between("y"), between("z"));
    const high = Math.tan((this.camera.fov * Math.PI) / 360);
    const wide = high * (this.canvas.clientWidth / Math.max(this.canvas.clientHeight, 1) || 1);
    let away = 0.3;
    for (const point of this.shown) {
      const p = point.clone().sub(middle);
      const needed = Math.max((Math.abs(p.dot(right)) + ABOUT_M) / wide, (Math.abs(p.dot(up)) + ABOUT_M) / high);
      away = Math.max(away, p.dot(back) + needed);
    }
    this.look(middle.clone().addScaledVector(back, away), middle);
  }

  // Look from one point at another, (x, y, z).
  look(from, at) {
    this.camera.position.set(...from);
    this.controls.target.set(...at);
    this.controls.update();
    this.draw();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const size = `${width} ${height} ${ratio}`;
    // The observer also reports the first size; rendering it twice takes a third of a second in software.
    if (!width || !height || size === this.size) return;
    this.size = size;
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.drawNow();
  }

  // Draw what another camera sees, where an element is over the canvas.
  inset(camera, frame) {
    const [all, part] = [this.canvas.getBoundingClientRect(), frame.getBoundingClientRect()];
    const box = [part.left - all.left, all.bottom - part.bottom, part.width, part.height];
    this.renderer.setScissorTest(true);
    this.renderer.setScissor(...box);
    this.renderer.setViewport(...box);
    this.renderer.clear();
    this.renderer.render(this.scene, camera);
    this.renderer.setScissorTest(false);
    this.renderer.setViewport(0, 0, all.width, all.height);
  }

  // Redraw after a motion, shadows included.
  moved() {
    this.renderer.shadowMap.needsUpdate = true;
    this.draw();
  }

  draw() {
    if (this.waiting) return;
    this.waiting = requestAnimationFrame(() => this.drawNow());
  }

  drawNow() {
    cancelAnimationFrame(this.waiting);
    this.waiting = 0;
    this.renderer.render(this.scene, this.camera);
    for (const over of this.over) over();
    this.frames = (this.frames || 0) + 1;
  }
}
