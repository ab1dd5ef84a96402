// Dark or light: by choice, else by the system (theme_at_once.js); the colours that scripts draw with.

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
  const root = document.documentElement;
  const other = () => (root.dataset.theme === "dark" ? "light" : "dark");
  const show = () => {
    button.textContent = other() === "light" ? "Light theme" : "Dark theme";
    button.title = `Switch to ${other()}`;
  };
  button.addEventListener("click", () => {
    root.dataset.theme = other();
    localStorage.setItem(KEY, root.dataset.theme);
    show();
  });
  show();
}
