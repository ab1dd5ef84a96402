// What analyses of installed packages say of a log: their curves join the others, their numbers and errors are listed.

export const signalsOf = ({ analyses }) => analyses.flatMap(({ signals }) => signals);

const text = (value) => (value === null ? "none" : Number(value.toPrecision(4)).toString());

function row(kind, words, title = "") {
  const element = document.createElement("li");
  element.className = kind;
  element.title = title;
  element.append(...words.map((word) => {
    const part = document.createElement("span");
    part.textContent = word;
    return part;
  }));
  return element;
}

export function showAnalyses({ analyses }) {
  const place = document.getElementById("analyses");
  place.hidden = analyses.length === 0;
  place.querySelector("ol").replaceChildren(...analyses.flatMap(({ name, package: from, numbers, error }) => [
    row(error === null ? "analysis" : "analysis failed", error === null ? [name.replaceAll("_", " "), from] : [error]),
    ...numbers.map((number) => row("number", [number.name.replaceAll("_", " "), `${text(number.value)} ${number.value === null ? "" : number.unit}`], `${name}.${number.name}`)),
  ]));
}
