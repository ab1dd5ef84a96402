// Speaks with the server: every change carries the session's word, every failure becomes one line.

export const csrf = document.querySelector('meta[name="csrf-token"]').content;

// status: as in HTTP, null where nothing answered.
export class Refused extends Error {
  constructor(message, status = null) {
    super(message);
    this.status = status;
  }
}

async function ask(path, options) {
  let answer;
  try {
    answer = await fetch(path, options);
  } catch {
    throw new Refused("the console does not answer: is the stack still running?");
  }
  const document = await answer.json().catch(() => ({}));
  if (!answer.ok) throw new Refused(document.error ?? `the console answered ${answer.status}`, answer.status);
  return document;
}

export const get = (path) => ask(path, {});

const change = (method, path, body) =>
  ask(path, {
    method,
    headers: { "content-type": "application/json", "x-csrf-token": csrf },
    body: JSON.stringify(body),
    keepalive: true,
  });

export const post = (path, body = {}) => change("POST", path, body);

export const remove = (path) => change("DELETE", path, {});
