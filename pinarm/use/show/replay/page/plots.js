// Curves beside the picture, with a cursor that follows. A press or a drag on one leads to that place of the motion.

const SVG = "http://www.w3.org/2000/svg";
const MARGIN = { left: 50, right: 16, top: 5, bottom: 17 };
const DIGIT = 6.5; // pixels: width of a digit of the numbers beside an axis
const HEIGHT = 104;
const NOTHING = 1e-13; // size below which a curve is drawn as 0: see `chart.py`
const LEAST = 64; // pixels: height below which pictures get a further column of plots

function plots(scene, array, motion, seek) {
  const made = scene.plots.map((plot) => new Plot(scene, plot, array(plot.values), motion, seek));
  document.getElementById("plots").append(...made.map((plot) => plot.figure));
  const left = Math.max(MARGIN.left, ...made.map((plot) => plot.numbers())); // all alike: times stand below each other
  const resize = () => made.forEach((plot) => plot.draw(left));
  return { update: (at, value) => made.forEach((plot) => plot.point(at, value)), resize, fit: () => fit(made, resize) };
}

/** Make all plots visible at once, side by side where they are many: a picture cannot be scrolled. */
function fit(made, resize) {
  const aside = document.getElementById("plots");
  document.body.classList.add("picture");
  if (!made.length) return;
  const room = (columns) => {
    aside.style.setProperty("--columns", columns);
    aside.style.setProperty("--share", `${[36, 46, 56, 62][columns - 1]}%`);
    const caption = Math.max(...made.map((plot) => plot.figure.firstChild.offsetHeight)) + 16;
    return (aside.clientHeight - 20) / Math.ceil(made.length / columns) - caption;
  };
  let [columns, height] = [1, room(1)];
  while (height < LEAST && columns < 4) height = room(columns += 1);
  for (const plot of made) plot.height = Math.min(HEIGHT, Math.max(24, Math.floor(height)));
  resize();
}

/** Return a text in parts, behind whose dots a line may end; other nodes as they are. */
function breakable(node) {
  if (node.nodeType !== Node.TEXT_NODE) return [node];
  return node.textContent.split(/(?<=\.)/).flatMap((part) => [document.createElement("wbr"), part]);
}

function svg(name, attributes, parent) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (parent) parent.append(element);
  return element;
}

class Plot {
  constructor(scene, plot, values, motion, seek) {
    const { name, unit, scale } = scene.parameter;
    Object.assign(this, { plot, values, motion, scale, axis: unit ? `${name} [${unit}]` : name });
    this.figure = document.createElement("figure");
    const caption = document.createElement("figcaption");
    const label = document.createElement("span");
    label.append(...lettered(plot.runs).flatMap(breakable));
    label.title = plot.label;
    label.style.color = plot.colour;
    this.now = document.createElement("output");
    caption.append(label, this.now);
    this.height = HEIGHT;
    this.svg = svg("svg", { height: HEIGHT });
    this.figure.append(caption, this.svg);
    this.range = bounds(values);
    this.noise = 1e-9 * largest(values);
    const drag = (event) => {
      if (!(event.buttons & 1) && event.type !== "pointerdown") return;
      const share = (event.clientX - this.svg.getBoundingClientRect().left - this.left) / this.width;
      const [low, high] = this.span();
      seek((low + Math.min(1, Math.max(0, share)) * (high - low)) * this.scale);
    };
    this.svg.addEventListener("pointerdown", drag);
    this.svg.addEventListener("pointermove", drag);
  }

  /** Return the ends of the horizontal axis, in the unit shown. */
  span() {
    const [a, b] = [this.motion.first / this.scale, this.motion.last / this.scale];
    return a === b ? [a - 1, b + 1] : [Math.min(a, b), Math.max(a, b)];
  }

  x(value) {
    const [low, high] = this.span();
    return this.left + (this.width * (value / this.scale - low)) / (high - low);
  }

  y(value) {
    const [low, high] = this.range;
    return MARGIN.top + (this.height - MARGIN.top - MARGIN.bottom) * (1 - (value - low) / (high - low));
  }

  /** Return the room that the numbers beside the axis need. */
  numbers() {
    return 9 + DIGIT * Math.max(0, ...ticks(...this.range, 4).map(({ text }) => text.length));
  }

  draw(left) {
    this.left = left;
    this.width = Math.max(40, this.svg.clientWidth - this.left - MARGIN.right);
    this.svg.replaceChildren();
    this.svg.setAttribute("height", this.height);
    const [right, bottom] = [this.left + this.width, this.height - MARGIN.bottom];
    for (const { place, text } of ticks(...this.range, this.height < 80 ? 3 : 4)) {
      const y = this.y(place);
      svg("line", { class: "grid", x1: this.left, x2: right, y1: y, y2: y }, this.svg);
      svg("text", { x: this.left - 5, y: y + 3.5, "text-anchor": "end" }, this.svg).textContent = text;
    }
    for (const { place, text } of ticks(...this.span(), 5)) {
      const x = this.x(place * this.scale);
      svg("line", { class: "grid", x1: x, x2: x, y1: MARGIN.top, y2: bottom }, this.svg);
      svg("text", { x, y: this.height - 4, "text-anchor": "middle" }, this.svg).textContent = text;
    }
    svg("text", { x: 0, y: this.height - 4 }, this.svg).textContent = this.axis;
    const corners = Array.from(this.values, (value, k) => `${this.x(this.motion.rows[k]).toFixed(2)} ${this.y(value).toFixed(2)}`);
    if (this.motion.discrete) {
      for (const corner of corners) {
        const [cx, cy] = corner.split(" ");
        svg("circle", { cx, cy, r: 3.5, fill: this.plot.colour }, this.svg);
      }
    } else svg("path", { class: "curve", d: `M${corners.join("L")}`, stroke: this.plot.colour }, this.svg);
    this.cursor = svg("line", { class: "cursor", y1: MARGIN.top, y2: bottom }, this.svg);
    this.dot = svg("circle", { r: 3.5, fill: this.plot.colour, stroke: "#fff", "stroke-width": 1.2 }, this.svg);
    if (this.last) this.point(...this.last);
  }

  /** Show the value at a place of the motion. */
  point(at, value) {
    this.last = [at, value];
    if (!this.cursor) return;
    const [y] = this.motion.blend(this.values, 1, at);
    const x = this.x(this.motion.discrete ? this.motion.rows[at[0]] : value);
    this.now.textContent = shown(Math.abs(y) < this.noise ? 0 : y) + suffix(this.plot.unit);
    this.cursor.setAttribute("x1", x);
    this.cursor.setAttribute("x2", x);
    this.dot.setAttribute("cx", x);
    this.dot.setAttribute("cy", this.y(y));
  }
}

/** Return the largest size of values. */
function largest(values) {
  return values.reduce((most, value) => Math.max(most, Math.abs(value)), 0);
}

/** Return the range of an axis: that of the values with a margin, or about a constant. */
function bounds(values) {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    low = Math.min(low, value);
    high = Math.max(high, value);
  }
  const size = Math.max(Math.abs(low), Math.abs(high));
  if (high - low < 1e-6 * size || size < NOTHING) { // rounding must not be blown up to the height of the axis
    const [centre, half] = size < NOTHING ? [0, 1] : [(low + high) / 2, 0.1 * size];
    return [centre - half, centre + half];
  }
  const margin = 0.06 * (high - low);
  return [low - margin, high + margin];
}
