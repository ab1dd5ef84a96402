// The HTTP interface, read and tried out. What is tried carries the session's word, as every change of a page does.

import { startFrame } from "./frame.js";

const place = document.getElementById("interface");
const csrf = document.querySelector('meta[name="csrf-token"]').content;
const root = document.documentElement;

startFrame();
const follow = () => root.classList.toggle("dark-mode", root.dataset.theme === "dark");
new MutationObserver(follow).observe(root, { attributeFilter: ["data-theme"] });
follow();

window.SwaggerUIBundle({
  url: place.dataset.description,
  domNode: place,
  docExpansion: "list",
  defaultModelsExpandDepth: 0,
  displayRequestDuration: true,
  validatorUrl: null,
  requestInterceptor: (request) => {
    request.headers["x-csrf-token"] = csrf;
    return request;
  },
});
