// A participant's session with a user study in a real Chromium, from consent to submission, on a desktop and on a phone.
//   node tools/study_session.mjs HARMONY_BIN WORK_FOLDER OUT_FOLDER
// Draws small rooms and six ever worse copies of them into WORK_FOLDER (emptied first), builds and serves a study of
// them, and leaves screenshots in OUT_FOLDER. Ends with 1 when anything is not as it should be: script errors, requests to
// elsewhere, ranks that are lost, answers that are not those that were given.

import { spawn, spawnSync } from "node:child_process";
import { mkdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";
import { deflateSync } from "node:zlib";
import { chromium } from "playwright-core";
import { browserPath, until } from "./browser.mjs";

const [bin, work, out] = process.argv.slice(2).map((p) => resolve(p));
mkdirSync(out, { recursive: true });
const failures = [];
const expect = (condition, what) => { if (!condition) failures.push(what); };
const same = (a, b, what) => expect(JSON.stringify(a) === JSON.stringify(b), `${what}: ${JSON.stringify(a)} is not ${JSON.stringify(b)}`);

const harmony = (...args) => {
  const done = spawnSync(bin, args, { encoding: "utf8" });
  if (done.status !== 0) throw new Error(`${args.join(" ")}: ${done.stdout}${done.stderr}`);
  return done.stdout;
};

// ---- pictures ---------------------------------------------------------------------------------------------------
// PNG of a function from pixels to colours.
const crcTable = Array.from({ length: 256 }, (_, n) => { let c = n; for (let k = 0; k < 8; k++) c = c & 1 ? 0xedb88320 ^ (c >>> 1) : c >>> 1; return c >>> 0; });
const crc = (data) => { let c = 0xffffffff; for (const b of data) c = crcTable[(c ^ b) & 255] ^ (c >>> 8); return (c ^ 0xffffffff) >>> 0; };
const png = (w, h, color) => {
  const rows = Buffer.alloc(h * (1 + 3 * w));
  for (let y = 0, at = 0; y < h; y++) {
    at += 1;
    for (let x = 0; x < w; x++) for (const c of color(x, y)) rows[at++] = c;
  }
  const chunk = (kind, data) => {
    const body = Buffer.concat([Buffer.from(kind), data]), out = Buffer.alloc(8);
    out.writeUInt32BE(data.length); out.writeUInt32BE(crc(body), 4);
    return Buffer.concat([out.subarray(0, 4), body, out.subarray(4)]);
  };
  const head = Buffer.alloc(13);
  head.writeUInt32BE(w); head.writeUInt32BE(h, 4); head.set([8, 2], 8);
  return Buffer.concat([Buffer.from("\x89PNG\r\n\x1a\n", "latin1"), chunk("IHDR", head), chunk("IDAT", deflateSync(rows)), chunk("IEND", Buffer.alloc(0))]);
};
// A room in one-point perspective with a bed, a lamp and a picture, moved and recoloured by `error`; from above with `above`.
const room = (scene, error, above) => png(240, 160, (column, row) => {
  const [x, y] = [2 * column, 2 * row];
  const hue = (k) => Math.round(128 + 90 * Math.sin(scene * 1.7 + k * 2.1));
  const off = error * 14 * (scene % 2 ? 1 : -1);
  const inside = ([x0, y0, x1, y1]) => x >= x0 + off && x < x1 + off && y >= y0 + error * 4 && y < y1 + error * 4;
  const shade = (c, f) => c.map((v) => Math.max(0, Math.min(255, Math.round(v * f))));
  if (above) { const r = Math.hypot(x - 240 - off, y - 160); return r < 60 ? [hue(1), 90, 70] : [205, 200, 190]; }
  if (inside([150 + 10 * scene, 190, 320, 260])) return shade([hue(1), hue(2), 110], 1 - error * 0.08);
  if (inside([150 + 10 * scene, 165, 190, 190])) return [235, 235, 230];
  if (inside([360, 120, 380, 220])) return error > 4 ? [120, 120, 120] : [245, 220, 130];
  if (inside([200, 60, 270, 110]) && error < 4) return shade([90, hue(3), 160], 0.9 + 0.1 * Math.sin(x / 6));
  const floor = y > 200 + Math.abs(x - 240) * 0.05;
  return floor ? shade([170, 140, 105], 0.8 + 0.002 * (y - 200) + 0.03 * ((x >> 4) % 2)) : shade([220 - 6 * error, 222, 214], 0.85 + 0.0005 * x);
});
rmSync(work, { recursive: true, force: true });
const scenes = ["bedroom_01", "bedroom_02", "study_01", "study_02"];
for (const [s, scene] of scenes.entries()) {
  const put = (folder, name, data) => { mkdirSync(join(work, folder), { recursive: true }); writeFileSync(join(work, folder, `${name}.png`), data); };
  put("photos", scene, room(s, 0));
  ["ours", "second", "third", "fourth", "fifth", "sixth"].forEach((method, m) => {
    put(method, scene, room(s, 0.4 + m));
    put(method, `${scene}@canonical`, room(s, 0.4 + m, true));
  });
}

const site = join(work, "site"), secrets = join(work, "site.private"), log = join(work, "answers.jsonl");
const methods = ["ours", "second", "third", "fourth", "fifth", "sixth"];
harmony("study", "build", ...methods.map((m) => `${m}=${join(work, m)}`), "--photos", join(work, "photos"),
  "--out", site, "--name", "browser-test", "--checks", "1", "--repeats", "1", "--participants", "3", "--min-seconds", "0", "--contact", "study@example.org");
const study = JSON.parse(readFileSync(join(secrets, "study.json"), "utf8"));
const invitations = readFileSync(join(secrets, "participants.csv"), "utf8").trim().split("\n").slice(1).map((l) => l.split(","));

const serve = (listen = "127.0.0.1:0") => new Promise((good, bad) => {
  const child = spawn(bin, ["study", "serve", site, "--log", log, "--listen", listen], { stdio: ["ignore", "pipe", "pipe"] });
  let said = "";
  child.stdout.on("data", (text) => {
    said += text;
    const url = said.match(/http:\S+/)?.[0];
    if (url) good({ child, url });
  });
  child.stderr.on("data", (text) => { said += text; });
  child.on("exit", (code) => bad(new Error(`the server ended with ${code}: ${said}`)));
});
const end = (child) => new Promise((done) => { child.removeAllListeners("exit"); child.on("exit", done); child.kill("SIGINT"); });

const browser = await chromium.launch({ executablePath: browserPath(), headless: true, args: ["--no-sandbox", "--disable-quic", "--disable-dev-shm-usage"] });
const open = async (options) => {
  const context = await browser.newContext(options);
  const page = await context.newPage();
  page.setDefaultTimeout(30_000);
  page.on("pageerror", (e) => failures.push(`page error: ${e.message}`));
  page.on("console", (m) => {
    if (m.type() === "error" && !/Failed to load resource|ERR_CONNECTION|ERR_INTERNET/.test(m.text())) failures.push(`console: ${m.text()}`);
  });
  page.on("request", (r) => { if (!/^(http:\/\/127\.0\.0\.1|file:|data:|blob:)/.test(r.url())) failures.push(`request: ${r.url()}`); });
  return { context, page };
};
const ranksOnPage = (page) => page.$$eval(".panel", (panels) => panels.map((p) =>
  Number(p.querySelector("[aria-pressed=true]")?.dataset.rank ?? 0)));
const kindOf = (id) => study.trials.find((t) => t.id === id).kind.is;
// What each panel shows, by the private folder: the page itself does not know.
const methodsOnPage = (page, id) => page.$$eval(".panel .view > img:first-child", (images) => images.map((i) => i.currentSrc || i.src))
  .then((sources) => sources.map((src) => study.trials.find((t) => t.id === id).panels.find((p) => src.includes(p.id))?.method));
// Ranks by taste: the order of `methods`, the photo first and another room last.
const taste = ["(photo)", ...methods, "(other room)"];
const wanted = (shown) => {
  const order = [...shown].sort((a, b) => taste.indexOf(a) - taste.indexOf(b));
  return shown.map((m) => order.indexOf(m) + 1);
};
const given = new Map();
const trialId = (page) => page.getAttribute("#trial", "data-trial");
const loaded = (page) => until(page, "[...document.querySelectorAll('.photo img, .panel .view > img:first-child')].every((i) => i.complete && i.naturalWidth > 0)");

let { child, url } = await serve();

// ---- a desktop ----------------------------------------------------------------------------------------------------
{
  const { context, page } = await open({ viewport: { width: 1440, height: 900 } });
  const [code, key] = invitations[0];
  await page.goto(`${url}#p=${code}&k=${key}`);
  await page.waitForSelector("#begin");
  await page.screenshot({ path: join(out, "consent.png") });
  expect(await page.isDisabled("#begin"), "one can begin without consent");
  same(await page.textContent("#my-code"), code, "the code");
  await page.check("#agree");
  await page.click("#begin");
  await page.waitForSelector("#instructions");
  const words = await page.textContent("#instructions");
  expect(words.startsWith(`You'll see ${study.trials.length} real room photos. For each, six reconstructions (A to F, shown in random order)`), `instructions: ${words}`);
  await page.screenshot({ path: join(out, "instructions.png") });
  await page.click("#start");

  const letters = new Map();
  for (let n = 0; n < study.trials.length; n++) {
    await page.waitForSelector("#trial");
    await loaded(page);
    const id = await trialId(page);
    const shown = await methodsOnPage(page, id);
    same([...shown].sort(), study.trials.find((t) => t.id === id).panels.map((p) => p.method).sort(), "panels");
    letters.set(id, shown.join());
    const ranks = wanted(shown);
    expect(await page.isDisabled("#next"), "one can go on without ranks");
    if (n === 0) {
      await page.screenshot({ path: join(out, "trial_empty.png") });
      // A used rank moves; its former holder gets the one that becomes free.
      const click = (l, r) => page.click(`.panel[data-letter=${l}] [data-rank="${r}"]`);
      await click("A", 1); await click("B", 2); await click("C", 1);
      same(await ranksOnPage(page), [0, 2, 1, 0, 0, 0], "a used rank moves");
      await click("B", 1);
      same(await ranksOnPage(page), [0, 1, 2, 0, 0, 0], "ranks are exchanged");
      await page.click("#undo"); await page.click("#undo");
      same(await ranksOnPage(page), [1, 2, 0, 0, 0, 0], "undo");
      // Zoom and pan move all pictures together.
      await page.locator(".panel[data-letter=A] .view").dblclick({ position: { x: 200, y: 100 } });
      const transforms = await page.$$eval(".view > img:first-child", (images) => [...new Set(images.map((i) => getComputedStyle(i).transform.replace(/, [-\d.]+, [-\d.]+\)$/, "")))]);
      same(transforms, ["matrix(2.5, 0, 0, 2.5"], "zoom of all pictures");
      const box = await page.locator(".panel[data-letter=B] .view").boundingBox();
      const before = await page.evaluate("document.getElementById('trial').style.getPropertyValue('--x')");
      await page.mouse.move(box.x + 200, box.y + 100);
      await page.mouse.down(); await page.mouse.move(box.x + 120, box.y + 90, { steps: 5 }); await page.mouse.up();
      expect(before !== await page.evaluate("document.getElementById('trial').style.getPropertyValue('--x')"), "dragging pans");
      await page.screenshot({ path: join(out, "zoomed.png") });
      await page.keyboard.press("0");
      // The photo in place of a panel, while the key is held.
      await page.keyboard.press("b"); await page.keyboard.down(" ");
      expect(await page.isVisible(".panel[data-letter=B] img.over"), "the photo shows");
      await page.keyboard.up(" ");
      expect(!(await page.isVisible(".panel[data-letter=B] img.over")), "the photo goes");
      await page.keyboard.press("l");
      await page.screenshot({ path: join(out, "side_by_side.png") });
      expect(!(await page.isVisible(".panel[data-letter=A]")) && await page.isVisible(".panel[data-letter=B]"), "side by side");
      await page.keyboard.press("l");
      await page.keyboard.press("?");
      await page.waitForSelector("dialog[open]");
      await page.screenshot({ path: join(out, "help.png") });
      await page.keyboard.press("Escape");
    }
    if (n < 3 && kindOf(id) !== "check") {
      const other = await page.$("#view");
      expect(other, "there is another view");
      if (other) {
        await other.click();
        await until(page, "[...document.querySelectorAll('.panel .view > img:first-child')].every((i) => i.src.endsWith('-1.jpg'))");
        await loaded(page);
        await page.screenshot({ path: join(out, "other_view.png") });
        await page.click("#view");
      }
    }
    // By keyboard alone: the letter, then the rank.
    for (const [i, rank] of ranks.entries()) { await page.keyboard.press("abcdef"[i]); await page.keyboard.press(String(rank)); }
    same(await ranksOnPage(page), ranks, `ranks of trial ${n + 1}`);
    given.set(id, ranks);
    if (n === 1) {
      // Closed and opened again in the middle: nothing is lost.
      await page.reload();
      await page.waitForSelector("#begin");
      await page.click("#begin");
      await page.waitForSelector("#trial");
      await loaded(page);
      same(await trialId(page), id, "resumed at the same trial");
      same(await ranksOnPage(page), ranks, "resumed ranks");
      await page.screenshot({ path: join(out, "trial_ranked.png") });
    }
    if (n === 2) {
      // The next trial's pictures are there already when the server goes.
      await page.waitForTimeout(1500);
      child.removeAllListeners("exit");
      child.kill("SIGKILL");
    }
    await page.evaluate("document.activeElement.blur()");
    await page.keyboard.press("Enter");
    if (n === 3) {
      // The server was killed; the page went on, says so, and sends when it is back.
      await until(page, "/not sent/.test(document.getElementById('status')?.textContent ?? '')");
      ({ child } = await serve(`127.0.0.1:${new URL(url).port}`));
    }
  }
  expect(new Set(letters.values()).size > 1, "the panels are in the same order in every trial");
  await page.waitForSelector("#handin");
  await page.screenshot({ path: join(out, "overview.png") });
  // A change of mind after all is answered.
  await page.click(".overview tr:first-child button");
  await page.waitForSelector("#trial");
  await loaded(page);
  const first = await trialId(page);
  const [one, two] = [given.get(first).indexOf(1), given.get(first).indexOf(2)];
  await page.keyboard.press("abcdef"[one]); await page.keyboard.press("2");
  given.get(first)[one] = 2; given.get(first)[two] = 1;
  same(await ranksOnPage(page), given.get(first), "the change");
  await page.keyboard.press("abcdef"[one]); await page.keyboard.press("1");
  given.get(first)[one] = 1; given.get(first)[two] = 2;
  for (let i = 0; i < study.trials.length; i++) { await page.waitForSelector("#trial"); await loaded(page); await page.click("#next"); if (await page.$("#handin")) break; }
  await page.waitForSelector("#handin");
  await page.click("#handin");
  await page.waitForSelector("#thanks");
  expect((await page.textContent("#thanks")).includes("have arrived"), "the page says that the answers have arrived");
  await page.screenshot({ path: join(out, "thanks.png") });
  await context.close();

  // The log has what was given, once each, and it decodes.
  const entries = readFileSync(log, "utf8").trim().split("\n").map((l) => JSON.parse(l));
  const latest = new Map();
  entries.filter((e) => e.kind === "answer" && e.answer.participant === code).forEach((e) => latest.set(e.answer.trial, e.answer));
  same(latest.size, study.trials.length, "answers in the log");
  for (const [id, ranks] of given) same(latest.get(id)?.ranks, ranks, `stored ranks of a ${kindOf(id)}`);
  expect(entries.some((e) => e.kind === "finish" && e.participant === code), "the log says that the participant has handed in");
  expect([...latest.values()].every((a) => a.active_ms > 0 && a.active_ms <= a.total_ms + 50), "times");
}

// ---- a phone ------------------------------------------------------------------------------------------------------
{
  const { context, page } = await open({ viewport: { width: 390, height: 844 }, deviceScaleFactor: 2, isMobile: true, hasTouch: true });
  const [code, key] = invitations[1];
  await page.goto(`${url}#p=${code}&k=${key}`);
  await page.waitForSelector("#begin");
  await page.locator("#agree").tap();
  await page.locator("#begin").tap();
  await page.locator("#start").tap();
  await page.waitForSelector("#trial");
  await loaded(page);
  const wide = await page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth");
  expect(wide <= 1, `on a phone the page is ${wide} px wider than its window`);
  const small = await page.$$eval(".ranks button, .foot button, .peek", (buttons) => buttons.filter((b) => b.offsetParent && b.getBoundingClientRect().height < 43.5).length);
  same(small, 0, "touch targets below 44 px");
  await page.screenshot({ path: join(out, "phone.png") });
  const id = await trialId(page);
  const ranks = wanted(await methodsOnPage(page, id));
  for (const [i, rank] of ranks.entries()) await page.locator(`.panel[data-letter=${"ABCDEF"[i]}] [data-rank="${rank}"]`).tap();
  same(await ranksOnPage(page), ranks, "ranks by touch");
  await page.screenshot({ path: join(out, "phone_ranked.png") });
  await page.locator("#next").tap();
  await until(page, `document.getElementById('trial')?.dataset.trial !== '${id}'`);
  await context.close();
}
await end(child);

// ---- from disk, without a server ------------------------------------------------------------------------------------
{
  const alone = join(work, "alone");
  harmony("study", "build", ...methods.slice(0, 3).map((m) => `${m}=${join(work, m)}`), "--photos", join(work, "photos"),
    "--out", alone, "--name", "offline-test", "--scenes", "2", "--single-file", "--participants", "1", "--min-seconds", "0");
  const { context, page } = await open({ viewport: { width: 1200, height: 900 }, acceptDownloads: true, offline: true });
  const [code, key] = readFileSync(`${alone}.private/participants.csv`, "utf8").trim().split("\n")[1].split(",");
  await page.goto(`${pathToFileURL(join(alone, "index.html")).href}#p=${code}&k=${key}`);
  await page.waitForSelector("#begin");
  expect((await page.textContent("main")).includes("works without a server"), "the page says that it works alone");
  await page.check("#agree");
  await page.click("#begin");
  await page.click("#start");
  for (let n = 0; n < 2; n++) {
    await page.waitForSelector("#trial");
    await loaded(page);
    for (const [i, rank] of [2, 3, 1].entries()) { await page.keyboard.press("abc"[i]); await page.keyboard.press(String(rank)); }
    await page.click("#next");
  }
  await page.click("#handin");
  await page.waitForSelector("#thanks");
  const [file] = await Promise.all([page.waitForEvent("download"), page.click("#save-file")]);
  const saved = join(work, "saved.json");
  await file.saveAs(saved);
  await context.close();
  const said = harmony("study", "collect", saved, "--private", `${alone}.private`, "--log", join(work, "alone.jsonl"));
  expect(said.includes("2 stored"), `collect: ${said}`);
  const alone_ = JSON.parse(harmony("study", "analyse", join(work, "alone.jsonl"), "--private", `${alone}.private`, "--json", "--draws", "0"));
  expect(alone_.participants.length === 1, "the saved file is analysed");
  // The same file brings the answers back on another device.
  const other = await open({ viewport: { width: 1200, height: 900 }, offline: true });
  await other.page.goto(pathToFileURL(join(alone, "index.html")).href);
  await other.page.waitForSelector("#begin");
  await other.page.setInputFiles("input[type=file]", saved);
  await until(other.page, `document.getElementById('my-code')?.textContent === '${code}'`);
  await other.context.close();
}
await browser.close();

// ---- the analysis ---------------------------------------------------------------------------------------------------
const analysis = JSON.parse(harmony("study", "analyse", log, "--private", secrets, "--json", "--draws", "50", "--partial"));
const person = analysis.participants.find((p) => p.code === invitations[0][0]);
same(person.checks_passed, 1, "attention checks");
same(person.repeats, [1], "agreement with themselves");
const counted = analysis.everybody ?? analysis.counted;
same(counted.table.map((r) => r.mean_rank.value), [1, 2, 3, 4, 5, 6], "mean ranks of one taste");
writeFileSync(join(out, "analysis.json"), JSON.stringify(analysis, null, 1));

for (const f of failures) console.log(f);
console.log(failures.length ? "FAIL" : "ok");
process.exit(failures.length ? 1 : 0);
