// Which wishes of this browser were promised to be carried out later, and have not been told to anybody yet.
//
// The keys alone are kept, where every tab of this browser finds them: a tab that is opened after the one that sent
// has been closed tells what became of it. Nothing is ever sent from here, and what was wished is not written down.

export const PROMISED = "hc:receipts";

/** The keys, oldest first. */
export function promised() {
  try { return JSON.parse(localStorage.getItem(PROMISED)).map(({ key }) => key); } catch { return []; }  // none, or no storage
}

/** What a person is told as the number of a receipt: the end of its key, which is random in every kind of key. */
export function numberOf(key) {
  return key.slice(-8);
}
