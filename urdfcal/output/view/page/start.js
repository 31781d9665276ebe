function follow() {  // the window and what is pressed
  const fold = document.getElementById("fold"), sign = () => { fold.textContent = panel.classList.contains("folded") ? "+" : "\u2212"; };
  fold.addEventListener("click", () => { panel.classList.toggle("folded"); sign(); if (!touched) lookAtAll(); });
  pane.addEventListener("pointerdown", () => { touched = true; });
  pane.addEventListener("wheel", () => { touched = true; });
  window.addEventListener("resize", () => { if (!touched) lookAtAll(); });
  if (pane.clientWidth < 700) panel.classList.add("folded");
  sign();
}

async function start() {
  begin(); follow();
  await load();
  copyGhost(); orderBeams(); layers(); controls(); viewer.set_3d_pane_size(); lookAtAll(); tell();
  (function watch() { tell(); requestAnimationFrame(watch); })();
  requestAnimationFrame(() => requestAnimationFrame(() => { document.documentElement.dataset.ready = performance.now().toFixed(0); }));
}

start().catch(error => {
  const box = document.getElementById("trouble");
  box.style.display = "block";
  box.textContent = "This scene cannot be shown: " + error + ". A browser of 2023 or newer with WebGL is needed.";
  console.error(error);
});
