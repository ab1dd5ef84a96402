// The review on paper: the curves are drawn anew, as wide as the paper and in the light theme, while it is printed.

export function startPrint(draw) {
  const root = document.documentElement;
  let theme = root.dataset.theme;
  const show = (printing) => {
    if (printing) theme = root.dataset.theme;
    root.classList.toggle("printing", printing);
    root.dataset.theme = printing ? "light" : theme;
    draw();
  };
  window.addEventListener("beforeprint", () => show(true));
  window.addEventListener("afterprint", () => show(false));
  document.getElementById("print").addEventListener("click", () => print());
}
