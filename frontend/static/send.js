// One wish, sent until it is answered. The key is made before the first try and stays the same, so a wish that
// meets a restart is booked once, however often it is sent. Nothing is called saved before an answer came: a 503
// that says `not_done`, a 5xx that says nobody knows, and a lost connection are all "not yet".
//
// Until somebody has promised anything, the wish lives in this page alone, so there is no last try: it is asked for as
// long as the page is open, and a page that is left meanwhile lets the browser ask first. A gateway that has held it
// for long enough promises it (`Prefer: respond-async`, answered by 202): from then on the window may be closed, and
// nothing is sent again, only asked. Keeping the wish in localStorage for another tab was not chosen: two tabs would
// send it, and whose money it is nobody could say any more on a shared computer.

import { settled } from "./receipts.js";

const PAUSE_FIRST_MS = 1000;
const PAUSE_MAX_MS = 10000;
const LATE_MS = 1000;

const late = new Set(); // wishes on their way that may get lost with the page
let waiting = 0;

/** A key of 128 random bits. crypto.randomUUID exists only on secure origins, which a home server has not. */
export function newKey() {
  const bytes = crypto.getRandomValues(new Uint8Array(16));
  return Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
}

/**
 * Send and return {status, body} once there is an answer. `onWaiting` is called each time the wish has to wait,
 * `onLate` when its answer takes long: a gateway that holds it would forget it together with this page. `onPromise`
 * once it was promised and needs this page no longer: gets what became of it so far.
 */
export async function send(url, { method = "POST", body, key, type, onWaiting = () => {}, onLate = onWaiting, onPromise = () => {} }) {
  const headers = { Accept: "application/json", "Accept-Language": document.documentElement.lang };
  if (key) Object.assign(headers, { "Idempotency-Key": key, Prefer: "respond-async" });
  if (type) headers["Content-Type"] = type;
  const wish = {};
  let counted = false;
  const timer = setTimeout(() => {
    keep(wish);
    onLate();
  }, LATE_MS);
  try {
    for (let attempt = 0; ; attempt += 1) {
      const answer = await ask(url, { method, headers, body, cache: "no-store" });
      if (answer?.promised) {
        clearTimeout(timer);
        letGo(wish);
        if (counted) count(-1);
        counted = false;
        onPromise("waiting");
        const end = await settled(key, onPromise);
        if (end) return end;
      } else if (answer && !isOpen(answer)) return answer;
      if (!counted) {
        counted = true;
        count(1);
        keep(wish);
      }
      onWaiting();
      await pause(attempt, answer?.retryAfterS);
    }
  } finally {
    clearTimeout(timer);
    letGo(wish);
    if (counted) count(-1);
  }
}

/** Ask the ledger whether a wish was done under this key: true, false, or undefined if it does not say. */
export async function wasDone(key, onWaiting) {
  const { status, body } = await send(`/api/ledger/commands/${encodeURIComponent(key)}`, { method: "GET", onWaiting });
  if (status === 200 && body.outcome === "done") return body.status < 400;
  return status === 404 && body.outcome === "not_done" ? false : undefined;
}

function keep(wish) {
  late.add(wish);
  window.addEventListener("beforeunload", askFirst);
}

function letGo(wish) {
  late.delete(wish);
  if (late.size === 0) window.removeEventListener("beforeunload", askFirst);
}

function askFirst(event) {
  event.preventDefault();
}

async function ask(url, options) {
  try {
    const response = await fetch(url, options);
    const text = await response.text();
    const kind = response.headers.get("content-type") ?? "";
    const retryAfterS = Number(response.headers.get("retry-after")) || 0;
    const promised = response.status === 202 && (response.headers.get("preference-applied") ?? "").includes("respond-async");
    return { status: response.status, body: kind.includes("json") ? JSON.parse(text) : {}, retryAfterS, promised };
  } catch {
    return null; // the connection was lost, or the answer was cut off: the same wish is asked again
  }
}

// A server that only reads may do so for days: a wish that is sent again by itself would be done when nobody thinks of
// it any more. 500 is a fault of the server's own: to repeat it by itself would repeat the fault. A person may.
function isOpen({ status, body }) {
  if (body.type === "/problems/safe-mode") return false;
  return status === 502 || status === 504 || (status === 503 && ["not_done", "unknown", undefined].includes(body.outcome));
}

function count(step) {
  waiting += step;
  document.dispatchEvent(new CustomEvent("hc:pending", { detail: { count: waiting } }));
}

/** Wait until the server is said to be back, or for a while: the page works without the crisis script too. */
function pause(attempt, retryAfterS) {
  const grown = Math.min(PAUSE_FIRST_MS * 1.5 ** Math.min(attempt, 10), PAUSE_MAX_MS);
  const ms = Math.max(grown, (retryAfterS ?? 0) * 1000) * (0.8 + Math.random() * 0.4);
  return new Promise((resolve) => {
    const timer = setTimeout(done, ms);
    function done() {
      clearTimeout(timer);
      document.removeEventListener("hc:back", done);
      resolve();
    }
    document.addEventListener("hc:back", done);
  });
}
