// The recovery page's own script: the card alive, and the way back to the page that was asked for.
//
// It stands at the address somebody wanted. When the ledger is served again, that address is opened anew; unless the
// page answers a form: nothing is sent again by itself, so there the way back is a link. What stood in the form may
// stand in this page, to be kept by the gateway if its person says so: a form that works without this script too.

import { openChannel } from "./channel.js";
import { CALM, next } from "./outage.js";
import { face } from "./wording.js";
import { makeCard } from "./card.js";

const SPREAD_MS = 150;  // many browsers wait for the same moment
const REOPEN_PAUSE_MS = 2000;  // after a return that led here again
const REOPENED = "hc:reopened";
const YEAR_S = 31536000;

const { kind, outcome } = document.body.dataset;
const OPENING = {
  recovering: { text: "R1", planned: false, phase: "STARTING" },
  planned: { text: "R2", planned: true, phase: "STARTING" },
  stopped_trying: { text: "R8", planned: false, phase: "FATAL" },
  off: { text: "OFF", planned: false, phase: "STOPPED" },
};
const first = { v: 1, type: "state", stage: null, stages: 4, elapsed_ms: 0, eta: null, samples: 0, incident: null, held: 0, ...OPENING[kind] };
const facts = { pending: 0, draft: null, slow: false, alive: false, unheard: true, receipt: null, request: outcome === "get" ? null : outcome };

let lang = document.documentElement.lang === "ko" ? "ko" : "en";
let isBack = false;
// The page itself is the overlay, so it begins as one.
let view = { ...next(CALM, first, performance.now()), mode: "card", due_ms: Infinity };

const wish = document.querySelector("form");  // of a page that offers to have it kept
const card = makeCard({ close() {}, keep() {}, other });
card.head.ariaLevel = "1";  // the page has no other heading
const live = document.createElement("p");
const link = document.createElement("a");
const notice = document.createElement("p");
live.setAttribute("role", "status");
live.className = "unseen";
link.className = "button";
notice.className = "muted";
card.acts.prepend(link);
if (wish) card.element.querySelector(".strong").after(wish);
document.querySelector("main").replaceChildren(card.element, notice, live);

function other() {
  lang = lang === "ko" ? "en" : "ko";
  document.cookie = `lang=${lang}; Path=/; SameSite=Lax; Max-Age=${YEAR_S}`;
  paint();
}

function paint() {
  const words = WORDS[lang];
  const shown = face(view, facts, performance.now(), words);
  link.hidden = !isBack || outcome === "get";
  card.show({ ...shown.card, closes: false }, words, false);
  document.documentElement.lang = lang;
  document.title = [shown.title, shown.card.head].filter(Boolean).join(" ");
  link.textContent = words.reopen;
  if (wish) wish.lastElementChild.textContent = words["keepable.do"];
  notice.hidden = outcome !== "get" || shown.card.closes;
  notice.textContent = words.reopens;
  if (live.textContent !== shown.status) live.textContent = shown.status;
}

function wayBack() {
  const from = document.referrer;
  return from && new URL(from).origin === location.origin ? from : "/";
}

function cameBackHere() {
  try {
    const last_ms = Number(sessionStorage.getItem(REOPENED) ?? 0);
    sessionStorage.setItem(REOPENED, String(Date.now()));
    return Date.now() - last_ms < REOPEN_PAUSE_MS;
  } catch { return false; }  // no storage: the spread has to do
}

function reopen() {
  if (isBack) return;
  isBack = true;
  if (outcome !== "get") {
    link.href = wayBack();
    return;
  }
  const pause_ms = Math.random() * SPREAD_MS + (cameBackHere() ? REOPEN_PAUSE_MS : 0);
  // With a fragment, replacing an address by itself only scrolls.
  setTimeout(() => (location.hash ? location.reload() : location.replace(location.href)), pause_ms);
}

openChannel((said) => {
  if (said.type === "out" && outcome === "get") {  // the same address asks to sign in
    reopen();
    return;
  }
  if (said.type === "state") facts.unheard = false;
  if (said.type === "receipt" && said.outcome === "waiting") facts.receipt = said.key;
  view = next(view, said, performance.now());
  if (said.type === "back" || (said.type === "state" && said.text === null)) reopen();
  if (view.mode === "calm" || view.mode === "sign") view = { ...view, mode: "card" };
  paint();
});
setInterval(paint, 1000);
paint();
