// Opens a GLB in three.js (headless Chromium) and checks what it finds there.
//   node tools/view_glb.mjs FILE.glb [--shot OUT.png] [--view photo|corner|top] [--light even|scene]
//                           [--extents W,H,D] [--nodes id,id,...] [--json]
// Checks: the room (node "room", else everything; width and depth by "floor") has the extents within 2 cm and stands on y = 0 (up axis),
// and the named nodes are there with finite boxes. Ends with 1 when a check fails.

import { mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { dirname, join } from "node:path";
import { fileURLToPath, pathToFileURL } from "node:url";
import { until, withPage } from "./browser.mjs";

const args = process.argv.slice(2);
const file = args.find((a, i) => !a.startsWith("--") && !(args[i - 1] ?? "").match(/^--(shot|view|light|extents|nodes)$/));
const option = (name) => (args.includes(`--${name}`) ? args[args.indexOf(`--${name}`) + 1] : null);
if (!file) {
  console.error("usage: view_glb.mjs FILE.glb [--shot OUT.png] [--view photo|corner|top] [--light even|scene] [--extents W,H,D] [--nodes a,b] [--json]");
  process.exit(2);
}
const bundle = join(dirname(fileURLToPath(import.meta.url)), "../crates/harmony-viewer/assets/viewer.js");
const folder = mkdtempSync(join(tmpdir(), "view_glb_"));
const failures = [];
try {
  const page64 = readFileSync(file).toString("base64");
  const html = `<!doctype html><meta charset="utf-8"><body style="margin:0"><div id="c" style="width:100vw;height:100vh"></div>
<script id="glb" type="text/plain">${page64}</script><script>${readFileSync(bundle, "utf8")}</script><script>
const bytes = Uint8Array.from(atob(document.getElementById("glb").textContent), (c) => c.charCodeAt(0)).buffer;
HarmonyViewer.open(document.getElementById("c"), bytes, { background: "#ddd" })
  .then((v) => { window.view = v; window.ready = true; }).catch((e) => { window.failed = String(e); });
</script>`;
  const pagePath = join(folder, "page.html");
  writeFileSync(pagePath, html);
  const found = await withPage(async (page, problems) => {
    await page.goto(pathToFileURL(pagePath).href);
    await until(page, "Boolean(window.ready || window.failed)");
    const failed = await page.evaluate("window.failed || null");
    if (failed) throw new Error(`three.js refuses the file: ${failed}`);
    const result = await page.evaluate(`(() => {
      const { Box3, Vector3 } = HarmonyViewer;
      const nodes = {};
      view.scene.updateMatrixWorld(true);
      for (const o of view.scene.children) {
        const b = new Box3().setFromObject(o);
        nodes[o.userData.name ?? o.name] = b.isEmpty() ? null : { min: b.min.toArray(), max: b.max.toArray(), extras: o.userData };
      }
      const floor = view.scene.getObjectByName("floor");
      const f = floor && new Box3().setFromObject(floor);
      return { nodes, floor: f && { min: f.min.toArray(), max: f.max.toArray() }, cameras: view.gltf.cameras.length };
    })()`);
    await page.evaluate(`view.light(${JSON.stringify(option("light") ?? "even")}); view.views[${JSON.stringify(option("view") ?? "corner")}]()`);
    await page.evaluate("new Promise((r) => requestAnimationFrame(() => requestAnimationFrame(r)))");
    if (option("shot")) await page.screenshot({ path: option("shot") });
    failures.push(...problems);
    return result;
  });
  const boxes = Object.values(found.nodes).filter(Boolean);
  const whole = found.nodes.room ?? {
    min: [0, 1, 2].map((k) => Math.min(...boxes.map((b) => b.min[k]))),
    max: [0, 1, 2].map((k) => Math.max(...boxes.map((b) => b.max[k]))),
  };
  if (found.floor) {
    // Jambs of windows and doors reach outward; the floor has the room's width and depth.
    for (const k of [0, 2]) [whole.min[k], whole.max[k]] = [found.floor.min[k], found.floor.max[k]];
  }
  const size = whole.max.map((v, k) => v - whole.min[k]);
  if (Math.abs(whole.min[1]) > 0.02) failures.push(`the floor is at y = ${whole.min[1]}, not 0`);
  if (option("extents")) {
    option("extents").split(",").map(Number).forEach((v, k) => {
      if (!(Math.abs(size[k] - v) <= 0.02)) failures.push(`extent ${"xyz"[k]} is ${size[k]} m, expected ${v} m`);
    });
  }
  for (const id of (option("nodes") ?? "").split(",").filter(Boolean)) {
    const b = found.nodes[id];
    if (!b || ![...b.min, ...b.max].every(Number.isFinite)) failures.push(`node ${id} is missing or empty`);
  }
  if (args.includes("--json")) console.log(JSON.stringify(found, null, 1));
  const shown = size.map((v) => v.toFixed(3)).join(" x ");
  console.log(`${failures.length ? "FAIL" : "ok  "} ${file}: ${Object.keys(found.nodes).length} root nodes, ${shown} m, ${found.cameras} cameras`);
} finally {
  rmSync(folder, { recursive: true, force: true });
}
for (const f of failures) console.log(`     ${f}`);
process.exit(failures.length ? 1 : 0);
