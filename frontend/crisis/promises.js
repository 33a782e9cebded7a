// Writing down what was promised, and taking it out when somebody was told what became of it (promised.js reads it).
//
// It is short, and what the gateway itself has forgotten is forgotten here: a settled receipt is kept for a day.

import { PROMISED } from "./promised.js";

const PROMISED_MAX = 100;
const FORGOTTEN_AFTER_MS = 2 * 86400000;

function change(how) {
  try {
    const said = JSON.parse(localStorage.getItem(PROMISED)) ?? [];
    const fresh = said.filter(({ at }) => Date.now() - at < FORGOTTEN_AFTER_MS);
    localStorage.setItem(PROMISED, JSON.stringify(how(fresh).slice(-PROMISED_MAX)));
  } catch { /* no storage, or full: only the page that sent it knows of it */ }
}

/** Write down that the gateway has given a receipt. */
export function remember(key) {
  change((list) => [...list.filter((one) => one.key !== key), { key, at: Date.now() }]);
}

/** What became of it has been told. */
export function strike(key) {
  change((list) => list.filter((one) => one.key !== key));
}
