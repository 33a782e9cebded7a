// The line to the gateway: one socket per tab, and plain questions while there is none that speaks.
//
// The socket says everything by itself. When it is gone, or was never heard, status.json is asked every two seconds,
// one question at a time; only when two of them got no answer is the line called lost: a server that answers nothing
// on the socket but does answer the question is out, not cut off. A question that fails speaks against the socket
// only if that has said nothing meanwhile: a browser has few connections, and held requests can take them all. A
// socket counts from its first frame, because one that is let in only to be told that there is no place opens too.
// Every tab asks for itself; electing one to ask for all was left out, because the question is small and never held.
// navigator.onLine was not asked: a ledger on this very machine is reached without any network.

const RETRY_MS = [50, 100, 200, 400, 800, 1600, 3200, 5000];
const ASK_EVERY_MS = 2000;
const ASK_TIMEOUT_MS = 3000;
const MISSES_MAX = 2;  // questions without an answer until the line is called lost
const SILENCE_MS = 7000;  // the gateway speaks every 5 s while it does not serve
const NO_PLACE = 1013;

const ask = window.fetch.bind(window);  // ours are no requests of the page: slowness.js counts those

/** Open the line. `hear` gets every frame, a hello with `gap_ms` (how long nobody was heard before it), and
    `{type: "lost", silent}`, silent if nobody refused but nobody answered. Gives a function that asks now. */
export function openChannel(hear) {
  let socket = null;
  let speaks = false;  // this socket has said something
  let heard = 0;      // frames so far, to know whether one came meanwhile
  let isDown = false;
  let attempt = 0;
  let misses = 0;
  let isAsking = false;
  let cut_ms = null;  // when the line that spoke was lost
  let retry = 0;
  let asking = 0;
  let silence = 0;
  let away = false;  // the page is in the back-forward cache or on its way out

  function connect() {
    clearTimeout(retry);
    if (away || socket) return;
    const mine = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/__hc/live`);
    socket = mine;
    mine.onmessage = (event) => { if (mine === socket) spoken(event.data); };
    mine.onclose = (event) => {
      if (mine !== socket) return;
      if (event.code === NO_PLACE) attempt = RETRY_MS.length;
      dropped();
    };
  }

  function dropped() {
    if (speaks) cut_ms ??= performance.now();
    socket = null;
    speaks = false;
    clearTimeout(silence);
    if (away) return;
    const pause_ms = RETRY_MS[Math.min(attempt, RETRY_MS.length - 1)];
    attempt += 1;
    retry = setTimeout(connect, pause_ms * (0.5 + Math.random()));
    if (!asking) question();
  }

  function spoken(text) {
    const said = read(text);
    if (!said) return;
    speaks = true;
    attempt = 0;
    misses = 0;
    clearTimeout(asking);
    asking = 0;
    if (said.type === "hello") {
      said.gap_ms = cut_ms === null ? 0 : performance.now() - cut_ms;
      cut_ms = null;
    }
    pass(said);
  }

  function read(text) {
    try {
      const said = JSON.parse(text);
      return said?.v === 1 ? said : null;
    } catch { return null; }  // not ours to judge: the next one counts
  }

  function pass(said) {
    heard += 1;
    if (said.type === "state") isDown = said.text !== null;
    watch();
    hear(said);
  }

  // While the server is away the socket has to say something from time to time, or it is asked for.
  function watch() {
    clearTimeout(silence);
    if (isDown && speaks) silence = setTimeout(question, SILENCE_MS);
  }

  async function question() {
    if (away || isAsking) return;
    clearTimeout(asking);
    isAsking = true;
    const doubted = socket;
    const before = heard;
    const began_ms = performance.now();
    const said = await answered();
    if (said && !away) misses = 0;
    if (heard === before && !away) {
      if (said) pass(said);
      else missed(doubted, performance.now() - began_ms > ASK_TIMEOUT_MS - 100);
    }
    isAsking = false;
    asking = 0;
    if (away) return;
    if (speaks) watch();
    else asking = setTimeout(question, misses === 1 ? ASK_EVERY_MS / 4 : ASK_EVERY_MS);
  }

  async function answered() {
    try {
      const response = await ask("/__hc/status.json", { cache: "no-store", signal: AbortSignal.timeout(ASK_TIMEOUT_MS) });
      if (response.status === 401) return { v: 1, type: "out" };  // whoever answers so is there, and knows nobody here
      return response.ok ? read(await response.text()) : null;
    } catch { return null; }  // whatever went wrong, there was no answer
  }

  function missed(doubted, silent) {
    misses += 1;
    if (speaks && doubted === socket) {  // it looked open and nobody is there any more
      dropped();
      doubted.close();
    }
    if (misses >= MISSES_MAX) hear({ v: 1, type: "lost", silent });
  }

  function wake() {
    if (away) return;
    attempt = 0;
    connect();
    question();
  }

  function leave() {
    away = true;
    for (const timer of [retry, asking, silence]) clearTimeout(timer);
    const old = socket;
    socket = null;
    speaks = false;
    old?.close();
  }

  function arrive() {
    away = false;
    asking = 0;
    wake();
  }

  document.addEventListener("visibilitychange", () => { if (!document.hidden) wake(); });
  document.addEventListener("resume", wake);  // frozen, and never hidden
  addEventListener("online", wake);
  addEventListener("offline", wake);
  addEventListener("pagehide", leave);  // an open socket would keep the page out of the back-forward cache
  addEventListener("pageshow", (event) => { if (event.persisted) arrive(); });
  connect();
  return question;
}
