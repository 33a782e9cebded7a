// The script of the page at the gate: whoever followed a link from elsewhere may be signed in all the same.
//
// A strict cookie stays at home when another site leads here, so the page that was asked for is answered with the form.
// Our own question carries it: if somebody is in, the page is opened again, as a step of our own.

const ASK_TIMEOUT_MS = 3000;

async function look() {
  try {
    const response = await fetch("/__hc/me", { cache: "no-store", signal: AbortSignal.timeout(ASK_TIMEOUT_MS) });
    if (response.ok) location.replace(location.href);
  } catch { /* then the form is what there is */ }
}

// Whoever signed out leaves nothing behind for whoever comes next: what was typed and not sent is in this tab alone.
if (document.body.dataset.gate === "out") {
  try { sessionStorage.clear(); } catch { /* no storage: nothing was kept */ }
}
if (document.body.dataset.gate === "in" && !location.pathname.startsWith("/__hc/")) void look();
