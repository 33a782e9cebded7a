// Asks before something is done, on the page where the button was pressed: the form's own answer is a page with a
// question, and its form is lifted into a dialog here. Where that fails, the browser simply goes to that page.

document.addEventListener("submit", async (event) => {
  const form = event.target;
  if (!form.matches("[data-ask]")) return;
  event.preventDefault();
  const body = new URLSearchParams(new FormData(form, event.submitter));
  try {
    const response = await fetch(form.action, { method: "POST", body, headers: { Accept: "text/html" } });
    const page = new DOMParser().parseFromString(await response.text(), "text/html");
    const asked = page.getElementById("confirm");
    if (asked) ask(document.importNode(asked, true), event.submitter);
    else location.assign(response.redirected ? response.url : location.href);
  } catch {
    HTMLFormElement.prototype.submit.call(withButton(form, event.submitter));
  }
});

function ask(question, button) {
  const dialog = document.createElement("dialog");
  dialog.setAttribute("aria-labelledby", "confirm-title");
  dialog.append(question);
  question.querySelector("[data-keep]")?.addEventListener("click", (event) => {
    event.preventDefault();
    dialog.close();
  });
  dialog.addEventListener("close", () => {
    dialog.remove();
    button?.focus();
  });
  document.body.append(dialog);
  dialog.showModal();
}

// A form that is sent by a script leaves its button out; the button says what is wanted.
function withButton(form, button) {
  if (button?.name) {
    const field = document.createElement("input");
    field.type = "hidden";
    field.name = button.name;
    field.value = button.value;
    form.append(field);
  }
  return form;
}
