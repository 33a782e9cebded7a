// The bar at the head of a page that says that only reading is possible, or that its reader is signed out.
//
// Unlike a strip it stays for as long as that lasts, so it may cover nothing: it stands in the page's own flow, before
// everything else, and the page moves down by its height. It has a shadow root of its own, as the rest of the script.

/** Build the bar. Gives the function that shows what is said, `{head, line, act: the words of
    the way to sign in, beside: in a tab of its own}`, or takes the bar away (null). */
export function makeBar() {
  const place = document.createElement("div");
  place.className = "flow";
  const shadow = place.attachShadow({ mode: "open" });
  const look = document.createElement("link");
  look.rel = "stylesheet";
  look.href = new URL("client.css", import.meta.url).href;
  const strong = document.createElement("strong");
  const plain = document.createElement("span");
  const bar = document.createElement("aside");
  bar.className = "bar";
  const way = document.createElement("a");
  bar.append(strong, " ", plain, " ", way);
  shadow.append(look, bar);

  return (said, lang) => {
    if (said === null) {
      place.remove();
      return;
    }
    place.lang = lang;
    if (strong.textContent !== said.head) strong.textContent = said.head;
    if (plain.textContent !== said.line) plain.textContent = said.line;
    way.textContent = said.act;  // without words it is not there for anybody
    way.hidden = !said.act;
    way.target = said.beside ? "_blank" : "";
    way.href = `/__hc/sign-in?to=${encodeURIComponent(location.pathname + location.search)}`;
    if (!place.isConnected) document.body.prepend(place);
  };
}
