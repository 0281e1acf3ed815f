// A splash until something moves; later, above the view, a word while something is made ready, and what went wrong:
// on a phone the panel that says so is folded.
(() => {
  "use strict";
  const [splash, word, trouble] = ["div", "div", "div"].map((tag) => document.createElement(tag));
  splash.id = "bw-splash";
  word.id = "bw-wait";
  trouble.id = "bw-wrong";
  for (const each of [splash, word, trouble]) each.setAttribute("role", "status");
  splash.innerHTML = '<div class="bw-balloon"></div><b>Balloon Warp</b>' +
    "<p>Getting ready. The first run of a scene compiles for some seconds.</p>";

  function back() {  // as the panel's own button
    const there = [...document.querySelectorAll("button")].filter((each) => !trouble.contains(each));
    there.find((each) => each.textContent.trim() === "Go back")?.click();
  }
  function tell(sentence) {
    if (trouble.dataset.said === sentence) return;
    trouble.dataset.said = sentence;
    const button = document.createElement("button");
    button.textContent = "Go back";
    button.addEventListener("click", back);
    trouble.replaceChildren(...(sentence ? [sentence, button] : []));
  }
  function look() {
    tell(document.querySelector(".bw-trouble")?.textContent || "");
    const line = document.querySelector(".bw-status");
    const busy = splash.isConnected ? "" : line?.dataset.busy || "";
    if (word.textContent !== busy) word.textContent = busy;
    if (line?.hasAttribute("data-moves") || document.getElementById("refused")) splash.remove();
  }
  addEventListener("DOMContentLoaded", () => {
    document.body.append(splash, word, trouble);
    new MutationObserver(look).observe(document.body, {childList: true, subtree: true});
  });
})();
