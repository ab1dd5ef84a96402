// The 3D scene in its frame: full drawing with a graphics card, light drawing without.

import { listenForSpace } from "./stop.js";

const KEY = "rtstack.detail";

function softwareRendering() {
  const gl = document.createElement("canvas").getContext("webgl2");
  if (!gl) return true;
  const names = gl.getExtension("WEBGL_debug_renderer_info");
  const renderer = names ? gl.getParameter(names.UNMASKED_RENDERER_WEBGL) : "";
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(renderer);
}

export function startScene() {
  const frame = document.getElementById("scene");
  const button = document.getElementById("detail");
  let detail = localStorage.getItem(KEY) ?? (softwareRendering() ? "light" : "full");

  const show = () => {
    button.textContent = `detail: ${detail}`;
    frame.src = `/viser/${detail}/?hideViserControls&darkMode${detail === "light" ? "&fixedDpr=0.75" : ""}`;
  };
  frame.addEventListener("load", () => listenForSpace(frame.contentWindow));
  button.addEventListener("click", () => {
    detail = detail === "light" ? "full" : "light";
    localStorage.setItem(KEY, detail);
    show();
  });
  show();
}
