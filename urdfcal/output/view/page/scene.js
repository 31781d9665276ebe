"use strict";
const pane = document.getElementById("meshcat-pane"), panel = document.getElementById("panel");
const path = name => ["meshcat", ...name.split("/")];
let config, poses, viewer, animator, THREE;

function begin() {  // inside the promise of start.js, which shows what goes wrong
  config = JSON.parse(document.getElementById("urdfcal-config").textContent);
  poses = config.poses;
  THREE = MeshCat.THREE;
  viewer = new MeshCat.Viewer(pane);
  animator = viewer.animator;
}

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
