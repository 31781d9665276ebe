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
