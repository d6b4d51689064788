// Solid things: boxes, cylinders, spheres, capsules, meshes with their edges kept sharp, and tubes along a line.

const SMOOTH = Math.cos((35 * Math.PI) / 180); // faces that meet at less than 35 degrees are one smooth surface

function solids(THREE, scene, array) {
  const meshes = scene.meshes.map(([vertices, triangles]) => creased(THREE, array(vertices), array(triangles)));
  return scene.shapes.map((shape) => {
    const geometry = shape.kind === "mesh" ? meshes[shape.mesh] : primitive(THREE, shape);
    const solid = new THREE.Mesh(geometry, paint(THREE, shape.colour));
    if (shape.kind === "mesh") solid.scale.set(...shape.size);
    else solid.add(edges(THREE, geometry));
    solid.position.set(...shape.place.slice(0, 3));
    solid.quaternion.set(...shape.place.slice(3));
    solid.castShadow = solid.receiveShadow = true;
    return { node: shape.node, solid };
  });
}

function paint(THREE, [r, g, b, a]) {
  return new THREE.MeshPhongMaterial({
    color: new THREE.Color(r, g, b), opacity: a, transparent: a < 1, shininess: 22, specular: 0x262626,
    side: THREE.DoubleSide,
  });
}

function primitive(THREE, { kind, size }) {
  if (kind === "box") return new THREE.BoxGeometry(...size);
  if (kind === "sphere") return new THREE.SphereGeometry(size[0], 32, 20);
  const [radius, length] = size;
  const round = kind === "capsule"
    ? new THREE.LatheGeometry(capsule(THREE, radius, length), 32)
    : new THREE.CylinderGeometry(radius, radius, length, 40);
  return round.rotateX(Math.PI / 2); // three's axis is y, URDF's is z
}

function capsule(THREE, radius, length) {
  const outline = [];
  for (let k = 0; k <= 24; k += 1) {
    const angle = -Math.PI / 2 + (Math.PI * k) / 24;
    const shift = (k <= 12 ? -1 : 1) * (length / 2);
    outline.push(new THREE.Vector2(Math.max(radius * Math.cos(angle), 1e-9), radius * Math.sin(angle) + shift));
  }
  return outline;
}

function edges(THREE, geometry) {
  const material = new THREE.LineBasicMaterial({ color: 0x1b2430, transparent: true, opacity: 0.28 });
  return new THREE.LineSegments(new THREE.EdgesGeometry(geometry, 40), material);
}

/** Return triangles with a normal at every corner: the mean of the faces around it that are nearly in one plane. */
function creased(THREE, points, corners) {
  const faces = corners.length / 3;
  const normals = new Float32Array(3 * faces); // as long as twice the area
  const units = new Float32Array(3 * faces);
  const around = new Uint32Array(points.length / 3 + 1);
  for (let f = 0; f < faces; f += 1) {
    const [a, b, c] = [3 * corners[3 * f], 3 * corners[3 * f + 1], 3 * corners[3 * f + 2]];
    const [ux, uy, uz] = [points[b] - points[a], points[b + 1] - points[a + 1], points[b + 2] - points[a + 2]];
    const [vx, vy, vz] = [points[c] - points[a], points[c + 1] - points[a + 1], points[c + 2] - points[a + 2]];
    const normal = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    const length = Math.hypot(...normal) || 1;
    for (let k = 0; k < 3; k += 1) {
      normals[3 * f + k] = normal[k];
      units[3 * f + k] = normal[k] / length;
      around[corners[3 * f + k] + 1] += 1;
    }
  }
  for (let v = 1; v < around.length; v += 1) around[v] += around[v - 1];
  const next = around.slice();
  const touching = new Uint32Array(corners.length);
  for (let k = 0; k < corners.length; k += 1) touching[next[corners[k]]++] = Math.floor(k / 3);
  const position = new Float32Array(3 * corners.length);
  const normal = new Float32Array(3 * corners.length);
  for (let k = 0; k < corners.length; k += 1) {
    const own = 3 * Math.floor(k / 3);
    const vertex = corners[k];
    let [x, y, z] = [0, 0, 0];
    for (let j = around[vertex]; j < around[vertex + 1]; j += 1) {
      const other = 3 * touching[j];
      const cosine = units[own] * units[other] + units[own + 1] * units[other + 1] + units[own + 2] * units[other + 2];
      if (cosine > SMOOTH) {
        x += normals[other];
        y += normals[other + 1];
        z += normals[other + 2];
      }
    }
    const length = Math.hypot(x, y, z) || 1;
    normal.set([x / length, y / length, z / length], 3 * k);
    position.set([points[3 * vertex], points[3 * vertex + 1], points[3 * vertex + 2]], 3 * k);
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(position, 3));
  geometry.setAttribute("normal", new THREE.BufferAttribute(normal, 3));
  return geometry;
}

/** Return a tube along a line of points; its first ``6 * sides * k`` indices are its first k stretches. */
function tube(THREE, line, radius, sides = 6) {
  const position = [];
  const normal = [];
  const index = [];
  const across = new THREE.Vector3(0.3, 0.5, 0.8);
  line.forEach((point, k) => {
    const ahead = line[Math.min(k + 1, line.length - 1)].clone().sub(line[Math.max(k - 1, 0)]);
    if (ahead.lengthSq() > 0) {
      ahead.normalize();
      across.addScaledVector(ahead, -across.dot(ahead));
      if (across.lengthSq() < 1e-6) across.set(ahead.y, ahead.z, -ahead.x).addScaledVector(ahead, -across.dot(ahead));
      across.normalize();
    }
    const beside = ahead.clone().cross(across);
    for (let s = 0; s < sides; s += 1) {
      const angle = (2 * Math.PI * s) / sides;
      const out = across.clone().multiplyScalar(Math.cos(angle)).addScaledVector(beside, Math.sin(angle));
      normal.push(out.x, out.y, out.z);
      position.push(point.x + radius * out.x, point.y + radius * out.y, point.z + radius * out.z);
      if (k + 1 < line.length) {
        const [a, b] = [k * sides + s, k * sides + ((s + 1) % sides)];
        index.push(a, b, a + sides, b, b + sides, a + sides);
      }
    }
  });
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(position, 3));
  geometry.setAttribute("normal", new THREE.Float32BufferAttribute(normal, 3));
  geometry.setIndex(index);
  return geometry;
}
