// The script of a receipt's page: it looks whether something has become of the wish, and opens the page again.
//
// The server has a drawing for each outcome, so nothing is drawn here. A page that was promised something writes the
// key down for the other tabs of this browser, and takes it out when it says what became of it.

import { remember, strike } from "./promises.js";

const LOOK_EVERY_MS = 1000;
const LOOK_TIMEOUT_MS = 3000;

const key = decodeURIComponent(location.pathname.split("/").at(-1));
const shown = document.body.dataset.outcome;
const isOpen = shown === "waiting" || shown === "ask";

async function look() {
  try {
    const response = await fetch(location.pathname, {
      headers: { Accept: "application/json" }, cache: "no-store", signal: AbortSignal.timeout(LOOK_TIMEOUT_MS),
    });
    const { outcome } = response.ok ? await response.json() : { outcome: shown };
    if (outcome !== shown) return location.reload();
  } catch { /* the gateway is away for a moment: the next look will tell */ }
  return setTimeout(look, LOOK_EVERY_MS);
}

if (isOpen) {
  remember(key);
  void look();
} else {
  strike(key);
  document.querySelector("h2").focus();
}
