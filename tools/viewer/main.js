// The 3D view of the report: a GLB from memory, orbit controls, the photo's camera, objects to pick.
// Built into one file by build_viewer.sh; it asks nothing of the network.

import {
  ACESFilmicToneMapping, AmbientLight, Box3, Box3Helper, Color, DirectionalLight, HemisphereLight, NoToneMapping,
  PerspectiveCamera, Raycaster, Scene, SRGBColorSpace, Vector2, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";

export async function open(container, bytes, { onSelect = () => {}, background = null } = {}) {
  const gltf = await new GLTFLoader().parseAsync(bytes, "");
  const renderer = new WebGLRenderer({ antialias: true, alpha: true, preserveDrawingBuffer: true });
  renderer.outputColorSpace = SRGBColorSpace;
  renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
  container.replaceChildren(renderer.domElement);

  const scene = new Scene();
  if (background) scene.background = new Color(background);
  scene.add(gltf.scene);
  gltf.scene.updateMatrixWorld(true);
  const room = gltf.scene.getObjectByName("room");
  const bounds = new Box3().setFromObject(room ?? gltf.scene);
  const size = bounds.getSize(new Vector3());
  const centre = bounds.getCenter(new Vector3());

  // Two ways to light: even light that shows every surface, and the scene's own lamps and windows (without shadows).
  // A sky of intensity pi shows a surface that faces it in its own colour.
  const even = [new HemisphereLight(0xffffff, 0xc8c4be, 0.9 * Math.PI)];
  const head = new DirectionalLight(0xffffff, 0.6);
  even.push(head);
  even.forEach((l) => scene.add(l));
  const own = [];
  gltf.scene.traverse((o) => {
    if (o.isLight) own.push(o);
  });
  // Surfaces of a whole scene emit a share of their colour, for viewers without ambient light; even light is enough.
  const glowing = [];
  gltf.scene.traverse((o) => {
    for (const m of [o.material ?? []].flat()) if (m.userData?.ambient_glow) glowing.push(m);
  });
  const ambient = gltf.scene.userData.ambient ?? { color: [1, 1, 1], intensity: 0.2, exposure: 0 };
  if (glowing.length === 0) {
    const level = Math.PI * ambient.intensity * 2 ** (ambient.exposure ?? 0);
    const sky = new AmbientLight(new Color(...ambient.color), level);
    scene.add(sky);
    own.push(sky);
  }

  const camera = new PerspectiveCamera(50, 1, 0.02, 200);
  const controls = new OrbitControls(camera, renderer.domElement);
  controls.enableDamping = false;
  const photo = gltf.cameras[0];

  let pending = false;
  const draw = () => {
    if (pending) return;
    pending = true;
    requestAnimationFrame(() => {
      pending = false;
      head.position.copy(camera.position);
      head.target.position.copy(controls.target);
      head.target.updateMatrixWorld();
      renderer.render(scene, camera);
    });
  };
  controls.addEventListener("change", draw);

  const fit = () => {
    const w = Math.max(1, container.clientWidth);
    const h = Math.max(1, container.clientHeight);
    renderer.setSize(w, h);
    camera.aspect = w / h;
    camera.updateProjectionMatrix();
    draw();
  };
  new ResizeObserver(fit).observe(container);

  const look = (from, at) => {
    camera.position.copy(from);
    controls.target.copy(at);
    controls.update();
    draw();
  };
  const views = {
    photo() {
      if (!photo) return views.corner();
      photo.updateMatrixWorld(true);
      const forward = new Vector3(0, 0, -1).transformDirection(photo.matrixWorld);
      const from = new Vector3().setFromMatrixPosition(photo.matrixWorld);
      // The whole photo fits: widen the vertical field of view when the window is narrower than the photo.
      const tan = Math.tan((photo.fov * Math.PI) / 360) * Math.max(1, photo.aspect / camera.aspect);
      camera.fov = (Math.atan(tan) * 360) / Math.PI;
      camera.updateProjectionMatrix();
      look(from, from.clone().addScaledVector(forward, Math.max(0.5, size.z * 0.5)));
    },
    corner() {
      camera.fov = 40;
      camera.updateProjectionMatrix();
      const reach = 0.75 * size.length() / Math.tan((camera.fov * Math.PI) / 360) / 1.3;
      look(centre.clone().add(new Vector3(0.45, 0.75, 0.9).normalize().multiplyScalar(reach)), centre);
    },
    top() {
      camera.fov = 40;
      camera.updateProjectionMatrix();
      const reach = (0.6 * Math.max(size.x / camera.aspect, size.z)) / Math.tan((camera.fov * Math.PI) / 360) + size.y;
      look(centre.clone().add(new Vector3(0, reach, 0.001)), centre);
    },
  };
  const light = (mode) => {
    const lit = mode === "scene";
    even.forEach((l) => (l.visible = !lit));
    own.forEach((l) => (l.visible = lit));
    renderer.toneMapping = lit && ambient.view !== "standard" ? ACESFilmicToneMapping : NoToneMapping;
    glowing.forEach((m) => (m.emissiveIntensity = lit ? 1 : 0));
    draw();
  };

  // Picking: the nearest object with an id in its extras; the room's shell is looked through.
  const frame = new Box3Helper(new Box3(), 0xff8a00);
  frame.visible = false;
  scene.add(frame);
  const objectOf = (o) => {
    for (let n = o; n; n = n.parent) if (n.userData && typeof n.userData.id === "string") return n;
    return null;
  };
  const select = (id, report = true) => {
    let found = null;
    gltf.scene.traverse((o) => {
      if (!found && o.userData && o.userData.id === id) found = o;
    });
    frame.visible = Boolean(found);
    if (found) frame.box.setFromObject(found);
    if (report) onSelect(found ? id : null);
    draw();
    return Boolean(found);
  };
  let down = null;
  renderer.domElement.addEventListener("pointerdown", (e) => (down = [e.clientX, e.clientY]));
  renderer.domElement.addEventListener("pointerup", (e) => {
    if (!down || Math.hypot(e.clientX - down[0], e.clientY - down[1]) > 4) return;
    const r = renderer.domElement.getBoundingClientRect();
    const at = new Vector2(((e.clientX - r.left) / r.width) * 2 - 1, 1 - ((e.clientY - r.top) / r.height) * 2);
    const ray = new Raycaster();
    ray.setFromCamera(at, camera);
    const hit = ray.intersectObject(gltf.scene, true).map((h) => objectOf(h.object)).find(Boolean);
    select(hit ? hit.userData.id : null);
  });

  const show = (name, visible) => {
    const o = gltf.scene.getObjectByName(name);
    if (o) o.visible = visible;
    draw();
  };

  fit();
  light("even");
  views.corner();
  return { views, light, select, show, scene: gltf.scene, gltf, hasOwnLights: own.length > 1 };
}

export { Box3, Vector3 };
