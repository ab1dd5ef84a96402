// A gamepad's controls as they are pressed, each with what it does now.

function control({ name }) {
  const item = document.createElement("li");
  const drawn = document.createElement("i");
  drawn.setAttribute("aria-hidden", "true");
  drawn.append(document.createElement("b"));
  const words = document.createElement("span");
  const title = document.createElement("strong");
  title.textContent = name;
  words.append(title, document.createElement("small"));
  item.append(drawn, words);
  return item;
}

// mapping: of GamepadDevice; nothing is shown without a gamepad.
export function showGamepad(list, mapping) {
  list.hidden = mapping.length === 0;
  if (list.hidden) return;
  if (list.childElementCount !== mapping.length) list.replaceChildren(...mapping.map(control));
  for (const [index, { does, at }] of mapping.entries()) {
    const item = list.children[index];
    const words = item.querySelector("small");
    if (words.textContent !== does) words.textContent = does;
    const stick = Array.isArray(at);
    item.dataset.control = stick ? "stick" : "button";
    item.dataset.pressed = String(stick ? Math.hypot(...at) > 0.12 : at > 0.1);
    item.style.setProperty("--x", stick ? at[0] : 0);
    item.style.setProperty("--y", stick ? at[1] : 0);
    item.style.setProperty("--share", stick ? 0 : at);
  }
}
