// The 3D scene in its frame: full drawing with a graphics card, light drawing without; camera places; the whole page.

import { TWO } from "./arms.js";
import { startForceLabels } from "./force_labels.js";
import { isTextField, listenForSpace } from "./stop.js";

const KEY = "rtstack.detail";

// Where the camera can look from, in the world: position, then what it looks at. The impact is along y.
const PLACES = {
  front: { key: "KeyF", title: `From in front of the ${TWO ? "arms" : "arm"} (F)`, from: [1.9, 0, 0.95], at: [0, 0, 0.3] },
  top: { key: "KeyT", title: "From above (T)", from: [-0.02, 0, 2.2], at: [0, 0, 0.2] },
  along: { key: "KeyY", title: TWO ? "Along the direction of the impact, from the right arm's side (Y)" : "Along y, towards the world's left (Y)", from: [0.5, -1.7, 0.75], at: [0.02, 0, 0.3] },
};
const ENLARGE = "KeyV";

// The scene's page brings a panel of its own with developer's settings: here it would cover the arms. Its ground is
// that of the page around it, in either theme.
const HIDDEN = "[data-floating-window], .mantine-Paper-root, .mantine-Notifications-root { display: none !important; } #root div[style*='background-color'] { background-color: transparent !important; }";

function hidePanels(document) {
  const style = document.createElement("style");
  style.textContent = HIDDEN;
  document.head.append(style);
}

// viser connects again only while its own page has the focus: here, while it is seen.
function keepConnected(scene) {
  scene.document.hasFocus = () => scene.document.visibilityState === "visible";
  const look = () => scene.dispatchEvent(new scene.Event(scene.document.hasFocus() ? "focus" : "blur"));
  scene.document.addEventListener("visibilitychange", look);
  look();
}

function softwareRendering() {
  const gl = document.createElement("canvas").getContext("webgl2");
  if (!gl) return true;
  const names = gl.getExtension("WEBGL_debug_renderer_info");
  const renderer = names ? gl.getParameter(names.UNMASKED_RENDERER_WEBGL) : "";
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(renderer);
}

// Turn a vector of the world by a quaternion wxyz: into the axes that the scene's page draws in.
function turned([w, x, y, z], [a, b, c]) {
  const [p, q, r] = [y * c - z * b + w * a, z * a - x * c + w * b, x * b - y * a + w * c];
  return [a + 2 * (y * r - z * q), b + 2 * (z * p - x * r), c + 2 * (x * q - y * p)];
}

function button(text, title, act) {
  const made = document.createElement("button");
  made.type = "button";
  made.className = "quiet";
  made.textContent = text;
  made.title = title;
  made.addEventListener("click", act);
  return made;
}

class Scene {
  // address: of the scene's page with a detail.
  constructor(address) {
    this.address = address;
    this.frame = document.getElementById("scene");
    this.place = this.frame.parentElement;
    this.detailButton = document.getElementById("detail");
    this.detail = localStorage.getItem(KEY) ?? (softwareRendering() ? "light" : "full");
    this.listen(window);
    this.frame.addEventListener("load", () => {
      keepConnected(this.frame.contentWindow);
      listenForSpace(this.frame.contentWindow);
      hidePanels(this.frame.contentDocument);
      this.showGround();
      this.listen(this.frame.contentWindow);
    });
    new MutationObserver(() => this.showGround()).observe(document.documentElement, { attributeFilter: ["data-theme"] });
    const home = document.getElementById("home");
    home.addEventListener("click", () => this.show());
    this.enlarge = button("enlarge", "The scene as large as the page (V); Escape: as before", () => this.setLarge());
    this.enlarge.id = "enlarge";
    const views = Object.entries(PLACES).map(([name, { title }]) => button(name, title, () => this.look(name)));
    home.before(...views);
    home.after(this.enlarge);
    this.detailButton.addEventListener("click", () => {
      this.detail = this.detail === "light" ? "full" : "light";
      localStorage.setItem(KEY, this.detail);
      this.show();
    });
    this.show();
    startForceLabels(this.frame, () => this.detail === "light", turned);
  }

  show() {
    this.detailButton.textContent = `detail: ${this.detail}`;
    this.frame.src = `${this.address(this.detail)}${this.detail === "light" ? "?fixedDpr=0.75" : ""}`;
  }

  showGround() {
    const body = this.frame.contentDocument?.body;
    if (body) body.style.background = getComputedStyle(this.place).backgroundColor;
  }

  // Move the camera, in the scene's own page: its own controls, its version is pinned.
  look(name) {
    const { __viserMutable: scene, __viserSceneTree: tree } = this.frame.contentWindow;
    const root = tree?.getState()[""]?.wxyz;
    if (!scene?.cameraControl || !root) return;
    const { from, at } = PLACES[name];
    scene.cameraControl.setLookAt(...turned(root, from), ...turned(root, at), true);
  }

  get large() {
    return this.place.classList.contains("large");
  }

  // The bar with STOP and the line of events stay where they are: only what is between them gives way.
  setLarge(large = !this.large) {
    this.place.classList.toggle("large", large);
    this.enlarge.textContent = large ? "smaller" : "enlarge";
    this.enlarge.setAttribute("aria-pressed", String(large));
  }

  listen(target) {
    target.addEventListener("keydown", (event) => {
      if (event.repeat || isTextField(event.target) || event.ctrlKey || event.altKey || event.metaKey) return;
      if (event.target.ownerDocument?.querySelector("dialog[open]")) return;
      const name = Object.keys(PLACES).find((place) => PLACES[place].key === event.code);
      if (name) this.look(name);
      else if (event.code === ENLARGE) this.setLarge();
      else if (event.key === "Escape" && this.large) this.setLarge(false);
    });
  }
}

export function startScene(address = (detail) => `/viser/${detail}/`) {
  return new Scene(address);
}
