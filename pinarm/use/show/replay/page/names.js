// Names of parts, points and joints over the picture. The key N shows and hides them.

const APART = 2; // pixels between two names
const STEPS = 14; // half lines by which a name may be moved, up and down in turn

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
    this.entries = names.map((name) => {
      const element = document.createElement("span");
      element.className = name.kind;
      element.append(...lettered(name.runs));
      return { ...name, element };
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

  /** Put the names beside their points, below or above others that they would cover; those without room are hidden. */
  draw() {
    if (!this.shown) return;
    const { viewer, world } = this.view;
    const { clientWidth, clientHeight } = this.layer;
    const taken = [];
    for (const { element, node, point } of this.entries) {
      const place = this.motion.point(node, point).applyMatrix4(world.matrixWorld).project(viewer.camera);
      const [wide, high] = [element.offsetWidth, element.offsetHeight];
      const x = Math.min(Math.max(((place.x + 1) / 2) * clientWidth + 8, 2), clientWidth - wide - 2);
      const y = free(taken, x, ((1 - place.y) / 2) * clientHeight - high - 3, wide, high, clientHeight);
      element.style.visibility = y === null || place.z > 1 ? "hidden" : "";
      if (y === null) continue;
      taken.push([x, y, x + wide, y + high]);
      element.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
    }
  }
}

/** Return the height nearest to a wanted one at which a name is in the picture and covers no other, or null. */
function free(taken, x, wanted, wide, high, bottom) {
  const meets = (y) => y < 0 || y + high > bottom || taken.some((box) => x < box[2] + APART && x + wide + APART > box[0]
    && y < box[3] && y + high > box[1]);
  for (let step = 0; step < STEPS; step += 1) {
    const y = wanted + (step % 2 ? 1 : -1) * Math.ceil(step / 2) * (high / 2 + APART);
    if (!meets(y)) return y;
  }
  return null;
}
