// The crisis script: what a living page of the ledger says by itself when the server behind it goes away.
//
// It joins the others: frames come from channel.js, outage.js decides what an outage looks like, wording.js which
// sentences are true, screen.js shows them, drafts.js keeps what was typed. It knows no page by name; a page hears of
// it by three events and one attribute (docs/wires.md, section 10).

import { openChannel } from "./channel.js";
import { CALM, RESULT_STAY_MS, isQuiet, next } from "./outage.js";
import { face } from "./wording.js";
import { makeScreen } from "./screen.js";
import { makeBar } from "./bar.js";
import { keepDrafts } from "./drafts.js";
import { watchRequests } from "./slowness.js";
import { watchTyping } from "./typing.js";

const TICK_MS = 1000;
const PENDING_MAX = 999;
const RECEIPTS_MAX = 200;  // open or not yet seen, of one browser
const HEEDED = "hc:heeded";

let lang = document.documentElement.lang.startsWith("ko") ? "ko" : "en";
let { words } = await import(`./words.${lang}.js`);
let view = { ...CALM, heeded: heeded() };
let pending = 0;
let timer = 0;
let askNow = () => {};
let downWasTold = false;  // the page heard hc:down
let isAway = false;      // it is owed hc:back, because of that or because the line was lost
let backWasTold = false;  // by a state frame, before its back frame
let plainTitle = document.title;
let shownTitle = null;
let restored = null;

const receipts = new Map();  // key -> the last frame about it

const screen = makeScreen({ close: () => hear({ type: "dismiss" }), keep, other, undo, leave });
const sayBar = makeBar();
const drafts = keepDrafts(() => paint());
const requests = watchRequests(() => {
  if (requests.isSlow()) askNow();  // slow, or nobody there: the gateway answers at once if it can
  paint();
});
const typing = watchTyping();

function tell(name, detail) {
  document.dispatchEvent(new CustomEvent(name, { detail }));
}

function hear(said) {
  const now_ms = performance.now();
  if (said.type === "out" || (said.type === "state" && said.text !== null && !isAway)) drafts.saveAll();
  const { mode: was, heeded: wasHeeded } = view;
  view = next(view, said, now_ms);
  // Keys pressed into a dialog that has just opened are lost: it waits for a pause of whoever is typing.
  if (view.mode === "card" && was !== "card") {
    const due_ms = typing.pause(now_ms);
    if (due_ms > now_ms) view = { ...view, mode: "sign", due_ms };
  } else if (view.mode !== "sign") typing.rest();
  if (view.heeded !== wasHeeded) heeded(view.heeded);
  paint();
  announce(said);
  arm(now_ms);
}

// A verdict that was read is not said again on each page of this tab.
function heeded(value) {
  try {
    if (value !== undefined) sessionStorage.setItem(HEEDED, value ? "1" : "");
    return sessionStorage.getItem(HEEDED) === "1";
  } catch { return false; }  // no storage: it is said again
}

function announce(said) {
  if (said.type === "state") {
    tell("hc:state", said);
    if (said.text !== null) goneAway(said);
    else if (isAway) cameBack({ v: 1, type: "back", outage_ms: view.back?.outage_ms ?? null, verified: null, planned: said.planned }, true);
  } else if (said.type === "receipt") {
    receipts.delete(said.key);
    if (receipts.size < RECEIPTS_MAX) receipts.set(said.key, said);
    tell("hc:receipt", said);
  } else if (said.type === "lost") isAway = true;
  else if (said.type === "back") {
    if (backWasTold) backWasTold = false;
    else cameBack(said, false);
  }
}

function goneAway(frame) {
  backWasTold = false;
  isAway = true;
  if (!downWasTold) tell("hc:down", frame);
  downWasTold = true;
}

function cameBack(frame, byState) {
  isAway = false;
  downWasTold = false;
  backWasTold = byState;
  tell("hc:back", frame);
}

function paint() {
  const facts = {
    pending, receipt: [...receipts.values()].findLast(({ outcome }) => outcome === "waiting")?.key ?? null,
    draft: drafts.standing(), slow: requests.isSlow(), alive: true, unheard: false, request: null,
  };
  const shown = face(view, facts, performance.now(), words);
  const isOut = (view.mode === "sign" || view.mode === "card") && !isQuiet(view);
  const downs = { OFF: "off", R8: "stopped" };
  mark(isOut ? downs[view.frame.text] ?? "down" : view.mode === "lost" ? "down" : view.mode === "out" ? "out" : shown.bar ? "safe" : facts.slow && view.mode === "calm" ? "slow" : "serving");
  if (window.parent === window) {
    screen.show(shown, words, lang, view.mode === "card", drafts.asText() !== "");
    sayBar(shown.bar, lang);
  }
  nameTab(shown.title);
}

// Only when it changes: a page may watch it.
function mark(state) {
  const { dataset } = document.documentElement;
  if (dataset.hc !== state) dataset.hc = state;
}

// The page may rename itself meanwhile: what it calls itself is kept, our sign stands before it.
function nameTab(sign) {
  if (document.title !== shownTitle) plainTitle = document.title;
  shownTitle = sign === null ? plainTitle : `${sign} ${plainTitle}`;
  if (document.title !== shownTitle) document.title = shownTitle;
}

// Good news waits for the reader: nothing goes away by itself in a tab that nobody sees, or under the pointer. It is
// looked every second whether somebody does, because whoever has just come back has half of the time still to read.
function arm(now_ms) {
  clearTimeout(timer);
  if (view.mode === "card") timer = setTimeout(() => { paint(); arm(performance.now()); }, TICK_MS);
  else if (view.due_ms !== Infinity) timer = setTimeout(stay, Math.min(TICK_MS, Math.max(0, view.due_ms - now_ms)));
}

function stay() {
  const isRead = !document.hidden && !screen.card.element.matches(":hover,:focus-within");
  if (view.mode !== "sign" && !isRead) view = { ...view, due_ms: performance.now() + RESULT_STAY_MS / 2 };
  hear({ type: "tick" });
}

async function keep() {
  const typed = drafts.asText();
  try {
    await navigator.clipboard.writeText(typed);
    screen.card.copied("keep.done", words);
  } catch {  // no permission, or no secure context: a plain address in a home network has none
    const { byHand } = screen.card;
    byHand.hidden = false;
    byHand.value = typed;
    byHand.select();
    screen.card.copied(document.execCommand("copy") ? "keep.done" : "keep.byhand", words);
  }
}

async function other() {
  const wanted = lang === "ko" ? "en" : "ko";
  ({ words } = await import(`./words.${wanted}.js`));
  lang = wanted;
  paint();
}

function undo() {
  const filled = restored;
  leave();
  filled?.undo();
}

function leave() {
  if (restored) screen.note(null, words);
  restored = null;
}

document.addEventListener("hc:pending", (event) => {
  pending = Math.min(PENDING_MAX, Math.max(0, Number(event.detail?.count) || 0));
  paint();
});
// A page's own script may be there later than what it wants to hear.
document.addEventListener("hc:receipts", () => receipts.forEach((said) => tell("hc:receipt", said)));
document.addEventListener("hc:sent", leave);
// Whoever types on has taken the draft; undoing it now would take the new words along.
document.addEventListener("input", (event) => { if (event.isTrusted) leave(); });

restored = drafts.restore();
if (restored) screen.note({ head: words.R13, line: words[restored.tried ? "R13.tried" : "R13.unsent"] }, words);
askNow = openChannel(hear);
