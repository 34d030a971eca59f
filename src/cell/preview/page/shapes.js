"use strict";
// Bodies as meshes. Edges are rounded inwards, so nothing is drawn larger than the body checked for collisions.

function roundedBox([x, y, z], radius = 0.01) {
  const r = Math.min(radius, 0.3 * Math.min(x, y, z));
  return new THREE.RoundedBoxGeometry(x, y, z, 3, r);
}

// A cylinder along z, centred.
function roundedCylinder(radius, length, rounding = 0.012) {
  const r = Math.min(rounding, 0.4 * length, 0.4 * radius);
  const half = length / 2;
  const profile = [new THREE.Vector2(0, -half)];
  for (let k = 0; k <= 5; k++) {
    const a = (k / 5) * (Math.PI / 2);
    profile.push(new THREE.Vector2(radius - r + r * Math.sin(a), -half + r - r * Math.cos(a)));
  }
  for (let k = 0; k <= 5; k++) {
    const a = (k / 5) * (Math.PI / 2);
    profile.push(new THREE.Vector2(radius - r + r * Math.cos(a), half - r + r * Math.sin(a)));
  }
  profile.push(new THREE.Vector2(0, half));
  return new THREE.LatheGeometry(profile, 56).rotateX(Math.PI / 2);
}

// A capsule along z, centred; `length` between the centres of its spheres.
function capsule(radius, length) {
  const profile = [];
  for (const [start, centre] of [[-Math.PI / 2, -length / 2], [0, length / 2]]) {
    for (let k = 0; k <= 12; k++) {
      const a = start + (k / 12) * (Math.PI / 2);
      profile.push(new THREE.Vector2(Math.max(radius * Math.cos(a), 0), centre + radius * Math.sin(a)));
    }
  }
  return new THREE.LatheGeometry(profile, 56).rotateX(Math.PI / 2);
}

// A torus about z; `radius` of its circle.
function torus(radius, tube) {
  const profile = [];
  for (let k = 0; k <= 24; k++) {
    const a = (k / 24) * 2 * Math.PI;
    profile.push(new THREE.Vector2(Math.max(radius + tube * Math.cos(a), 0), tube * Math.sin(a)));
  }
  return new THREE.LatheGeometry(profile, 72).rotateX(Math.PI / 2);
}

// Flat triangles with separate corners, so that edges stay sharp.
function facets(points, faces) {
  const geometry = new THREE.BufferGeometry();
  const corners = faces.flatMap((face) => face.flatMap((i) => points[i]));
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(corners), 3));
  geometry.computeVertexNormals();
  return geometry;
}

function bodyGeometry(shape, rounding) {
  if (shape.box) return roundedBox(shape.box, rounding);
  if (shape.cylinder) return roundedCylinder(shape.cylinder[0], shape.cylinder[1], rounding);
  if (shape.capsule) return capsule(shape.capsule[0], shape.capsule[1]);
  if (shape.torus) return torus(shape.torus[0], shape.torus[1]);
  if (shape.convex) return facets(shape.convex, shape.faces);
  return new THREE.SphereGeometry(shape.sphere, 48, 32);
}

// A body as checked for collisions: sharp edges, grown by its padding, which rounds them. A hull is drawn unpadded.
function checkedGeometry(shape, padding) {
  const p = padding || 0;
  const rounding = Math.max(p, 1e-5);
  if (shape.box) {
    const [x, y, z] = shape.box.map((side) => side + 2 * p);
    return new THREE.RoundedBoxGeometry(x, y, z, 3, rounding);
  }
  if (shape.cylinder) return roundedCylinder(shape.cylinder[0] + p, shape.cylinder[1] + 2 * p, rounding);
  if (shape.capsule) return capsule(shape.capsule[0] + p, shape.capsule[1]);
  if (shape.torus) return torus(shape.torus[0], shape.torus[1] + p);
  if (shape.convex) return facets(shape.convex, shape.faces);
  return new THREE.SphereGeometry(shape.sphere + p, 48, 32);
}

function standardMaterial(colour, roughness, metalness = 0) {
  return new THREE.MeshStandardMaterial({ color: colour, roughness, metalness });
}

function mesh(geometry, material, pose) {
  const made = new THREE.Mesh(geometry, material);
  made.castShadow = made.receiveShadow = true;
  if (pose) place(made, pose);
  return made;
}

function place(object, pose) {
  object.matrixAutoUpdate = false;
  object.matrix.copy(pose);
  object.matrixWorldNeedsUpdate = true;
}

function squareHole(x, y, half) {
  const hole = new THREE.Path();
  hole.moveTo(x - half, y - half).lineTo(x - half, y + half).lineTo(x + half, y + half).lineTo(x + half, y - half);
  hole.closePath();
  return hole;
}

function roundedRectangle(cx, cy, width, height, r) {
  const [x, y] = [cx - width / 2, cy - height / 2];
  const shape = new THREE.Shape();
  shape.moveTo(x + r, y).lineTo(x + width - r, y);
  shape.absarc(x + width - r, y + r, r, -Math.PI / 2, 0);
  shape.lineTo(x + width, y + height - r);
  shape.absarc(x + width - r, y + height - r, r, 0, Math.PI / 2);
  shape.lineTo(x + r, y + height);
  shape.absarc(x + r, y + height - r, r, Math.PI / 2, Math.PI);
  shape.lineTo(x, y + r);
  shape.absarc(x + r, y + r, r, Math.PI, 1.5 * Math.PI);
  return shape;
}

// The sloping walls of a pocket, from its mouth on z = 0 to its floor.
function funnelGeometry(mouth, floor, depth) {
  const [a, b] = [mouth / 2, floor / 2];
  const ring = (h, z) => [[-h, -h, z], [h, -h, z], [h, h, z], [-h, h, z]];
  const [top, low] = [ring(a, 0), ring(b, -depth)];
  const points = [];
  for (let k = 0; k < 4; k++) {
    const n = (k + 1) % 4;
    for (const p of [top[k], low[n], low[k], top[k], top[n], low[n]]) points.push(...p);
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points), 3));
  geometry.computeVertexNormals();
  return geometry;
}

function markerTexture(rows) {
  const size = rows.length;
  const data = new Uint8Array(4 * size * size);
  for (let i = 0; i < size * size; i++) {
    // The texture's first row is the marker's lowest.
    const value = rows[size - 1 - Math.floor(i / size)][i % size] === "1" ? 246 : 26;
    data.set([value, value, value, 255], 4 * i);
  }
  const texture = new THREE.DataTexture(data, size, size, THREE.RGBAFormat);
  texture.colorSpace = THREE.SRGBColorSpace;
  texture.magFilter = texture.minFilter = THREE.NearestFilter;
  texture.needsUpdate = true;
  return texture;
}

// A board in its own frame: plate with pockets, markers with their quiet zone.
function boardGroup(board) {
  const group = new THREE.Group();
  const { size, centre } = board.plate;
  const { mouth, floor, depth } = board.pocket;
  const outline = roundedRectangle(centre[0], centre[1], size[0], size[1], 0.006);
  for (const [x, y] of board.holes) outline.holes.push(squareHole(x, y, mouth / 2));
  const plate = new THREE.ExtrudeGeometry(outline, { depth: size[2], bevelEnabled: false, curveSegments: 6 });
  group.add(mesh(plate.translate(0, 0, -size[2]), standardMaterial("#d8c29a", 0.72)));
  const wall = standardMaterial("#a88f66", 0.85);
  const ground = standardMaterial("#6d5a3e", 0.9);
  const finger = standardMaterial("#2c241a", 1);
  for (const [x, y] of board.holes) {
    group.add(mesh(funnelGeometry(mouth, floor, depth).translate(x, y, 0), wall));
    group.add(mesh(new THREE.PlaneGeometry(floor, floor).translate(x, y, -depth), ground));
    group.add(mesh(new THREE.CircleGeometry(0.008, 32).translate(x, y, -depth + 2e-4), finger));
  }
  for (const marker of board.markers) {
    const [x, y] = marker.centre;
    const zone = marker.size * (1 + 2 / marker.rows.length);
    const paper = mesh(new THREE.PlaneGeometry(zone, zone).translate(x, y, 4e-4), standardMaterial("#f7f6f2", 0.8));
    const print = standardMaterial("#ffffff", 0.8);
    print.map = markerTexture(marker.rows);
    const code = mesh(new THREE.PlaneGeometry(marker.size, marker.size).translate(x, y, 8e-4), print);
    paper.castShadow = code.castShadow = false;
    group.add(paper, code);
  }
  place(group, matrix(board.T));
  return group;
}
