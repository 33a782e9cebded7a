// Where a person was: the field, the selection in it, and how far the page was scrolled.
//
// A modal dialog takes the focus away; giving it back to the element alone would put the caret at the start of a
// long text. Kinds of fields that have no selection (numbers, dates) say so by null or by an error.

function deepFocus() {
  let element = document.activeElement;
  while (element?.shadowRoot?.activeElement) element = element.shadowRoot.activeElement;
  return element;
}

function selectionIn(element) {
  try { return element.selectionStart === null ? null : [element.selectionStart, element.selectionEnd, element.selectionDirection]; }
  catch { return null; }  // this kind of field has no selection
}

/** Remember the place; the function that is returned goes back to it. */
export function rememberPlace() {
  const element = deepFocus();
  const marked = element && "selectionStart" in element ? selectionIn(element) : null;
  const range = getSelection()?.rangeCount ? getSelection().getRangeAt(0).cloneRange() : null;
  const { scrollX, scrollY } = window;
  const inner = element ? [element.scrollLeft, element.scrollTop] : null;

  return function goBack() {
    if (element?.isConnected && element !== document.body) {
      element.focus({ preventScroll: true });
      if (marked) element.setSelectionRange(...marked);
      [element.scrollLeft, element.scrollTop] = inner;
    }
    if (!marked && range && range.startContainer.isConnected) {
      getSelection().removeAllRanges();
      getSelection().addRange(range);
    }
    scrollTo({ left: scrollX, top: scrollY, behavior: "instant" });
  };
}
