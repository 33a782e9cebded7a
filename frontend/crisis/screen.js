// What stands over the living page: a strip, an overlay, a result in the corner, a notice.
//
// Everything is in one shadow root, so that neither the page's style nor ours reaches the other, and in the
// browser's top layer, so that it stands over a dialog which the page has open. The page underneath is not touched:
// its fields, its scrolling and its selection are what they were. Only the overlay is modal.

import { button, makeCard } from "./card.js";
import { rememberPlace } from "./place.js";

const SETTLE_MS = 180;

function layer(className, ...children) {
  const element = document.createElement("aside");
  element.className = className;
  element.popover = "manual";
  element.append(...children);
  return element;
}

function text(className) {
  const element = document.createElement("span");
  element.className = className;
  return element;
}

function raise(element, shown) {
  if (element.matches(":popover-open") !== shown) element.togglePopover(shown);
}

/** Build the screen. `acts`: {close, keep, other, undo, leave}, called when their button is pressed. */
export function makeScreen(acts) {
  const host = document.createElement("div");
  const root = host.attachShadow({ mode: "open" });
  const style = document.createElement("link");
  style.rel = "stylesheet";
  style.href = new URL("client.css", import.meta.url).href;

  const stripHead = text("strong");
  const stripLine = text("muted");
  const strip = layer("strip", stripHead, stripLine);
  const noticeHead = text("strong");
  const noticeLine = text("muted");
  const undo = button("", acts.undo);
  const leave = button("plain", acts.leave);
  const notice = layer("strip notice", noticeHead, noticeLine, undo, leave);
  const card = makeCard(acts);
  const corner = layer("corner");
  const overlay = document.createElement("dialog");
  overlay.setAttribute("closedby", "none");
  overlay.setAttribute("aria-labelledby", card.head.id);
  const status = document.createElement("p");
  status.setAttribute("role", "status");
  status.className = "unseen";
  root.append(style, strip, corner, overlay, notice, status);
  document.body.append(host);

  let goBack = null;  // set while the overlay is open
  let mayClose = false;

  // Escape: a browser may close a dialog at the second press whatever a script says, so it is opened again.
  overlay.addEventListener("cancel", (event) => { if (!mayClose) event.preventDefault(); else acts.close(); });
  overlay.addEventListener("keydown", (event) => {
    if (event.key !== "Escape") return;
    event.preventDefault();
    if (mayClose) acts.close();
  });
  overlay.addEventListener("close", () => { if (goBack) overlay.showModal(); });

  function openOverlay() {
    if (goBack) return;
    goBack = rememberPlace();
    overlay.append(card.element, status);
    overlay.showModal();
    card.head.focus({ preventScroll: true });
  }

  function closeOverlay() {
    if (!goBack) return;
    const back = goBack;
    goBack = null;
    card.reset();
    overlay.close();
    root.append(status);
    back();
  }

  // The same card goes on standing where it is out of the way; it glides there, so that nothing flashes.
  function settle(shown) {
    if (shown && card.element.parentNode !== corner) {
      const from = card.element.getBoundingClientRect();
      closeOverlay();
      corner.append(card.element);
      raise(corner, true);
      const to = card.element.getBoundingClientRect();
      if (from.width > 0 && !matchMedia("(prefers-reduced-motion: reduce)").matches) {
        const shift = `translate(${from.left - to.left}px, ${from.top - to.top}px)`;
        card.element.animate([{ transform: shift }, { transform: "none" }], { duration: SETTLE_MS, easing: "ease-out" });
      }
    }
    raise(corner, shown);
  }

  function show(face, words, lang, modal, keeps) {
    host.lang = lang;
    if (face.card) {
      mayClose = face.card.closes;
      card.show(face.card, words, modal && keeps);
    }
    if (face.card && modal) {
      raise(corner, false);
      openOverlay();
    } else {
      settle(face.card !== null);
      closeOverlay();
    }
    sayStrip(face.card ? null : face.strip);
    if (status.textContent !== face.status) status.textContent = face.status;
  }

  function sayStrip(said) {
    if (said) {
      strip.dataset.tone = said.tone;
      if (stripHead.textContent !== said.head) stripHead.textContent = said.head;
      stripLine.textContent = said.line ?? "";
    }
    raise(strip, said !== null);
  }

  /** Say that a draft was restored; null takes the notice away. */
  function note(said, words) {
    if (said) {
      noticeHead.textContent = notice.ariaLabel = said.head;
      noticeLine.textContent = said.line;
      undo.textContent = words.undo;
      leave.textContent = words.close;
    }
    raise(notice, said !== null);
  }

  return { show, note, card };
}
