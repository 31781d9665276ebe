function show(name, on) { viewer.set_property(path(name), "visible", on); viewer.set_dirty(); }

function layers() {
  for (const box of panel.querySelectorAll("input[data-paths]")) {
    const paths = box.dataset.paths.split(" ");
    const apply = () => paths.forEach(name => show(name, box.checked));
    box.addEventListener("change", apply);
    apply();
  }
}

let row = -1;
function tell() {  // which pose is shown, and how far its spots are off
  const now = Math.min(Math.max(Math.round(animator.time), 1), poses.length) - 1;
  if (now === row || !poses.length) return;
  row = now;
  const chooser = document.getElementById("pose");
  if (chooser) chooser.selectedIndex = row;
  poses[row].errors.forEach((pair, laser) => pair.forEach((error, phase) => {
    const cell = document.getElementById(`error-${laser}-${phase}`);
    if (cell) cell.textContent = error;
  }));
}
let playing = false;
function play(on) {
  playing = on;
  if (on) animator.play(); else animator.pause();
  const button = document.getElementById("play");
  if (button) { button.textContent = on ? "Pause" : "Play"; }
}
function goTo(number) {
  play(false);
  const time = Math.min(Math.max(number, 0), poses.length - 1) + 1;
  animator.seek(time); animator.display_progress(time); tell(); viewer.set_dirty();
}
function step(by) { goTo((row + by + poses.length) % poses.length); }

function controls() {
  const chooser = document.getElementById("pose");
  viewer.gui.__folders["Scene"].close();
  if (poses.length < 2) { viewer.gui.__folders["Animations"] && viewer.gui.__folders["Animations"].close(); return; }
  const labels = poses.map(pose => pose.label);
  animator.time_scrubber.name("pose number");
  animator.play(); animator.pause(); animator.seek(0);  // meshcat's slider moves only what has been played
  chooser.addEventListener("change", () => goTo(chooser.selectedIndex));
  document.getElementById("back").addEventListener("click", () => step(-1));
  document.getElementById("next").addEventListener("click", () => step(1));
  document.getElementById("play").addEventListener("click", () => play(!playing));
  const asked = () => { const at = labels.indexOf(decodeURIComponent(location.hash.replace(/^#pose=/, ""))); if (at >= 0) goTo(at); };
  window.addEventListener("hashchange", asked);
  asked();
}
