// The 3D scene in its frame: full drawing with a graphics card, light drawing without.

import { listenForSpace } from "./stop.js";

const KEY = "rtstack.detail";

// The scene's page brings a panel of its own with developer's settings: here it would cover the arms.
const HIDDEN = "[data-floating-window], .mantine-Paper-root, .mantine-Notifications-root { display: none !important; }";

function hidePanels(document) {
  const style = document.createElement("style");
  style.textContent = HIDDEN;
  document.head.append(style);
}

function softwareRendering() {
  const gl = document.createElement("canvas").getContext("webgl2");
  if (!gl) return true;
  const names = gl.getExtension("WEBGL_debug_renderer_info");
  const renderer = names ? gl.getParameter(names.UNMASKED_RENDERER_WEBGL) : "";
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(renderer);
}

// address: of the scene's page with a detail.
export function startScene(address = (detail) => `/viser/${detail}/`) {
  const frame = document.getElementById("scene");
  const button = document.getElementById("detail");
  let detail = localStorage.getItem(KEY) ?? (softwareRendering() ? "light" : "full");

  const show = () => {
    button.textContent = `detail: ${detail}`;
    frame.src = `${address(detail)}${detail === "light" ? "?fixedDpr=0.75" : ""}`;
  };
  frame.addEventListener("load", () => {
    listenForSpace(frame.contentWindow);
    hidePanels(frame.contentDocument);
  });
  document.getElementById("home").addEventListener("click", show);
  button.addEventListener("click", () => {
    detail = detail === "light" ? "full" : "light";
    localStorage.setItem(KEY, detail);
    show();
  });
  show();
}
