// The card: one element that can say everything of an outage, in the overlay, as a result, and on the recovery page.
//
// It is built once and then only its words change, so that a screen reader, a selection in it and the open details
// survive every update. Texts go in as text, never as markup.

const MARKS = { done: "✓", now: "▸", next: "○" };

function make(name, className, ...children) {
  const element = document.createElement(name);
  if (className) element.className = className;
  element.append(...children);
  return element;
}

function say(element, text) {
  element.hidden = text === null || text === "";
  if (!element.hidden && element.textContent !== text) element.textContent = text;
}

/** A button with a word on it. */
export function button(className, act) {
  const element = make("button", className);
  element.type = "button";
  element.addEventListener("click", act);
  return element;
}

function sayLines(list, lines) {
  while (list.children.length > lines.length) list.lastChild.remove();
  while (list.children.length < lines.length) list.append(make("p", ""));
  lines.forEach((line, index) => say(list.children[index], line));
}

function sayWaiting(list, waiting) {
  list.hidden = waiting.length === 0;
  while (list.children.length > waiting.length) list.lastChild.remove();
  while (list.children.length < waiting.length) list.append(make("p", "waiting", make("strong", ""), " ", make("span", "")));
  waiting.forEach(({ head, line }, index) => {
    say(list.children[index].firstChild, head);
    say(list.children[index].lastChild, line);
  });
}

function sayStages(list, stages) {
  list.hidden = stages.length === 0;
  while (list.children.length > stages.length) list.lastChild.remove();
  while (list.children.length < stages.length) {
    const mark = make("span", "mark");
    mark.setAttribute("aria-hidden", "true");
    list.append(make("li", "", mark, make("span", "name"), make("span", "word")));
  }
  stages.forEach((stage, index) => {
    const item = list.children[index];
    const [mark, name, word] = item.children;
    item.className = stage.mark;
    if (stage.mark === "now") item.setAttribute("aria-current", "step");
    else item.removeAttribute("aria-current");
    say(mark, MARKS[stage.mark]);
    say(name, stage.name);
    say(word, stage.took === null ? stage.word : `${stage.word} · ${stage.took}`);
  });
}

/** Build a card. `pressed`: {close, keep, other}, called when their button is. */
export function makeCard(pressed) {
  const head = make("h2", "");
  head.id = "hc-head";
  head.tabIndex = -1;
  const lines = make("div", "lines");
  const strong = make("p", "strong");
  const bar = make("progress", "");
  const time = make("p", "time");
  const stages = make("ol", "");
  const waiting = make("div", "lines");
  const summary = make("summary", "");
  const more = make("div", "lines");
  const details = make("details", "", summary, more);
  const keep = button("", pressed.keep);
  const close = button("", pressed.close);
  const other = button("plain", pressed.other);
  const admin = make("a", "button");
  admin.href = "/admin/";
  const acts = make("div", "acts", close, keep, admin);
  const byHand = make("textarea", "");
  byHand.readOnly = true;
  byHand.hidden = true;
  const element = make("section", "card", head, lines, strong, bar, time, stages, waiting, byHand,
    acts, make("div", "foot", details, other));
  element.setAttribute("aria-labelledby", head.id);

  let kept = "keep";

  function show(card, words, keeps) {
    element.dataset.tone = card.tone;
    say(head, card.head);
    sayLines(lines, card.lines);
    say(strong, card.strong);
    say(time, card.time);
    bar.hidden = card.progress === null;
    if (card.progress !== null) bar.value = Math.max(card.progress, bar.value);
    bar.setAttribute("aria-label", card.head);
    sayStages(stages, card.stages);
    sayWaiting(waiting, card.waiting);
    details.hidden = card.details.length === 0;
    say(summary, words.details);
    sayLines(more, card.details);
    say(close, card.closes ? words.close : null);
    say(keep, keeps ? words[kept] : null);
    say(admin, card.admin);
    acts.hidden = [...acts.children].every((child) => child.hidden);
    say(other, words.other);
  }

  /** Begin anew: nothing is left on it of the outage before. */
  function reset() {
    kept = "keep";
    bar.value = 0;
    byHand.hidden = true;
  }

  /** Say on the button what became of the copying: `keep.done` or `keep.byhand`. */
  function copied(code, words) {
    kept = code;
    say(keep, words[code]);
  }

  return { element, head, acts, byHand, show, reset, copied };
}
