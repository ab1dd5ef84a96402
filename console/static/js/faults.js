// A fault in a sentence. What logs and programs read keeps its words (rtstack/loop/end.py); a page says what was lost.

const LOST = { clutch: "the clutch signal", operator: "the operator's page", console: "the console", policy: "the policy's answers" };
const REFLEXES = { joint_reflex: "joint torque", cartesian_reflex: "force on the pad" };
const SILENCE = /^the (clutch|operator|console|policy) has gone(?: quiet)?: no (?:signal|answer that can be followed) for (\S+) s \(limit (\S+) s\)/;
const REFLEX = /^(?:the robot left torque control: )?(?:on the way to the start pose: )?(?:the )?(.+?) (?:is )?in reflex: ([^;]+)/;

const reflex = (name) => REFLEXES[name] ?? name.replace(/_violation$/, "").replaceAll("_", " ");

// A sentence begins with a capital letter, and ends.
export const asSentence = (text) => text && `${text[0].toUpperCase()}${text.slice(1)}${/[.!?]$/.test(text) ? "" : "."}`;

// remedied: what to do is said beside it.
export function faultSentence(reason, remedied) {
  const silence = SILENCE.exec(reason);
  if (silence) return `Lost ${LOST[silence[1]]} for ${silence[2]} s (limit ${silence[3]} s).`;
  const stopped = REFLEX.exec(reason);
  if (stopped) return asSentence(`${stopped[1]} stopped by a reflex (${stopped[2].split(", ").map(reflex).join(", ")}).${remedied ? "" : " Press Recover."}`);
  return asSentence(reason);
}

// What the runbook says to do: recovery is always part of it.
export const remedySentence = (todo) => `${asSentence(todo)}${/recover/i.test(todo) ? "" : " Then press Recover."}`;
