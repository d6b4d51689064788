// Modes of a linear analysis: the choice of one, and the slider of its amplitude.

function modes({ names, texts }, words, motion, draw) {
  const bar = document.getElementById("bar");
  const mode = document.createElement("select");
  mode.id = "mode";
  mode.append(...names.map((name, k) => new Option(name, k)));
  const amplitude = Object.assign(document.createElement("input"), { id: "amplitude", type: "range", step: "any" });
  Object.assign(amplitude, { min: 0, max: 1, value: 0.5 });
  const text = document.createElement("li");
  document.getElementById("legend").prepend(text);
  const show = () => {
    motion.choose(Number(mode.value), Number(amplitude.value));
    text.textContent = `${names[mode.value]}: ${texts[mode.value]}`;
    draw();
  };
  for (const [name, element] of [["", mode], [words.amplitude, amplitude]]) {
    const label = document.createElement("label");
    label.append(name, element);
    bar.append(label);
    element.addEventListener("input", show);
  }
  amplitude.addEventListener("keydown", (event) => event.preventDefault()); // the page's keys hold here too
  document.body.classList.add("modes");
  const chosen = Number(new URLSearchParams(location.hash.slice(1)).get("mode"));
  if (chosen >= 1 && chosen <= names.length) mode.value = Math.round(chosen) - 1;
  show();
}
