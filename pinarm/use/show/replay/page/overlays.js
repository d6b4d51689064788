// What is drawn over the mechanism: paths of points, arrows, springs, cylinders, bushings, cables and loop joints.

const HUES = { forces: "#009e73", torques: "#d55e00", reactions: "#0072b2", loops: "#cc79a7" };
const PATHS = ["#cc4778", "#e69f00", "#56b4e9", "#7e4fb0", "#2b8a3e", "#8a5a2b"];
const STATIONS = 900; // places at which a path is computed, if there are not more rows
const FULL_ARC = 1.6 * Math.PI;

function overlays(view, motion, scene, array) {
  const made = [
    ...scene.traces.map((trace, k) => path(view, motion, trace, PATHS[k % PATHS.length])),
    ...scene.pairs.map((pair) => link(view, motion, pair)),
    ...scene.slots.map((outline) => slotted(view, outline)),
    ...scene.arrows.map((arrow) => (arrow.moment ? twist : straight)(view, motion, arrow, array)),
  ];
  return { update: (at) => made.forEach((one) => one(at)) };
}

function onTop(THREE, colour) {
  const shade = new THREE.Color(colour).multiplyScalar(0.5); // half of it glows: the mean is the colour of the legend
  return new THREE.MeshPhongMaterial({
    color: shade, emissive: shade, specular: 0, depthTest: false, transparent: true, side: THREE.DoubleSide,
  });
}

/** Return the place of a traced point: one of a body, or the centre of mass. */
function traced(motion, { node, point, masses }) {
  if (!masses) return motion.point(node, point);
  const sum = new motion.THREE.Vector3();
  let total = 0;
  for (const body of masses) {
    sum.addScaledVector(motion.point(body.node, body.point), body.mass);
    total += body.mass;
  }
  return sum.multiplyScalar(1 / total);
}

/** Draw the path of a point: the whole of it faintly, and strongly as far as it has gone. */
function path(view, motion, trace, colour) {
  const { THREE, size } = view;
  const count = motion.discrete ? motion.count : Math.max(STATIONS, motion.count);
  const station = (k) => (motion.discrete ? motion.rows[k]
    : motion.first + ((motion.last - motion.first) * k) / Math.max(count - 1, 1));
  const line = [];
  for (let k = 0; k < count; k += 1) {
    motion.place(station(k));
    line.push(traced(motion, trace));
  }
  const geometry = tube(THREE, line, 0.0025 * size);
  const faint = new THREE.Mesh(tube(THREE, line, 0.0012 * size),
    new THREE.MeshBasicMaterial({ color: colour, transparent: true, opacity: 0.35 }));
  const strong = new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({ color: colour }));
  const head = new THREE.Mesh(new THREE.SphereGeometry(0.009 * size, 20, 14), onTop(THREE, colour));
  head.renderOrder = 8;
  view.world.add(faint, strong, head);
  return (at, value) => {
    head.position.copy(traced(motion, trace));
    const share = motion.last === motion.first ? 0 : (motion.now - motion.first) / (motion.last - motion.first);
    geometry.setDrawRange(0, 36 * Math.floor(share * (count - 1)));
  };
}

/** Draw an arrow from a point of a body, as long as a force. */
function straight(view, motion, arrow, array) {
  const { THREE, size } = view;
  const longest = 0.26 * size;
  const material = onTop(THREE, HUES[arrow.of]);
  const shaft = new THREE.Mesh(new THREE.CylinderGeometry(0.0045 * size, 0.0045 * size, 1, 14), material);
  const head = new THREE.Mesh(new THREE.ConeGeometry(0.013 * size, 1, 18), material);
  const both = new THREE.Group();
  both.add(shaft, head);
  shaft.renderOrder = head.renderOrder = 9;
  view.world.add(both);
  const vectors = array(arrow.vectors);
  return (at) => {
    const vector = new THREE.Vector3(...motion.blend(vectors, 3, at));
    const length = (longest * vector.length()) / arrow.largest;
    both.visible = length > 0.004 * size;
    if (!both.visible) return;
    const tip = Math.min(0.042 * size, 0.5 * length);
    shaft.scale.set(1, length - tip, 1);
    shaft.position.set(0, (length - tip) / 2, 0);
    head.scale.set(1, tip, 1);
    head.position.set(0, length - tip / 2, 0);
    both.position.copy(motion.point(arrow.node, arrow.point));
    both.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), vector.normalize());
  };
}

/** Draw an arc with an arrowhead about an axis, as long as a torque. */
function twist(view, motion, arrow, array) {
  const { THREE, size } = view;
  const radius = 0.075 * size;
  const material = onTop(THREE, HUES[arrow.of]);
  const line = [];
  for (let k = 0; k <= 60; k += 1) {
    const angle = (FULL_ARC * k) / 60;
    line.push(new THREE.Vector3(radius * Math.cos(angle), radius * Math.sin(angle), 0));
  }
  const arc = new THREE.Mesh(tube(THREE, line, 0.0045 * size, 10), material);
  const head = new THREE.Mesh(new THREE.ConeGeometry(0.015 * size, 0.04 * size, 18), material);
  const both = new THREE.Group();
  both.add(arc, head);
  arc.renderOrder = head.renderOrder = 9;
  view.world.add(both);
  const vectors = array(arrow.vectors);
  return (at) => {
    const vector = new THREE.Vector3(...motion.blend(vectors, 3, at));
    const steps = Math.round((60 * vector.length()) / arrow.largest);
    both.visible = steps > 0;
    if (!both.visible) return;
    arc.geometry.setDrawRange(0, 60 * steps);
    const angle = (FULL_ARC * steps) / 60;
    head.position.set(radius * Math.cos(angle), radius * Math.sin(angle), 0);
    head.quaternion.setFromAxisAngle(new THREE.Vector3(0, 0, 1), angle);
    head.scale.setScalar(Math.min(1, (1.3 * angle * radius) / (0.04 * size)));
    both.position.copy(motion.point(arrow.node, arrow.point));
    both.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), vector.normalize());
  };
}

/** Draw what joins two points: a spring, a cylinder, a bushing, a rod, a part of a cable, or the mark of a loop joint. */
function link(view, motion, pair) {
  const { THREE, detail: size } = view;
  const between = new THREE.Group();
  view.world.add(between);
  const parts = { spring, cylinder, bushing, rod, cable, loop, slot }[pair.kind](THREE, pair, size);
  between.add(...parts.fixed, ...parts.stretched);
  return () => {
    const [a, b] = [motion.point(pair.a.node, pair.a.point), motion.point(pair.b.node, pair.b.point)];
    const along = b.clone().sub(a);
    const length = along.length();
    between.position.copy(a);
    if (length > 0) between.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), along.normalize());
    parts.stretched.forEach((part) => part.scale.set(1, 1, Math.max(length, 1e-9)));
    parts.atEnd.forEach((part) => part.position.set(0, 0, length));
  };
}

function spring(THREE, pair, size) {
  const radius = Math.min(0.02 * size, 0.15 * pair.longest);
  const line = [new THREE.Vector3(0, 0, 0)];
  for (let k = 0; k <= 240; k += 1) {
    const angle = (9 * 2 * Math.PI * k) / 240;
    const out = radius * Math.min(1, k / 12, (240 - k) / 12);
    line.push(new THREE.Vector3(out * Math.cos(angle), out * Math.sin(angle), 0.12 + (0.76 * k) / 240));
  }
  line.push(new THREE.Vector3(0, 0, 1));
  const coil = new THREE.Mesh(tube(THREE, line, 0.0035 * size), paint(THREE, [0.42, 0.45, 0.5, 1]));
  coil.castShadow = true;
  const [start, end] = eyes(THREE, size);
  return { fixed: [start, end], stretched: [coil], atEnd: [end] };
}

function cylinder(THREE, pair, size) {
  const radius = Math.min(0.016 * size, 0.12 * pair.longest);
  const length = 0.92 * pair.shortest;
  const upright = (r, l) => new THREE.CylinderGeometry(r, r, l, 28).rotateX(Math.PI / 2).translate(0, 0, l / 2);
  const barrel = new THREE.Mesh(upright(radius, length), paint(THREE, [0.36, 0.42, 0.5, 1]));
  const rod = new THREE.Mesh(upright(0.45 * radius, 1), paint(THREE, [0.8, 0.82, 0.85, 1]));
  barrel.add(edges(THREE, barrel.geometry));
  barrel.castShadow = rod.castShadow = true;
  const [start, end] = eyes(THREE, size);
  return { fixed: [barrel, start, end], stretched: [rod], atEnd: [end] };
}

/** A bushing: a ball of rubber between the two origins, and a steel pin through each of these. */
function bushing(THREE, pair, size) {
  const rubber = new THREE.Mesh(new THREE.SphereGeometry(0.03 * size, 24, 16), paint(THREE, [0.13, 0.13, 0.14, 1]));
  rubber.castShadow = true;
  const pin = () => new THREE.Mesh(new THREE.CylinderGeometry(0.01 * size, 0.01 * size, 0.08 * size, 20),
    paint(THREE, [0.72, 0.74, 0.78, 1]));
  const [start, end] = [pin(), pin().rotateZ(Math.PI / 2)];
  const neck = new THREE.Mesh(new THREE.CylinderGeometry(0.018 * size, 0.018 * size, 1, 20).rotateX(Math.PI / 2)
    .translate(0, 0, 0.5), paint(THREE, [0.13, 0.13, 0.14, 1]));
  return { fixed: [rubber, start, end], stretched: [neck], atEnd: [end] };
}

function rod(THREE, pair, size) {
  return straightPart(THREE, size, 0.008 * size, [0.55, 0.58, 0.62, 1]);
}

function cable(THREE, pair, size) {
  return straightPart(THREE, size, 0.0035 * size, [0.2, 0.22, 0.25, 1]);
}

/** A bar of one radius from one eye to the other. */
function straightPart(THREE, size, radius, colour) {
  const bar = new THREE.Mesh(new THREE.CylinderGeometry(radius, radius, 1, 20).rotateX(Math.PI / 2)
    .translate(0, 0, 0.5), paint(THREE, colour));
  bar.castShadow = true;
  const [start, end] = eyes(THREE, size);
  return { fixed: [start, end], stretched: [bar], atEnd: [end] };
}

/** A loop joint: a bright ball on each of its two links, and a line between them where they have come apart. */
function loop(THREE, pair, size) {
  const ball = () => {
    const mark = new THREE.Mesh(new THREE.SphereGeometry(0.014 * size, 20, 14), onTop(THREE, HUES.loops));
    mark.renderOrder = 7;
    return mark;
  };
  const [start, end] = [ball(), ball()];
  const gap = new THREE.Mesh(new THREE.CylinderGeometry(0.004 * size, 0.004 * size, 1).rotateX(Math.PI / 2)
    .translate(0, 0, 0.5), onTop(THREE, HUES.loops));
  return { fixed: [start, end], stretched: [gap], atEnd: [end] };
}

/** The pin in a slot: a bright ball where it is; the slot has an outline of its own. */
function slot(THREE, pair, size) {
  const [, end] = loop(THREE, pair, size).fixed;
  return { fixed: [end], stretched: [], atEnd: [end] };
}

/** The outline of a slot, which moves with its body. */
function slotted(view, { node, points }) {
  const { THREE, motion, size } = view;
  const line = points.map((point) => new THREE.Vector3(...point));
  const outline = new THREE.Mesh(tube(THREE, line, 0.0025 * size), onTop(THREE, "#4a5058"));
  outline.renderOrder = 6;
  view.bodies[node].add(outline);
  return () => {};
}

function eyes(THREE, size) {
  return [0, 1].map(() => new THREE.Mesh(new THREE.SphereGeometry(0.01 * size, 18, 12), paint(THREE, [0.27, 0.29, 0.33, 1])));
}
