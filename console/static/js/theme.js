// Dark by default, light by choice or by the system.

const KEY = "rtstack.theme";

export function startTheme() {
  const button = document.getElementById("theme");
  let theme = localStorage.getItem(KEY) ?? (matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark");
  const show = () => {
    document.documentElement.dataset.theme = theme;
    button.textContent = theme === "dark" ? "light" : "dark";
    button.title = `Switch to ${button.textContent}`;
  };
  button.addEventListener("click", () => {
    theme = theme === "dark" ? "light" : "dark";
    localStorage.setItem(KEY, theme);
    show();
  });
  show();
}
