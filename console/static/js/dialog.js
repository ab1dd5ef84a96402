// Dialogs that block nothing: the page's scripts go on, so signs of life are sent while one is open. What is behind it
// is inert, but not the top bar: STOP stays where it is and can be pressed, by pointer and by key.

const KEPT = "#bar, dialog";

let end = null; // closes the dialog that is open

// Opens a dialog. first: what has the focus at first. Resolves to what `closeDialog` is given.
export function openDialog(dialog, first) {
  closeDialog();
  const before = document.activeElement;
  const behind = [...document.body.children].filter((element) => !element.matches(KEPT));
  return new Promise((resolve) => {
    end = (answer) => {
      dialog.close();
      for (const element of behind) element.inert = false;
      before?.focus();
      resolve(answer);
    };
    for (const element of behind) element.inert = true;
    dialog.show(); // not showModal: that would make STOP inert
    first.focus();
  });
}

// Closes the open dialog, if there is one. answer: of a question.
export function closeDialog(answer = false) {
  const close = end;
  end = null;
  close?.(answer);
}

window.addEventListener("keydown", (event) => event.key === "Escape" && closeDialog());

function make(kind, className, text) {
  const element = document.createElement(kind);
  element.className = className;
  element.textContent = text;
  return element;
}

function answer(text, className, value) {
  const button = make("button", className, text);
  button.type = "button";
  button.addEventListener("click", () => closeDialog(value));
  return button;
}

// Asks. question: short; details: what it means, "" where the question says it all; yes: the word for what will be
// done, as "Play"; bad: it cannot be undone. Resolves to whether it was confirmed; Esc and STOP answer no.
export async function ask({ question, details = "", yes, no = "Cancel", bad = false }) {
  const dialog = make("dialog", "question", "");
  dialog.setAttribute("role", "alertdialog");
  dialog.setAttribute("aria-labelledby", "question");
  dialog.setAttribute("aria-describedby", "question-details");
  const [title, text] = [make("h2", "", question), make("p", "", details)];
  title.id = "question";
  text.id = "question-details";
  const row = make("div", "answers", "");
  const refusal = answer(no, "", false);
  row.append(refusal, answer(yes, bad ? "bad" : "act", true));
  dialog.append(title, text, row);
  document.body.append(dialog);
  const confirmed = await openDialog(dialog, refusal);
  dialog.remove();
  return confirmed;
}
