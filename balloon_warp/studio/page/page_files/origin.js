// Behind a proxy the page loads, but its web socket is refused where the proxy's address is not one that may talk to
// the server: it asks, and says why it stands still.
(() => {
  "use strict";
  addEventListener("DOMContentLoaded", async () => {
    const answer = await fetch("may-i?from=" + encodeURIComponent(location.origin)).catch(() => null);
    if (!answer || answer.status !== 403) return;
    const note = document.createElement("div");
    note.id = "refused";
    note.setAttribute("role", "alert");
    const said = await answer.text();
    note.textContent = said[0].toUpperCase() + said.slice(1) + ".";
    document.body.append(note);
  });
})();
