// What was just done, said where it is in nobody's way, with a button that takes it back. What a page had to say when it
// led to another one is said there. Nothing depends on it: whoever misses it finds the same on the entry's own page.

import { redraw } from "./redraw.js";
import { newKey, send } from "./send.js";
import { say } from "./words.js";

const STAY_MS = 12000;
const NOTE = "ledger:note";

const toast = document.getElementById("toast");
let timer = 0;

/** Say what the page before had to say, and go away only while nobody looks. */
export function watchToast() {
  for (const event of ["pointerenter", "focusin"]) toast.addEventListener(event, () => clearTimeout(timer));
  for (const event of ["pointerleave", "focusout"]) toast.addEventListener(event, arm);
  document.addEventListener("keydown", ({ key }) => { if (key === "Escape") hide(); });
  try {
    const note = sessionStorage.getItem(NOTE);
    sessionStorage.removeItem(NOTE);
    if (note) show(note, "");
  } catch {
    // No storage: the next page says nothing.
  }
}

/** Leave a sentence for the page that comes next in this tab. */
export function sayThere(sentence) {
  try {
    sessionStorage.setItem(NOTE, sentence);
  } catch {
    // No storage: what was done is seen in the lists.
  }
}

/**
 * Say that something was saved, with a button that takes it back: {said, about, much, undo: {path, seq}}. It stands
 * behind `near` for who goes through the page by keys. `undone` is called once it was taken back.
 */
export function offerUndo({ said, about, much, undo }, near, undone) {
  const press = button(say("undo"), "", () => void takeBack(undo, key, press, undone));
  const key = newKey(); // one for each offer: pressed twice it is taken back once
  press.dataset.undo = "";
  near.after(toast);
  show(`${said} · ${about}`, much, press);
}

async function takeBack({ path, seq }, key, press, undone) {
  clearTimeout(timer);
  press.disabled = true;
  const line = press.parentElement.firstElementChild;
  tell(line, say("undoing"));
  const body = seq ? new URLSearchParams({ expected_seq: seq }).toString() : "";
  const answer = await send(path, { body, type: "application/x-www-form-urlencoded", key, onWaiting: () => tell(line, say("waiting")) });
  press.remove();
  if (answer.status >= 300) tell(line, answer.body.detail ?? say("unsaid"));
  else {
    tell(line, say("undone"));
    undone();
    void redraw();
  }
  arm();
}

function show(sentence, much, ...presses) {
  const line = document.createElement("span");
  const amount = document.createElement("b");
  amount.className = "number";
  toast.replaceChildren(line, amount, ...presses, button(say("receipt.R4.close"), "plain", hide));
  // A moment later: a status that comes together with its words is not read out.
  requestAnimationFrame(() => {
    line.textContent = sentence;
    amount.textContent = much;
  });
  arm();
}

// Of an offer that has made room for another one, what became of it is said all the same.
function tell(line, sentence) {
  if (!line.isConnected) return show(sentence, "");
  line.nextElementSibling.textContent = "";
  line.textContent = sentence;
  return undefined;
}

function arm() {
  clearTimeout(timer);
  timer = setTimeout(() => (document.hidden || toast.matches(":hover, :focus-within") || isCovered() ? arm() : hide()), STAY_MS);
}

// What the crisis script has to say may stand over it: its time begins when it can be read.
function isCovered() {
  const { left, top, width, height } = toast.getBoundingClientRect();
  return !toast.contains(document.elementFromPoint(left + width / 2, top + height / 2));
}

function hide() {
  clearTimeout(timer);
  toast.replaceChildren();
}

function button(text, kind, act) {
  const press = document.createElement("button");
  press.type = "button";
  press.className = kind;
  press.textContent = text;
  press.addEventListener("click", act);
  return press;
}
