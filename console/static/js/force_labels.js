// The newtons of the scene's arrows in the light drawing: its canvas is too coarse for letters while something moves, so
// they are written above the frame, and apart from each other.

const EACH_MS = 100;
const APART_PX = 2;

// m: of a matrix the 16 elements by column.
const times = (m, [x, y, z, w]) => [0, 1, 2, 3].map((row) => m[row] * x + m[row + 4] * y + m[row + 8] * z + m[row + 12] * w);

// frame: with the scene's page; light: returns whether it is drawn lightly; turned: a vector of the world in the scene's axes.
export function startForceLabels(frame, light, turned) {
  const written = new Map(); // by the path of each node: {label, width, height, style}

  const label = (path, text) => {
    const known = written.get(path) ?? { label: frame.parentElement.appendChild(document.createElement("span")) };
    written.set(path, known);
    if (known.label.textContent === text) return known;
    known.label.className = "newtons";
    known.label.textContent = text;
    return Object.assign(known, { width: known.label.offsetWidth, height: known.label.offsetHeight }); // measured once for a text
  };

  // Where a label is in the frame: left and top, px; null where it is not seen.
  const place = ({ width, height }, anchor, point, { projectionMatrix, matrixWorldInverse }) => {
    const [x, y, , w] = times(projectionMatrix.elements, times(matrixWorldInverse.elements, [...point, 1]));
    const [across, down] = [((x / w + 1) / 2) * frame.clientWidth, ((1 - y / w) / 2) * frame.clientHeight];
    if (w <= 0 || across < 0 || down < 0 || across > frame.clientWidth || down > frame.clientHeight) return null;
    return { left: across - width / 2, top: down - (anchor === "bottom-center" ? height : 0) };
  };

  setInterval(() => {
    const { __viserMutable: scene, __viserSceneTree: tree } = frame.contentWindow ?? {};
    const nodes = scene?.camera && light() && !document.hidden ? tree?.getState() ?? {} : {};
    const seen = [];
    for (const [path, { message, effectiveVisibility }] of Object.entries(nodes)) {
      const position = path.endsWith("/newtons") && scene.nodePoseData[path]?.position;
      if (!position || !effectiveVisibility || !message.props.text) continue;
      message.props.font_screen_scale = 0.001; // from its next text on it is not drawn by the scene itself
      const known = label(path, message.props.text);
      const at = place(known, message.props.anchor, turned(nodes[""].wxyz, position), scene.camera);
      if (at) seen.push({ ...at, path, known });
    }
    const boxes = [];
    for (const each of seen.sort((one, other) => one.top - other.top)) {
      const { width, height } = each.known;
      const over = boxes.filter((box) => each.left < box.left + box.known.width && box.left < each.left + width);
      each.top = Math.max(each.top, ...over.map((box) => box.top + height + APART_PX));
      boxes.push(each);
      const translate = `${Math.round(frame.offsetLeft + each.left)}px ${Math.round(frame.offsetTop + each.top)}px`;
      if (each.known.label.style.translate !== translate) each.known.label.style.translate = translate;
    }
    for (const [path, { label: shown }] of written) shown.style.visibility = boxes.some((each) => each.path === path) ? "visible" : "hidden";
  }, EACH_MS);
}
