// Keys for who writes many entries: one letter each, by its place on the keyboard, because a Korean keyboard sends another
// letter from there. They rest while somebody types, and can be switched off: a voice that is turned into letters would
// press them by chance.

const OFF = "ledger:keys-off";
const NEW = "#new"; // no id: the browser would go there by itself, and take the focus away
const FIND = "#find";

const help = document.getElementById("keys");

/** Listen to the keys of every page. */
export function watchKeys() {
  const on = help.querySelector("input");
  on.checked = !isOff();
  on.addEventListener("change", () => setOff(!on.checked));
  for (const press of document.querySelectorAll("[data-keys]")) press.addEventListener("click", () => help.showModal());
  document.addEventListener("keydown", heard);
  if (location.hash === NEW) begin();
  if (location.hash === FIND) find();
}

function heard(event) {
  const { code, key, shiftKey, target } = event;
  const isTyped = event.ctrlKey || event.metaKey || event.altKey || event.isComposing || event.repeat
    || target.closest("input, select, textarea, dialog, [contenteditable]");
  if (isTyped || isOff() || document.querySelector("dialog[open]")) return;
  const act = { "/": find, "?": () => help.showModal() }[key] ?? (shiftKey ? null : ofPlace(code));
  if (!act) return;
  event.preventDefault();
  act();
}

function ofPlace(code) {
  const way = document.querySelectorAll(".ways a")[Number(/^(?:Digit|Numpad)([1-9])$/.exec(code)?.[1]) - 1];
  if (way) return () => way.click();
  const undo = document.querySelector("#toast [data-undo]");
  return { KeyN: begin, KeyU: undo && (() => undo.click()) }[code];
}

function begin() {
  const field = document.querySelector("form#entry [name=description]");
  if (!field) return location.assign(`/${NEW}`);
  field.focus();
  return field.scrollIntoView({ block: "center" });
}

function find() {
  const field = document.getElementById("find-q");
  if (!field) return location.assign(`/register${FIND}`);
  return field.select();
}

function isOff() {
  try {
    return localStorage.getItem(OFF) === "1";
  } catch {
    return false; // no storage: as everybody has them
  }
}

function setOff(off) {
  try {
    localStorage.setItem(OFF, off ? "1" : "");
  } catch {
    // Nowhere to remember it.
  }
}
