// A canvas as large as its element, cleared, to draw on in CSS pixels; null where it is not shown.

const PRINTED = 3; // pixels a CSS pixel on paper

export function pen(canvas) {
  const ratio = document.documentElement.matches(".printing") ? PRINTED : devicePixelRatio;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (!width) return null;
  if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
  if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}
