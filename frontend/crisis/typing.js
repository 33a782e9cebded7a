// Whether somebody is in the middle of typing, and when the next pause is expected.
//
// An overlay takes the focus, and keys pressed at that moment would be lost without a sign. So it waits for a short
// pause, though not for long: whoever types on and on has to hear of it too. A syllable that is still being composed
// is never cut, and ends by itself when nothing is typed.

const TYPING_MS = 1000;  // a key this recent: somebody is typing
const PAUSE_MS = 600;
const PATIENCE_MS = 1500;

/** Watch the keys of this page, without reading them. */
export function watchTyping() {
  let typed_ms = -Infinity;
  let since_ms = null;  // when something began to wait for a pause
  let composes = false;

  for (const kind of ["keydown", "compositionstart", "compositionupdate", "compositionend"]) {
    document.addEventListener(kind, (event) => {
      const field = event.composedPath()[0];
      if (!("defaultValue" in field || field.isContentEditable)) return;
      typed_ms = performance.now();
      composes = event.isComposing || kind === "compositionstart" || kind === "compositionupdate";
    }, true);
  }

  /** When the pause is there: `now_ms` if it is, or if nobody types, or if it has been waited for long enough. */
  function pause(now_ms) {
    const quiet_ms = now_ms - typed_ms;
    if (since_ms === null ? quiet_ms >= TYPING_MS : quiet_ms >= PAUSE_MS) return now_ms;
    since_ms ??= now_ms;
    const last_ms = composes ? Infinity : since_ms + PATIENCE_MS;
    return Math.max(now_ms, Math.min(typed_ms + PAUSE_MS, last_ms));
  }

  /** Forget that something waited. */
  function rest() {
    since_ms = null;
  }

  return { pause, rest };
}
