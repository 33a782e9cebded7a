// The line to the gateway: one socket per tab, and plain questions while there is none.
//
// The socket says everything by itself. When it is gone, status.json is asked every two seconds; only when that
// can't be had either is the line called lost: a server that answers nothing on the socket but does answer the
// question is out, not cut off. Every tab asks for itself; electing one tab to ask for all was left out, because
// the question is small and never held. navigator.onLine alone says nothing here: a ledger on this very machine
// is reached without any network.

const RETRY_MS = [50, 100, 200, 400, 800, 1600, 3200, 5000];
const ASK_EVERY_MS = 2000;
const ASK_TIMEOUT_MS = 3000;
const MISSES_MAX = 2; // questions without an answer until the line is called lost
const SILENCE_MS = 12000; // the gateway speaks every 5 s while it does not serve

const ask = window.fetch.bind(window); // ours are no requests of the page: slowness.js counts those

/** Open the line. `hear` gets every frame and `{type: "lost"}`. */
export function openChannel(hear) {
  let socket = null;
  let attempt = 0;
  let misses = 0;
  let retry = 0;
  let asking = 0;
  let silence = 0;
  let away = false; // the page is in the back-forward cache or on its way out

  function connect() {
    clearTimeout(retry);
    if (away || socket) return;
    const mine = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/__hc/live`);
    socket = mine;
    mine.onopen = () => { attempt = 0; misses = 0; clearTimeout(asking); };
    mine.onmessage = (event) => { if (mine === socket) heard(event.data); };
    mine.onclose = () => { if (mine === socket) dropped(); };
  }

  function dropped() {
    socket = null;
    clearTimeout(silence);
    if (away) return;
    const pause_ms = RETRY_MS[Math.min(attempt, RETRY_MS.length - 1)];
    attempt += 1;
    retry = setTimeout(connect, pause_ms * (0.5 + Math.random()));
    if (attempt === 1) question();
  }

  function drop() {
    const old = socket;
    if (!old) return;
    dropped();
    old.close();
  }

  function heard(text) {
    let frame;
    try { frame = JSON.parse(text); } catch { return; } // not ours to judge: the next one counts
    if (frame === null || frame.v !== 1) return;
    clearTimeout(silence);
    if (frame.type === "state" && frame.text !== null) silence = setTimeout(wake, SILENCE_MS);
    hear(frame);
  }

  async function question() {
    clearTimeout(asking);
    if (away) return;
    const answer = await answered();
    if (away) return;
    if (answer === null) missed();
    else {
      misses = 0;
      if (!isOpen()) heard(answer);
    }
    if (!isOpen()) {
      clearTimeout(asking);
      asking = setTimeout(question, misses === 1 ? ASK_EVERY_MS / 4 : ASK_EVERY_MS);
    }
  }

  async function answered() {
    try {
      const response = await ask("/__hc/status.json", { cache: "no-store", signal: AbortSignal.timeout(ASK_TIMEOUT_MS) });
      return response.ok ? await response.text() : null;
    } catch { return null; } // whatever went wrong, there was no answer
  }

  function missed() {
    misses += 1;
    if (isOpen()) drop(); // it looked open and nobody is there any more
    if (misses >= MISSES_MAX || !navigator.onLine) hear({ v: 1, type: "lost" });
  }

  function isOpen() {
    return socket !== null && socket.readyState === WebSocket.OPEN;
  }

  function wake() {
    if (away) return;
    attempt = 0;
    if (!isOpen()) connect();
    question();
  }

  function leave() {
    away = true;
    for (const timer of [retry, asking, silence]) clearTimeout(timer);
    socket?.close();
    socket = null;
  }

  function arrive() {
    away = false;
    wake();
  }

  document.addEventListener("visibilitychange", () => { if (!document.hidden) wake(); });
  addEventListener("online", wake);
  addEventListener("offline", wake);
  addEventListener("pagehide", leave); // an open socket would keep the page out of the back-forward cache
  addEventListener("pageshow", (event) => { if (event.persisted) arrive(); });
  connect();
}
