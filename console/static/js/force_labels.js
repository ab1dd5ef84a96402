// The newtons of the scene's arrows in the light drawing: its canvas is too coarse for letters while something moves, so
// they are written above the frame, and apart from each other.

const EACH_MS = 50;
const APART_PX = 2;

// m: of a matrix the 16 elements by column.
const times = (m, [x, y, z, w]) => [0, 1, 2, 3].map((row) => m[row] * x + m[row + 4] * y + m[row + 8] * z + m[row + 12] * w);

// frame: with the scene's page; light: returns whether it is drawn lightly; turned: a vector of the world in the scene's axes.
export function startForceLabels(frame, light, turned) {
  const written = new Map(); // by the path of each label

  const show = (path, { effectiveVisibility, message }, position, { camera, root, width, height }) => {
    const { props } = message;
    props.font_screen_scale = 0.001; // from its next text on it is not drawn by the scene itself
    const label = written.get(path) ?? frame.parentElement.appendChild(document.createElement("span"));
    written.set(path, label);
    label.className = "newtons";
    label.dataset.anchor = props.anchor;
    if (label.textContent !== props.text) label.textContent = props.text;
    const [x, y, , w] = times(camera.projectionMatrix.elements, times(camera.matrixWorldInverse.elements, [...turned(root, position), 1]));
    const at = [((x / w + 1) / 2) * width, ((1 - y / w) / 2) * height];
    label.hidden = !effectiveVisibility || w <= 0 || at[0] < 0 || at[1] < 0 || at[0] > width || at[1] > height;
    label.style.left = `${frame.offsetLeft + at[0]}px`;
    label.style.top = `${frame.offsetTop + at[1]}px`;
    label.style.marginTop = "0";
  };

  const part = () => {
    const boxes = [];
    const seen = [...written.values()].filter((label) => !label.hidden);
    for (const label of seen.sort((a, b) => a.getBoundingClientRect().top - b.getBoundingClientRect().top)) {
      const { left, right, top, bottom } = label.getBoundingClientRect();
      const over = boxes.filter((box) => left < box.right && box.left < right).map((box) => box.bottom + APART_PX);
      const down = Math.max(0, ...over.map((edge) => edge - top));
      label.style.marginTop = `${down}px`;
      boxes.push({ left, right, bottom: bottom + down });
    }
  };

  setInterval(() => {
    const { __viserMutable: scene, __viserSceneTree: tree } = frame.contentWindow ?? {};
    const nodes = light() && !document.hidden ? tree?.getState() ?? {} : {};
    const found = Object.keys(nodes).filter((path) => path.endsWith("/newtons") && scene?.camera && scene.nodePoseData[path]);
    for (const [path, label] of written) if (!found.includes(path)) written.delete(path) && label.remove();
    const view = { camera: scene?.camera, root: nodes[""]?.wxyz, width: frame.clientWidth, height: frame.clientHeight };
    for (const path of found) show(path, nodes[path], scene.nodePoseData[path].position, view);
    part();
  }, EACH_MS);
}
