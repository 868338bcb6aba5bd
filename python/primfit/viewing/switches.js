// Switches, numbers and what is told under the mouse, on top of the viewer of trimesh, which has
// made `scene`, `camera`, `renderer`, `render` and THREE. VIEW tells of each part of the scene.
(function start() {
  if (typeof controls === "undefined" || !controls) { setTimeout(start, 30); return; }
  const HIDDEN = new Set(["beams"]);
  const OPACITY = { planes: 0.35, solids: 0.6 };
  const HEIGHT = 0.022; // of a name, as a share of the distance
  const groups = new Map();
  const pickable = [];

  const entryOf = (object) => {
    for (let at = object; at; at = at.parent) {
      if (VIEW.parts[at.name]) return VIEW.parts[at.name];
    }
    return null;
  };

  scene.traverse((object) => {
    if (!(object.isMesh || object.isPoints || object.isLine)) return;
    const entry = entryOf(object);
    if (!entry) return;
    if (!groups.has(entry.group)) groups.set(entry.group, []);
    groups.get(entry.group).push(object);
    object.userData.told = entry.text;
    const material = object.material;
    if (object.isPoints) { material.size = 2; material.sizeAttenuation = false; }
    if (object.isMesh) {
      material.side = THREE.DoubleSide;
      material.metalness = 0; material.roughness = 1; // bare metal would reflect an empty world
      if (OPACITY[entry.group]) {
        material.transparent = true; material.opacity = OPACITY[entry.group];
        material.depthWrite = false;
      }
      pickable.push(object);
    }
    material.needsUpdate = true;
  });
  scene.add(new THREE.AmbientLight(0xffffff, 0.6));

  // A number, or a kind, at the middle of a part.
  const labels = [];
  scene.updateMatrixWorld(true);
  for (const mesh of pickable.slice()) {
    const entry = entryOf(mesh);
    if (!entry.label) continue;
    const canvas = document.createElement("canvas");
    const context = canvas.getContext("2d");
    const font = "bold 40px sans-serif";
    context.font = font;
    canvas.width = Math.ceil(context.measureText(entry.label).width) + 12;
    canvas.height = 52;
    context.font = font;
    context.lineWidth = 6; context.strokeStyle = "white"; context.lineJoin = "round";
    context.strokeText(entry.label, 6, 40); context.fillStyle = "#222";
    context.fillText(entry.label, 6, 40);
    const sprite = new THREE.Sprite(new THREE.SpriteMaterial({
      map: new THREE.CanvasTexture(canvas), sizeAttenuation: false, depthTest: false }));
    sprite.scale.set(HEIGHT * canvas.width / canvas.height, HEIGHT, 1);
    new THREE.Box3().setFromObject(mesh).getCenter(sprite.position);
    sprite.userData.group = entry.group;
    scene.add(sprite); labels.push(sprite);
  }

  const panel = document.createElement("div");
  panel.id = "switches";
  panel.style.cssText = "position:fixed;top:8px;left:8px;font:13px sans-serif;color:#222;" +
    "background:rgba(255,255,255,.85);padding:6px 10px;border-radius:4px;max-width:46em";
  const title = document.createElement("div");
  title.textContent = VIEW.title;
  title.style.fontWeight = "bold";
  panel.appendChild(title);
  const shown = new Map();
  function apply() {
    for (const [group, objects] of groups) {
      for (const object of objects) object.visible = shown.get(group);
    }
    for (const label of labels) {
      label.visible = shown.get("names") && shown.get(label.userData.group);
    }
    render();
  }
  for (const group of [...groups.keys(), ...(labels.length ? ["names"] : [])]) {
    shown.set(group, group === "names" ? labels.length <= 80 : !HIDDEN.has(group));
    const label = document.createElement("label");
    label.style.marginRight = "12px";
    const box = document.createElement("input");
    box.type = "checkbox"; box.checked = shown.get(group); box.dataset.group = group;
    box.addEventListener("change", () => { shown.set(group, box.checked); apply(); });
    label.append(box, " " + group);
    panel.appendChild(label);
  }
  document.body.appendChild(panel);

  const told = document.createElement("div");
  told.id = "told";
  told.style.cssText = "position:fixed;bottom:8px;left:8px;font:13px monospace;color:#222;" +
    "background:rgba(255,255,255,.85);padding:4px 8px;border-radius:4px";
  told.textContent = "move the mouse over a plane or solid";
  document.body.appendChild(told);
  const ray = new THREE.Raycaster();
  let lit = null;
  renderer.domElement.addEventListener("mousemove", (event) => {
    if (event.buttons) return;
    const at = new THREE.Vector2(
      2 * event.clientX / window.innerWidth - 1, 1 - 2 * event.clientY / window.innerHeight);
    ray.setFromCamera(at, camera);
    const hits = ray.intersectObjects(pickable.filter((object) => object.visible), false);
    const next = hits.length ? hits[0].object : null;
    told.textContent = next ? next.userData.told : "";
    if (next !== lit) {
      if (lit) lit.material.opacity = OPACITY[entryOf(lit).group] || 1;
      if (next) next.material.opacity = 0.85;
      lit = next; render();
    }
  });
  apply();
  window.VIEW_OBJECTS = (group) => groups.get(group);
  document.body.dataset.ready = "yes";
})();
