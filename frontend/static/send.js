// One wish, sent until it is answered. The key is made before the first try and stays the same, so a wish that
// meets a restart is booked once, however often it is sent. Nothing is called saved before an answer came: a 503
// that says `not_done`, a 5xx that says nobody knows, and a lost connection are all "not yet".

const ATTEMPTS_MAX = 40;
const PAUSE_FIRST_MS = 1000;
const PAUSE_MAX_MS = 10000;

let waiting = 0;

/** A key of 128 random bits. crypto.randomUUID exists only on secure origins, which a home server has not. */
export function newKey() {
  const bytes = crypto.getRandomValues(new Uint8Array(16));
  return Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
}

/**
 * Send and return {status, body} once there is an answer, null if there was none after all tries.
 * `onWaiting` is called each time the wish has to wait for the server.
 */
export async function send(url, { method = "POST", body, key, type, onWaiting = () => {} }) {
  const headers = { Accept: "application/json", "Accept-Language": document.documentElement.lang, "Idempotency-Key": key };
  if (type) headers["Content-Type"] = type;
  let counted = false;
  try {
    for (let attempt = 0; attempt < ATTEMPTS_MAX; attempt += 1) {
      const answer = await ask(url, { method, headers, body, cache: "no-store" });
      if (answer && !isOpen(answer)) return answer;
      if (!counted) {
        counted = true;
        count(1);
      }
      onWaiting();
      await pause(attempt, answer?.retryAfterS);
    }
    return null;
  } finally {
    if (counted) count(-1);
  }
}

async function ask(url, options) {
  try {
    const response = await fetch(url, options);
    const text = await response.text();
    const kind = response.headers.get("content-type") ?? "";
    const retryAfterS = Number(response.headers.get("retry-after")) || 0;
    return { status: response.status, body: kind.includes("json") ? JSON.parse(text) : {}, retryAfterS };
  } catch {
    return null; // the connection was lost, or the answer was cut off: the same wish is asked again
  }
}

// 500 is a fault of the server's own: to repeat it by itself would repeat the fault. A person may.
function isOpen({ status, body }) {
  return status === 502 || status === 504 || (status === 503 && ["not_done", "unknown", undefined].includes(body.outcome));
}

function count(step) {
  waiting += step;
  document.dispatchEvent(new CustomEvent("hc:pending", { detail: { count: waiting } }));
}

/** Wait until the server is said to be back, or for a while: the page works without the crisis script too. */
function pause(attempt, retryAfterS) {
  const grown = Math.min(PAUSE_FIRST_MS * 1.5 ** attempt, PAUSE_MAX_MS);
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
