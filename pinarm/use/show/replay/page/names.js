// Names of parts, points and joints over the picture. The key N shows and hides them.

const APART = 2; // pixels between two names
const BESIDE = 16; // pixels from a point up to which a name is seen to belong to it; from farther a line leads to it
const DISTANCES = [7, 14, 24, 38, 54, 72]; // pixels from a point to its name
const TURNS = [45, -45, 135, -135, 90, 0, -90, 180].map((angle) => (angle * Math.PI) / 180);
const POINT = 4; // pixels around a named point that other names leave free

/** Return a text whose indices stand below the line, as elements for a page. */
function lettered(runs) {
  return runs.map(([text, at, symbol]) => {
    if (at) return Object.assign(document.createElement(at), { textContent: text });
    return symbol ? Object.assign(document.createElement("em"), { textContent: text }) : document.createTextNode(text);
  });
}

class Names {
  constructor(view, motion, names) {
    Object.assign(this, { view, motion });
    this.layer = document.getElementById("names");
    this.leaders = document.getElementById("leaders");
    this.entries = names.map((name) => {
      const element = document.createElement("span");
      element.className = name.kind;
      element.append(...lettered(name.runs));
      return { ...name, element, last: 0 };
    });
    this.layer.append(...this.entries.map((entry) => entry.element));
    document.getElementById("named").hidden = !names.length;
  }

  get shown() {
    return document.body.classList.contains("named");
  }

  toggle(on) {
    document.body.classList.toggle("named", on);
    document.getElementById("named").setAttribute("aria-pressed", String(this.shown));
  }

  /** Return the boxes of what stands over the picture beside the names. */
  others() {
    const { left, top } = this.layer.getBoundingClientRect();
    return Array.from(document.querySelectorAll("#legend li, #compass, #view button"), (element) => {
      const box = element.getBoundingClientRect();
      return [box.left - left, box.top - top, box.right - left, box.bottom - top];
    });
  }

  /** Put the names beside their points, or farther away with a line to them; those without room are hidden. */
  draw() {
    if (!this.shown) return;
    const { viewer, world } = this.view;
    const page = [this.layer.clientWidth, this.layer.clientHeight];
    const points = this.entries.map(({ node, point }) => {
      const place = this.motion.point(node, point).applyMatrix4(world.matrixWorld).project(viewer.camera);
      return [((place.x + 1) / 2) * page[0], ((1 - place.y) / 2) * page[1], place.z];
    });
    const taken = this.others();
    const lines = [];
    this.entries.forEach((entry, k) => {
      const found = points[k][2] > 1 ? null : free(entry, points[k], points, taken, page);
      entry.element.style.visibility = found ? "" : "hidden";
      if (!found) return;
      const { box, distance } = found;
      taken.push(box);
      entry.element.style.transform = `translate(${box[0].toFixed(1)}px, ${box[1].toFixed(1)}px)`;
      if (distance > BESIDE) lines.push(leader(points[k], box));
    });
    this.leaders.setAttribute("d", lines.join(""));
  }
}

/** Return the nearest place at which a name covers nothing else and no other point, or null; its last one if it can. */
function free(entry, [x, y], points, taken, [width, height]) {
  const [wide, high] = [entry.element.offsetWidth, entry.element.offsetHeight];
  const place = (k) => {
    const distance = DISTANCES[Math.floor(k / TURNS.length)];
    const [along, up] = [Math.cos(TURNS[k % TURNS.length]), Math.sin(TURNS[k % TURNS.length])];
    const left = x + distance * along + (side(along) - 1) * (wide / 2);
    const top = y - distance * up - (side(up) + 1) * (high / 2);
    return { box: [left, top, left + wide, top + high], distance };
  };
  const inside = ([left, top, right, bottom]) => left >= 0 && top >= 0 && right <= width && bottom <= height;
  const clear = (box) => inside(box)
    && !taken.some((other) => box[0] < other[2] + APART && box[2] + APART > other[0] && box[1] < other[3] && box[3] > other[1]);
  const open = (box) => clear(box) && !points.some((point) => point[0] > box[0] - POINT && point[0] < box[2] + POINT
    && point[1] > box[1] - POINT && point[1] < box[3] + POINT);
  const order = [entry.last, ...Array(DISTANCES.length * TURNS.length).keys()];
  for (const allowed of [open, clear]) {
    for (const k of order) {
      const found = place(k);
      if (allowed(found.box)) {
        entry.last = k;
        return found;
      }
    }
  }
  return null;
}

/** Return -1, 0 or 1: the side on which a direction leads, apart from rounding. */
function side(component) {
  return Math.abs(component) < 1e-9 ? 0 : Math.sign(component);
}

/** Return the line from a point to the nearest edge of a box, as a path of SVG. */
function leader([x, y], [left, top, right, bottom]) {
  const [toX, toY] = [Math.min(Math.max(x, left), right), Math.min(Math.max(y, top), bottom)];
  return `M${x.toFixed(1)} ${y.toFixed(1)}L${toX.toFixed(1)} ${toY.toFixed(1)}`;
}
