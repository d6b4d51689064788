// The page: the play bar and its keys, and the loop that moves everything.

const SWEEP = 6; // seconds in which a motion that is not over time is played at speed 1
const REST = 0.8; // seconds at the end before it begins again

function legend(entries) {
  document.getElementById("legend").append(...entries.map(({ text, arrow, trace, loop }) => {
    const item = document.createElement("li");
    const chip = document.createElement("i");
    chip.style.background = loop ? HUES.loops : arrow ? HUES[arrow] : PATHS[trace % PATHS.length];
    item.append(chip, document.createTextNode(text));
    return item;
  }));
}

class Player {
  constructor(scene, motion, update, name) {
    Object.assign(this, { scene, motion, update, name });
    this.playing = false;
    this.pending = false;
    this.value = motion.first;
    this.element = (id) => document.getElementById(id);
    const steps = Math.abs(motion.last - motion.first) / Math.max(motion.count - 1, 1) / scene.parameter.scale;
    this.decimals = steps > 0 ? Math.min(6, Math.max(0, Math.ceil(-Math.log10(steps)))) : 0;
    document.body.classList.toggle("still", motion.first === motion.last);
    this.element("play").addEventListener("click", () => this.toggle());
    this.element("named").addEventListener("click", () => this.name());
    this.element("slider").addEventListener("input", (event) => this.visit(this.at(Number(event.target.value))));
    this.element("slider").addEventListener("keydown", (event) => event.preventDefault()); // the page's keys hold here too
    window.addEventListener("keydown", (event) => this.key(event));
    window.addEventListener("hashchange", () => this.fromAddress());
  }

  at(share) {
    return this.motion.first + share * (this.motion.last - this.motion.first);
  }

  share() {
    const { first, last } = this.motion;
    return last === first ? 0 : (this.value - first) / (last - first);
  }

  /** Go to a value of the parameter. */
  seek(value) {
    const { first, last } = this.motion;
    this.value = this.motion.now = Math.min(Math.max(value, Math.min(first, last)), Math.max(first, last));
    const { name, unit, scale, discrete } = this.scene.parameter;
    const number = (discrete ? Math.floor(this.value) : this.value) / scale;
    this.element("now").textContent = `${name} = ${number.toFixed(this.decimals).replace("-", "\u2212").replace(".", mark)}${suffix(unit)}`;
    this.element("slider").value = this.share();
    this.draw();
  }

  /** Go to a value that the user chose, and stay there. */
  visit(value) {
    this.pause();
    this.seek(value);
  }

  /** Draw with the next picture of the screen, once however often it is asked. */
  draw() {
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame((clock) => {
      this.pending = false;
      if (this.playing) this.advance(clock);
      this.update(this.value);
    });
  }

  /** Return how long the whole motion takes at speed 1. */
  seconds() {
    const { time, discrete, seconds } = this.scene.parameter;
    if (seconds) return seconds;
    return time || discrete ? Math.abs(this.motion.last - this.motion.first) : SWEEP;
  }

  advance(clock) {
    const { first, last } = this.motion;
    const passed = this.clock === null ? 0 : (clock - this.clock) / 1000;
    this.clock = clock;
    if (this.scene.modes && this.value === last) this.value = first; // a period has no end
    if (this.value === last) {
      this.rest += passed;
      if (!this.element("loop").checked) this.pause();
      else this.seek(this.rest < REST ? last : first);
      return;
    }
    this.rest = 0;
    const next = this.value + ((last - first) / this.seconds()) * passed * Number(this.element("speed").value);
    this.seek(this.motion.direction * (next - last) < 0 ? next : last);
  }

  play() {
    if (this.playing || this.motion.first === this.motion.last) return;
    if (this.value === this.motion.last) this.value = this.motion.first;
    this.playing = true;
    this.clock = null;
    this.rest = 0;
    this.sign("pause");
    this.draw();
  }

  pause() {
    this.playing = false;
    this.sign("play");
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  /** Say what the button does, by which the style chooses its drawing. */
  sign(meaning) {
    this.element("play").setAttribute("aria-label", meaning);
  }

  /** Step by rows; two rows that share a value are one step. */
  step(by) {
    const { rows, count } = this.motion;
    let [row] = this.motion.locate(this.value);
    for (let k = 0; k < Math.abs(by); k += 1) {
      const here = rows[row];
      if (by < 0 && this.value !== here && k === 0) continue; // back to the row just passed
      while (row + Math.sign(by) >= 0 && row + Math.sign(by) < count && rows[row] === here) row += Math.sign(by);
    }
    this.visit(rows[row]);
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
    const leap = event.shiftKey ? 10 : 1;
    const action = {
      " ": () => this.toggle(), ArrowRight: () => this.step(leap), ArrowLeft: () => this.step(-leap),
      Home: () => this.visit(this.motion.first), End: () => this.visit(this.motion.last),
      ArrowUp: () => this.faster(1), ArrowDown: () => this.faster(-1),
      l: () => this.element("loop").click(), r: () => this.element("home").click(),
      n: () => this.name(),
    }[event.key];
    if (!action) return;
    event.preventDefault();
    if (document.activeElement instanceof HTMLButtonElement) document.activeElement.blur();
    action();
  }

  faster(by) {
    const speed = this.element("speed");
    speed.selectedIndex = Math.min(Math.max(speed.selectedIndex + by, 0), speed.options.length - 1);
  }

  /** Go where the address says, as in #t=2.5; return whether it says so. */
  fromAddress() {
    const value = parseFloat(new URLSearchParams(location.hash.slice(1)).get("t"));
    if (!Number.isFinite(value)) return false;
    this.visit(value);
    return true;
  }
}

/** Return meshcat's viewer, or ``null`` and say so where the browser has no graphics for it. */
async function graphics() {
  const probe = document.createElement("canvas");
  if (!(probe.getContext("webgl2") || probe.getContext("webgl"))) {
    say("This browser shows no 3D graphics: WebGL is missing or switched off. Another browser, or its settings for "
      + "hardware acceleration, may help.");
    return null;
  }
  const script = document.createElement("script");
  script.textContent = new TextDecoder().decode(await unpacked("viewer"));
  document.head.append(script);
  return window.MeshCat;
}

function say(sentence) {
  const words = document.createElement("p");
  words.className = "missing";
  words.textContent = sentence;
  document.getElementById("view").append(words);
}

async function main() {
  if (typeof DecompressionStream === "undefined") {
    say("This browser is too old for this page: it cannot unpack gzip. Browsers since 2023 can.");
    return;
  }
  const scene = JSON.parse(document.getElementById("scene").textContent);
  mark = scene.mark;
  const array = reader(await unpacked("arrays"));
  const MeshCat = await graphics();
  const motion = new Motion(MeshCat && MeshCat.THREE, scene, array);
  const view = MeshCat && new View(MeshCat, scene, array, motion);
  const over = view && overlays(view, motion, scene, array);
  const names = view && new Names(view, motion, scene.names);
  const player = new Player(scene, motion, (value) => {
    const at = view ? motion.place(value) : motion.locate(value);
    if (view) {
      over.update(at);
      view.draw();
      names.draw();
    }
    curves.update(at, value);
  }, () => {
    if (!names) return;
    names.toggle();
    player.draw();
  });
  if (names && scene.named) names.toggle(true);
  const curves = plots(scene, array, motion, (value) => player.visit(value));
  legend(scene.legend);
  if (scene.modes) modes(scene.modes, scene.words, motion, () => player.draw());
  document.getElementById("notes").textContent = [...(view ? [`${scene.words.grid} ${shown(view.cell)} m`] : []), ...scene.notes].join(" · ");
  if (view) {
    view.viewer.controls.addEventListener("change", () => player.draw());
    document.getElementById("home").addEventListener("click", () => { view.fit(); player.draw(); });
  }
  const resize = () => {
    if (view) view.resize();
    curves.resize();
    player.draw();
  };
  new ResizeObserver(resize).observe(document.getElementById("view"));
  resize();
  if (!player.fromAddress()) player.seek(motion.first);
  window.replay = {
    player, motion, view,
    /** Lay out the page for a picture: every plot in sight. */
    picture: () => {
      curves.fit();
      resize();
    },
    /** Resolve when a value of the parameter is on the screen. */
    show: (value) => new Promise((done) => {
      player.visit(value);
      requestAnimationFrame(() => requestAnimationFrame(() => done(player.value)));
    }),
    /** Return the placement of every body in the world, column by column. */
    placements: () => view.bodies.map((body) => body.matrix.toArray()),
  };
  document.documentElement.dataset.ready = "yes";
  if (!location.hash && window.top === window && !matchMedia("(prefers-reduced-motion: reduce)").matches) player.play();
}

main().catch((error) => {
  say(`This page could not start: ${error.message}`);
  throw error;
});
