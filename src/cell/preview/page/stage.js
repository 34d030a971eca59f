"use strict";
// Light, camera and drawing on demand: nothing is drawn while nothing changes.

class Stage {
  constructor(canvas, centre, reach) {
    this.canvas = canvas;
    this.centre = new THREE.Vector3(...centre);
    this.reach = reach;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.renderer.setClearColor(0x000000, 0);
    this.renderer.toneMapping = THREE.NeutralToneMapping;
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
    this.view("room");
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement);
    this.resize();
  }

  light() {
    this.sky = new THREE.HemisphereLight("#ffffff", "#b9ab95", 0.55);
    this.sun = new THREE.DirectionalLight("#fff4e2", 2.1);
    this.sun.position.set(this.centre.x + 0.55, this.centre.y - 1.1, 2.3);
    this.sun.target.position.copy(this.centre);
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.set(2048, 2048);
    Object.assign(this.sun.shadow.camera, { left: -1.1, right: 1.1, top: 1.1, bottom: -1.1, near: 0.4, far: 4.5 });
    this.sun.shadow.radius = 5;
    this.sun.shadow.bias = -2e-4;
    this.sun.shadow.normalBias = 0.004;
    const fill = new THREE.DirectionalLight("#dfe9ff", 0.45);
    fill.position.set(-1.2, 1.4, 1.0);
    this.scene.add(this.sky, this.sun, this.sun.target, fill);

    // A small bright room, seen only as reflections: soft boxes above and on two sides.
    const room = new THREE.Scene();
    const glow = (colour, strength) =>
      new THREE.MeshBasicMaterial({ color: new THREE.Color(colour).multiplyScalar(strength), side: THREE.DoubleSide });
    room.add(new THREE.Mesh(new THREE.SphereGeometry(9, 16, 12),
      new THREE.MeshBasicMaterial({ color: "#8b8780", side: THREE.BackSide })));
    const panel = (x, y, z, w, h, strength) => {
      const made = new THREE.Mesh(new THREE.PlaneGeometry(w, h), glow("#ffffff", strength));
      made.position.set(x, y, z);
      made.lookAt(0, 0, 0);
      room.add(made);
    };
    panel(0, 0, 5, 6, 6, 3.2);
    panel(5, -3, 2, 3, 4, 2.2);
    panel(-5, 3, 2, 3, 4, 1.4);
    const generator = new THREE.PMREMGenerator(this.renderer);
    this.scene.environment = generator.fromScene(room, 0.05, 0.1, 20, { size: 64 }).texture;
    generator.dispose();
  }

  theme(dark) {
    this.scene.environmentIntensity = dark ? 0.36 : 0.55;
    this.sky.intensity = dark ? 0.3 : 0.55;
    this.sun.intensity = dark ? 1.7 : 2.1;
    this.draw();
  }

  // room, top, front, side
  view(name) {
    const r = this.reach;
    const narrow = this.canvas.clientWidth < this.canvas.clientHeight * 1.15 ? 1.3 : 1;
    const from = {
      room: [0.95 * r, -1.42 * r, 0.92 * r],
      top: [0, -0.001, 2.0 * r],
      front: [2.0 * r, 0, 0.25 * r],
      side: [0, -2.0 * r, 0.25 * r],
    }[name];
    this.camera.position.copy(this.centre).add(new THREE.Vector3(...from).multiplyScalar(narrow));
    this.controls.target.copy(this.centre);
    this.controls.update();
    this.draw();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.drawNow();
  }

  // Something moved: shadows too.
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
    this.frames = (this.frames || 0) + 1;
  }
}
