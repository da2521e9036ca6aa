// Headless Chromium, as the other scripts use it: offline, with software WebGL.

import { existsSync } from "node:fs";
import { chromium } from "playwright-core";

const FLAGS = [
  "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update",
  "--disable-sync", "--disable-dev-shm-usage", "--enable-unsafe-swiftshader",
];

export function browserPath() {
  const found = [process.env.CHROMIUM, "/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"]
    .find((p) => p && existsSync(p));
  if (!found) throw new Error("no Chromium: install it (tools/setup.sh) or set CHROMIUM to its path");
  return found;
}

// Runs `work(page, problems)`; `problems` collects errors of the page and every request that left it.
export async function withPage(work, { width = 1280, height = 800, dark = false } = {}) {
  const browser = await chromium.launch({ executablePath: browserPath(), headless: true, args: FLAGS });
  try {
    const context = await browser.newContext({
      viewport: { width, height }, colorScheme: dark ? "dark" : "light", offline: true,
    });
    const page = await context.newPage();
    page.setDefaultTimeout(180_000);
    const problems = [];
    page.on("pageerror", (e) => problems.push(`page error: ${e.message}`));
    page.on("console", (m) => m.type() === "error" && problems.push(`console: ${m.text()}`));
    page.on("request", (r) => {
      if (!/^(file|data|blob|about):/.test(r.url())) problems.push(`request: ${r.url()}`);
    });
    return await work(page, problems);
  } finally {
    await browser.close();
  }
}

// Waits until an expression is true in the page. (The page's own policy forbids eval, which waitForFunction needs.)
export async function until(page, expression, seconds = 180) {
  const end = Date.now() + seconds * 1000;
  while (Date.now() < end) {
    if (await page.evaluate(expression)) return;
    await new Promise((r) => setTimeout(r, 200));
  }
  throw new Error(`waited ${seconds} s for ${expression}`);
}
