// Dark by default, light by choice or by the system; the colours that scripts draw with.

const KEY = "rtstack.theme";
const known = new Map();

// A token of the theme's. Asked of the style sheet once: a computed style may have the whole page laid out first.
export function token(name) {
  const key = `${document.documentElement.dataset.theme} ${name}`;
  const value = known.get(key) ?? getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  known.set(key, value);
  return value;
}

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
