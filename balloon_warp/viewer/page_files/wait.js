// A splash until something moves; later, while something is made ready, a word above the view.
(() => {
  "use strict";
  const splash = document.createElement("div"), word = document.createElement("div");
  splash.id = "bw-splash";
  word.id = "bw-wait";
  for (const each of [splash, word]) each.setAttribute("role", "status");
  splash.innerHTML = '<div class="bw-balloon"></div><b>Balloon Warp</b>' +
    "<p>Getting ready. What is simulated here for the first time takes some seconds.</p>";

  function look() {
    const line = document.querySelector(".bw-status");
    const busy = splash.isConnected ? "" : line?.dataset.busy || "";
    if (word.textContent !== busy) word.textContent = busy;
    if (line?.hasAttribute("data-moves") || document.getElementById("refused")) splash.remove();
  }
  addEventListener("DOMContentLoaded", () => {
    document.body.append(splash, word);
    new MutationObserver(look).observe(document.body, {childList: true, subtree: true});
  });
})();
