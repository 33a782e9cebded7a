// Follows the ledger while somebody looks: the state from the gateway's channel, everything else by asking for the
// same page again and taking over the parts marked `data-live`. A hidden tab asks for nothing.

const POLL_MS = 2000;
const AGAIN_MS = 2000;
const AGAIN_MS_MAX = 30000;
const root = document.documentElement;
let socket = null;
let againMs = AGAIN_MS;
let timer = 0;

// What a state frame means in one word; the words are those of the ledger's own header.
function word({ text, safe }) {
  if (text === null) return safe ? "safe" : "serving";
  if (text === "R8") return "stopped";
  return text === "OFF" ? "off" : "down";
}

function listen() {
  if (document.hidden || socket) return;
  const scheme = location.protocol === "https:" ? "wss:" : "ws:";
  socket = new WebSocket(`${scheme}//${location.host}/__hc/live`);
  socket.addEventListener("message", ({ data }) => {
    let frame = null;
    try {
      frame = JSON.parse(data);
    } catch {
      return; // not for us
    }
    againMs = AGAIN_MS;
    if (frame.type !== "state") return;
    const now = word(frame);
    if (root.dataset.hc !== now) redraw();
    root.dataset.hc = now;
  });
  socket.addEventListener("close", () => {
    socket = null;
    if (document.hidden) return;
    root.dataset.hc = "away";
    setTimeout(listen, againMs);
    againMs = Math.min(againMs * 2, AGAIN_MS_MAX);
  });
}

async function redraw() {
  clearTimeout(timer);
  if (document.hidden || !document.querySelector("[data-poll]")) return;
  try {
    const response = await fetch(location.href, { headers: { Accept: "text/html" }, cache: "no-store" });
    if (response.ok) take(new DOMParser().parseFromString(await response.text(), "text/html"));
  } catch {
    // nobody there for a moment: what is shown stays
  }
  clearTimeout(timer);
  timer = setTimeout(redraw, POLL_MS);
}

function take(fresh) {
  for (const part of fresh.querySelectorAll("[data-live]")) {
    const here = document.getElementById(part.id);
    if (!here || isBusy(here) || here.isEqualNode(part)) continue;
    const open = [...here.querySelectorAll("details")].map((one) => one.open);
    here.replaceWith(document.importNode(part, true));
    const drawn = document.getElementById(part.id);
    [...drawn.querySelectorAll("details")].forEach((one, at) => { if (open[at]) one.open = true; });
    drawn.dispatchEvent(new CustomEvent("admin:drawn", { bubbles: true }));
  }
}

// Where somebody has ticked something or stands, nothing moves under their hands.
function isBusy(part) {
  return part.querySelector("input[type=checkbox]:checked") !== null || part.contains(document.activeElement)
    || document.querySelector("dialog[open]") !== null;
}

document.addEventListener("visibilitychange", () => {
  if (document.hidden) {
    clearTimeout(timer);
    socket?.close();
  } else {
    listen();
    redraw();
  }
});
listen();
timer = setTimeout(redraw, POLL_MS);
