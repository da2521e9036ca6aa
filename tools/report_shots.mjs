// Screenshots of a report page, and the checks that it is self-contained.
//   node tools/report_shots.mjs REPORT.html OUT_FOLDER
// Writes light.png, dark.png (top of the page), full.png, narrow.png and view3d.png. Ends with 1 when the page has
// script errors, asks the network for anything, or when its 3D view does not start.

import { mkdirSync } from "node:fs";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";
import { until, withPage } from "./browser.mjs";

const [file, out] = process.argv.slice(2);
if (!file || !out) {
  console.error("usage: report_shots.mjs REPORT.html OUT_FOLDER");
  process.exit(2);
}
mkdirSync(out, { recursive: true });
const url = pathToFileURL(resolve(file)).href;
const failures = [];
for (const [name, options] of [
  ["light", {}], ["dark", { dark: true }], ["narrow", { width: 420, height: 900 }],
]) {
  await withPage(async (page, problems) => {
    await page.goto(url);
    await page.waitForTimeout(300);
    await page.screenshot({ path: join(out, `${name}.png`) });
    const wider = await page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth");
    if (wider > 1) failures.push(`${name}: the page is ${wider} px wider than its window`);
    if (name === "light") {
      await page.screenshot({ path: join(out, "full.png"), fullPage: true });
      const has3d = await page.evaluate("Boolean(document.getElementById('view3d'))");
      if (has3d) {
        await page.evaluate("document.getElementById('view3d').scrollIntoView({ block: 'center' })");
        await page.click("#view3d-start");
        await until(page, "Boolean(window.harmonyView || window.harmonyViewFailed)");
        const failed = await page.evaluate("window.harmonyViewFailed || null");
        if (failed) failures.push(`3D view: ${failed}`);
        await page.waitForTimeout(1500);
        await page.screenshot({ path: join(out, "view3d.png") });
      }
    }
    failures.push(...problems.map((p) => `${name}: ${p}`));
  }, options);
}
for (const f of failures) console.log(f);
console.log(failures.length ? "FAIL" : "ok");
process.exit(failures.length ? 1 : 0);
