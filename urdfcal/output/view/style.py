"""How the page around the scene looks and what it does: legend, layers, poses, camera."""

from __future__ import annotations

STYLE = """
html, body { margin: 0; height: 100%; overflow: hidden; background: #eef1f4; }
body {
  color: #1b2026;
  font: 14px/1.4 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", "Noto Sans", "Liberation Sans", Arial, sans-serif;
}
#meshcat-pane { position: absolute; inset: 0; overflow: hidden; }
#panel {
  position: absolute; left: 12px; top: 12px; width: 316px; max-height: calc(100% - 24px); overflow-y: auto; box-sizing: border-box;
  padding: 12px 14px; background: rgba(255, 255, 255, .94); border: 1px solid #d5dade; border-radius: 6px; z-index: 2;
}
#panel h1 { margin: 0; font-size: 17px; line-height: 1.25; overflow-wrap: anywhere; }
#panel p { margin: 2px 0 8px; color: #59636e; font-size: 13px; }
#panel h2 { margin: 12px 0 4px; font-size: 13px; font-weight: 600; color: #59636e; }
#panel label { display: flex; gap: 8px; align-items: flex-start; padding: 1px 0; font-size: 13px; cursor: pointer; }
#panel label svg { flex: none; width: 26px; height: 18px; margin-top: 1px; }
#panel label span { flex: 1; }
#panel label input { flex: none; margin: 3px 0 0; }
#panel label:has(input:not(:checked)) { color: #8b949d; }
#panel label:has(input:not(:checked)) svg { opacity: .35; }
#panel table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; font-size: 13px; }
#panel th, #panel td { padding: 2px 0 2px 6px; text-align: right; font-weight: 400; border-bottom: 1px solid #e5e9ec; white-space: nowrap; }
#panel thead th { color: #59636e; }
#panel thead tr:first-child th { border: 0; text-align: right; }
#panel th:first-child { text-align: left; padding-left: 0; white-space: normal; overflow-wrap: anywhere; }
#steps { display: flex; gap: 6px; margin: 4px 0 6px; }
#steps select { flex: 1; min-width: 0; font: inherit; padding: 3px; }
#steps button, #fold {
  font: inherit; padding: 3px 9px; border: 1px solid #c3cad1; border-radius: 4px; background: #fff; color: inherit; cursor: pointer;
}
#fold { position: absolute; right: 8px; top: 8px; padding: 0 7px; }
#panel.folded > :not(h1):not(#fold) { display: none; }
#panel.folded { width: auto; padding-right: 44px; }
#hint { font-size: 12px; color: #59636e; margin-top: 10px; }
#trouble {
  display: none; position: absolute; inset: 40% 20% auto; padding: 16px;
  background: #fff; border: 1px solid #a8201a; border-radius: 6px; z-index: 3;
}
@media (max-width: 640px) { #panel { width: 240px; } }
"""

SCRIPT = """
"use strict";
const config = JSON.parse(document.getElementById("urdfcal-config").textContent);
const pane = document.getElementById("meshcat-pane"), panel = document.getElementById("panel");
const viewer = new MeshCat.Viewer(pane), THREE = MeshCat.THREE;
const path = name => ["meshcat", ...name.split("/")];

async function load() {
  const {log, warn} = console;  // the Collada reader tells the version of every file, and of nodes that it leaves out
  for (const [name, say] of Object.entries({log, warn}))
    console[name] = (...words) => String(words[0]).startsWith("THREE.ColladaLoader") || say(...words);
  const text = document.getElementById("urdfcal-scene").textContent.trim();
  const bytes = Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
  const plain = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  const buffer = await new Response(plain).arrayBuffer(), view = new DataView(buffer);
  for (let at = 0; at < buffer.byteLength;) {
    const length = view.getUint32(at, true);
    const command = new Uint8Array(buffer.slice(at + 4, at + 4 + length));
    if (command[0] === 0x7b) viewer.handle_command(JSON.parse(new TextDecoder().decode(command)));
    else viewer.handle_command_bytearray(command);
    at += 4 + length;
  }
  Object.assign(console, {log, warn});
}

function copyGhost() {  // the nominal robot has the calibrated one's shapes: sent once, shown twice
  const pale = new THREE.MeshLambertMaterial({
    color: config.ghost.color, transparent: true, opacity: config.ghost.opacity, depthWrite: false, side: THREE.DoubleSide,
    polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 8});
  for (const name of config.ghost.names) {
    const solid = viewer.scene_tree.find(path("solid/visuals/" + name)).children["<object>"];
    if (!solid || !solid.object.geometry) continue;
    const copy = new THREE.Mesh(solid.object.geometry, pale);
    copy.position.copy(solid.object.position);
    copy.quaternion.copy(solid.object.quaternion);
    copy.scale.copy(solid.object.scale);
    viewer.set_object(path("nominal/visuals/" + name), copy);
  }
}

function orderBeams() {  // uncalibrated ones first, then the others over them, all before what else is seen through
  const marks = viewer.scene_tree.find(["meshcat"]).children.screen?.children.pose;  // none where there are no lasers
  for (const [name, node] of Object.entries(marks ? marks.children : {}))
    if (name.includes("beam")) node.object.renderOrder = name.startsWith("nominal") ? -2 : -1;
}

const WIDE = 1280;  // pixels from which there is room for meshcat's controls beside the scene
let touched = false;
function lookAtAll() {
  const w = pane.clientWidth, h = pane.clientHeight, camera = viewer.camera;
  const left = panel.classList.contains("folded") || w < 700 ? 0 : panel.offsetWidth + 12;
  const right_side = viewer.gui.closed ? 0 : viewer.gui.width, covered = left + right_side;
  const three = p => new THREE.Vector3(p[0], p[2], -p[1]);
  const back = three(config.sight.direction).normalize();
  const right = new THREE.Vector3(0, 1, 0).cross(back).normalize(), up = back.clone().cross(right);
  camera.fov = 36; camera.aspect = w / h;
  const ty = 0.94 * Math.tan(camera.fov * Math.PI / 360), tx = ty * Math.max(w - covered, 60) / h;
  const points = config.sight.points.map(three).map(p => [p.dot(right), p.dot(up), p.dot(back)]);
  let x = 0, y = 0, d = 10;
  for (let round = 0; round < 30; round++) {  // alternate between the middle of the picture and the distance
    const seen = points.map(p => [(p[0] - x) / (d - p[2]), (p[1] - y) / (d - p[2])]);
    const range = k => [Math.min(...seen.map(s => s[k])), Math.max(...seen.map(s => s[k]))];
    const near = Math.max(...points.map(p => p[2]));
    x += (range(0)[0] + range(0)[1]) / 2 * (d - near);
    y += (range(1)[0] + range(1)[1]) / 2 * (d - near);
    d = Math.max(...points.map(p => p[2] + Math.max(Math.abs(p[0] - x) / tx, Math.abs(p[1] - y) / ty)), near + 0.05);
  }
  const middle = (Math.max(...points.map(p => p[2])) + Math.min(...points.map(p => p[2]))) / 2;
  const at = z => right.clone().multiplyScalar(x).addScaledVector(up, y).addScaledVector(back, z);
  camera.position.copy(at(d)); viewer.controls.target.copy(at(middle));
  camera.far = Math.max(100, 20 * d);
  camera.setViewOffset(w, h, (right_side - left) / 2, 0, w, h);
  viewer.controls.update(); viewer.set_dirty();
}

function show(name, on) { viewer.set_property(path(name), "visible", on); viewer.set_dirty(); }

function layers() {
  for (const box of panel.querySelectorAll("input[data-paths]")) {
    const paths = box.dataset.paths.split(" ");
    const apply = () => paths.forEach(name => show(name, box.checked));
    box.addEventListener("change", apply);
    apply();
  }
}

const animator = viewer.animator, poses = config.poses;
let row = -1;
function tell() {  // which pose is shown, and how far its spots are off
  const now = Math.min(Math.max(Math.round(animator.time), 1), poses.length) - 1;
  if (now === row || !poses.length) return;
  row = now;
  const chooser = document.getElementById("pose");
  if (chooser) chooser.selectedIndex = row;
  if (config.own) { config.own.object[config.own.property] = poses[row].label; config.own.updateDisplay(); }
  poses[row].errors.forEach((pair, laser) => pair.forEach((error, phase) => {
    const cell = document.getElementById(`error-${laser}-${phase}`);
    if (cell) cell.textContent = error;
  }));
}
function goTo(number) {
  animator.pause();
  const time = Math.min(Math.max(number, 0), poses.length - 1) + 1;
  animator.seek(time); animator.display_progress(time); tell(); viewer.set_dirty();
}
function step(by) { goTo((row + by + poses.length) % poses.length); }

function controls() {
  const chooser = document.getElementById("pose");
  viewer.gui.__folders["Scene"].close();
  viewer.gui.width = 250;
  if (poses.length < 2) { viewer.gui.__folders["Animations"] && viewer.gui.__folders["Animations"].close(); return; }
  const folder = animator.folder.__folders["default"], labels = poses.map(pose => pose.label);
  config.own = folder.add({pose: labels[0]}, "pose", labels);
  config.own.onChange(label => goTo(labels.indexOf(label)));
  animator.time_scrubber.name("pose number");
  if (pane.clientWidth >= WIDE) viewer.gui.open();
  animator.play(); animator.pause(); animator.seek(0);  // meshcat's slider moves only what has been played
  chooser.addEventListener("change", () => goTo(chooser.selectedIndex));
  document.getElementById("back").addEventListener("click", () => step(-1));
  document.getElementById("next").addEventListener("click", () => step(1));
  const asked = () => { const at = labels.indexOf(decodeURIComponent(location.hash.replace(/^#pose=/, ""))); if (at >= 0) goTo(at); };
  window.addEventListener("hashchange", asked);
  asked();
}

document.getElementById("fold").addEventListener("click", () => { panel.classList.toggle("folded"); if (!touched) lookAtAll(); });
pane.addEventListener("pointerdown", () => { touched = true; });
pane.addEventListener("wheel", () => { touched = true; });
window.addEventListener("resize", () => { if (!touched) lookAtAll(); });
if (pane.clientWidth < 700) panel.classList.add("folded");

load().then(() => {
  copyGhost(); orderBeams(); layers(); controls(); viewer.set_3d_pane_size(); lookAtAll(); tell();
  (function watch() { tell(); requestAnimationFrame(watch); })();
  requestAnimationFrame(() => requestAnimationFrame(() => { document.documentElement.dataset.ready = performance.now().toFixed(0); }));
}).catch(error => {
  const box = document.getElementById("trouble");
  box.style.display = "block";
  box.textContent = "This scene cannot be shown: " + error + ". A browser of 2023 or newer with WebGL is needed.";
  console.error(error);
});
"""
