// What was promised: wishes that the gateway keeps and carries out when the server is back, and what became of them.
//
// A wish of this page waits here for its end, and its own form tells it. One whose page has gone is told on a card, in
// whatever tab of this browser is open or opened next: the gateway remembers what nobody has seen. It is asked for
// every claim; a frame on its line only says that it is time to ask. To keep the keys in localStorage was not chosen:
// two memories of one promise drift apart.

import { say } from "./words.js";

const LOOK_EVERY_MS = 5000;
const OWNER_FIRST_MS = 1500; // the page that sent it tells it, if it is still there
const OPEN = new Set(["waiting", "ask", "set_aside"]);

const mine = new Set(); // keys that this page waits for
const told = new Map(); // key -> the receipt that stands on the card
const turns = new Map(); // key -> who asks for it now: the last frame's
const unheard = new Set(); // keys whose person has given a word that did not get through

/** What a person is told as its number: the end of the key, which is random in every kind of key. */
export function numberOf(key) {
  return key.slice(-8);
}

/**
 * Wait for the end of what was promised under this key, and return {status, body} as its answer; null if nothing was.
 * `onOpen` gets what it is meanwhile: waiting, ask or set_aside.
 */
export async function settled(key, onOpen) {
  mine.add(key);
  try {
    for (;;) {
      const receipt = await receiptOf(key);
      if (receipt === null) return null;
      if (receipt && !OPEN.has(receipt.outcome)) {
        void give(key, "seen");
        return answerOf(receipt);
      }
      if (receipt) onOpen(receipt.outcome);
      await news(key);
    }
  } finally {
    mine.delete(key);
  }
}

// The receipt, null if nothing was promised, undefined if nobody answers now.
async function receiptOf(key) {
  try {
    const response = await fetch(placeOf(key), { headers: { Accept: "application/json" }, cache: "no-store" });
    return response.status === 404 ? null : response.ok ? await response.json() : undefined;
  } catch {
    return undefined; // the gateway is away for a moment
  }
}

function placeOf(key) {
  return `/__hc/receipts/${encodeURIComponent(key)}`;
}

// The status of the answer, undefined if there was none.
async function give(key, word) {
  try {
    return (await fetch(`${placeOf(key)}/${word}`, { method: "POST", keepalive: true })).status;
  } catch {
    return undefined;
  }
}

// The line tells each change; the clock is for a page without it.
function news(key) {
  return new Promise((resolve) => {
    const timer = setTimeout(done, LOOK_EVERY_MS);
    function heard({ type, detail }) {
      if (type === "hc:back" || detail.key === key) done();
    }
    function done() {
      clearTimeout(timer);
      for (const event of ["hc:receipt", "hc:back"]) document.removeEventListener(event, heard);
      resolve();
    }
    for (const event of ["hc:receipt", "hc:back"]) document.addEventListener(event, heard);
  });
}

// An unknown one is no answer to the wish: with a status of the server's own its key stays, so that it can't be done twice.
function answerOf({ outcome, status, answer }) {
  if (outcome === "done") return { status: status ?? 200, body: answer ?? {} };
  if (outcome === "already_done") return { status: status ?? 200, body: { said: sentence(outcome), ...answer } };
  if (outcome === "refused") return { status: status ?? 422, body: answer ?? {} };
  return { status: outcome === "unknown" ? 503 : 409, body: { outcome, detail: sentence(outcome) } };
}

function sentence(outcome) {
  return `${say(`receipt.${outcome}`)} · ${say(`receipt.${outcome}.line`)}`;
}

/* The card */

/** Tell what nobody else tells, for as long as the page is open. */
export function watchReceipts() {
  document.addEventListener("hc:receipt", ({ detail }) => void heard(detail));
  document.dispatchEvent(new CustomEvent("hc:receipts")); // what was said before this page listened
}

async function heard({ key, outcome }) {
  if (outcome === "waiting") return forget([key]);
  if (!OPEN.has(outcome)) {
    if (mine.has(key)) return forget([key]);
    await new Promise((resolve) => { setTimeout(resolve, OWNER_FIRST_MS); });
  }
  return look(key);
}

// Asked until it is known: a gateway that is away for a moment would leave a person without the question.
async function look(key) {
  const turn = {};
  turns.set(key, turn);
  let receipt;
  while ((receipt = await receiptOf(key)) === undefined && turns.get(key) === turn) await news(key);
  if (turns.get(key) !== turn) return;
  turns.delete(key);
  if (!receipt || receipt.seen || receipt.outcome === "waiting") forget([key]);
  else {
    told.set(key, receipt);
    draw();
  }
}

function forget(keys) {
  for (const key of keys) {
    told.delete(key);
    turns.delete(key);
    unheard.delete(key);
  }
  draw();
}

function draw() {
  const place = document.getElementById("receipts");
  const all = [...told.values()];
  const settledOnes = all.filter(({ outcome }) => !OPEN.has(outcome));
  const asked = all.filter(({ outcome }) => OPEN.has(outcome));
  place.replaceChildren(...asked.map(question), ...(settledOnes.length ? [result(settledOnes)] : []));
}

function question(receipt) {
  const asks = receipt.outcome === "ask";
  const head = say(asks ? "receipt.R5" : "receipt.set_aside");
  const line = say(asks ? "receipt.R5.line" : "receipt.set_aside.line");
  const words = asks ? ["run", "cancel"] : ["cancel"];
  const number = receipt.letter ? [say("receipt.set_aside.number", { id: numberOf(receipt.letter) })] : [];
  const lines = [line, ...number, about(receipt), ...(unheard.has(receipt.key) ? [say("receipt.R5.unheard")] : [])];
  return card(head, lines, words.map((word) => {
    const press = button(say(`receipt.R5.${word}`), word === "run" ? "primary" : "");
    press.addEventListener("click", () => {
      press.disabled = true;
      void decide(receipt.key, word);
    });
    return press;
  }));
}

// A word that does not fit (409) was overtaken: what stands now is shown. One that nobody took is asked for once more.
async function decide(key, word) {
  const status = await give(key, word);
  if (status >= 200 && status < 300) return forget([key]);
  if (status !== 409) unheard.add(key);
  draw();
  return look(key);
}

function about({ key, kept_at: at }) {
  const when = new Date(at).toLocaleString(document.documentElement.lang, { dateStyle: "medium", timeStyle: "short" });
  return `${say("receipt.sent", { when })} · ${say("receipt.number", { id: numberOf(key) })}`;
}

function result(receipts) {
  const count = (...outcomes) => receipts.filter(({ outcome }) => outcomes.includes(outcome)).length;
  const open = count("unknown");
  const lines = [
    say("receipt.R4.line", { done: count("done"), already: count("already_done"), not_done: count("not_done", "refused") }),
    ...new Set(receipts.filter(({ outcome }) => outcome === "refused").map(({ answer }) => answer?.detail).filter(Boolean)),
    ...(open ? [`${say("receipt.R4.open", { n: open })} · ${say("receipt.unknown.line")}`] : []),
  ];
  const view = document.createElement("a");
  view.className = "button";
  view.href = "/register";
  view.textContent = say("receipt.R4.view");
  const close = button(say("receipt.R4.close"), "");
  for (const press of [view, close]) {
    press.addEventListener("click", () => {
      const keys = receipts.map(({ key }) => key);
      for (const key of keys) void give(key, "seen");
      forget(keys);
    });
  }
  return card(say("receipt.R4"), lines, [view, close]);
}

function card(head, lines, presses) {
  const element = document.createElement("section");
  element.className = "card";
  const title = document.createElement("h2");
  title.textContent = head;
  const doing = document.createElement("div");
  doing.className = "doing";
  doing.append(...presses);
  element.append(title, ...lines.map((line) => {
    const said = document.createElement("p");
    said.textContent = line;
    return said;
  }), doing);
  return element;
}

function button(text, kind) {
  const press = document.createElement("button");
  press.type = "button";
  press.className = kind;
  press.textContent = text;
  return press;
}
