// The page's own socket: the ledger says what it has booked, from where the page left off. Over a restart the gateway
// keeps the socket open; where it is lost all the same, it is opened again after the last sequence that was heard.

import { redrawSoon } from "./redraw.js";

const PAUSE_FIRST_MS = 500;
const PAUSE_MAX_MS = 30000;

let seq = Number(document.body.dataset.seq) || 0;
let pauseMs = PAUSE_FIRST_MS;
let socket = null;
let timer = 0;

/** Listen for as long as the page is open. */
export function listen() {
  open();
  for (const event of ["hc:back", "visibilitychange"]) document.addEventListener(event, at_once);
  for (const event of ["online", "pageshow"]) window.addEventListener(event, at_once);
  document.addEventListener("hc:back", () => redrawSoon());
  window.addEventListener("pagehide", () => socket?.close());
}

function at_once() {
  if (socket || document.hidden) return;
  pauseMs = PAUSE_FIRST_MS;
  open();
}

function open() {
  clearTimeout(timer);
  const scheme = location.protocol === "https:" ? "wss:" : "ws:";
  const mine = new WebSocket(`${scheme}//${location.host}/ws?after=${seq}`, ["hardcore.v1"]);
  socket = mine;
  mine.onmessage = (event) => hear(JSON.parse(event.data));
  mine.onclose = () => {
    if (socket !== mine) return;
    socket = null;
    timer = setTimeout(open, pauseMs * (0.8 + Math.random() * 0.4));
    pauseMs = Math.min(pauseMs * 2, PAUSE_MAX_MS);
  };
}

function hear(frame) {
  pauseMs = PAUSE_FIRST_MS;
  switch (frame.type) {
    case "ledger.transaction":
    case "ledger.account":
    case "ledger.resync":
      seq = Math.max(seq, frame.seq);
      redrawSoon();
      break;
    case "import.progress":
      document.dispatchEvent(new CustomEvent("ledger:import", { detail: frame }));
      break;
    default: // the state of the server is the crisis script's to tell
  }
}
