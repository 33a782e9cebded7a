// The dashboard's page in the browser: finished by the server, kept fresh here, and asked before it does something.
//
// Everything works without this file; with it, questions come as a dialog on the same page, and what is shown follows
// the ledger while somebody looks. There is no second set of templates: the server draws, the page takes over.

import "./live.js";
import "./questions.js";
import "./selection.js";

// A form that is sent once: what takes a while must not be sent again by an impatient finger.
document.addEventListener("submit", (event) => {
  const form = event.target;
  if (event.defaultPrevented || !form.matches("[data-once]")) return;
  if (form.dataset.sent) event.preventDefault();
  form.dataset.sent = "yes";
  form.querySelector("button")?.setAttribute("aria-disabled", "true");
});
addEventListener("pageshow", () => {
  for (const form of document.querySelectorAll("[data-sent]")) {
    delete form.dataset.sent;
    form.querySelector("button")?.removeAttribute("aria-disabled");
  }
});
