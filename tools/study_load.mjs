// Posts answers to `harmony study serve` as fast as it takes them, kills it at random moments, and looks in the log for
// everything that was acknowledged.
//   node tools/study_load.mjs HARMONY_BIN SITE LOG [ROUNDS [LEAST_RATE]]
// SITE is a built study (its private folder beside it), LOG must not exist. Ends with 1 when an acknowledged answer is
// missing, an answer is stored twice, or fewer than LEAST_RATE (default 0) a second are acknowledged: the rate is that of
// disk, server and this script together, and falls to a tenth on a machine that has other work.

import { spawn } from "node:child_process";
import { createHmac } from "node:crypto";
import { existsSync, readFileSync } from "node:fs";
import http from "node:http";
import { createRequire } from "node:module";

const [bin, site, log, rounds = "6", least = "0"] = process.argv.slice(2);
const shuffle = createRequire(import.meta.url)("../crates/harmony-study/assets/shuffle.js");
const study = JSON.parse(readFileSync(`${site}.private/study.json`, "utf8"));
if (existsSync(log)) { console.error(`${log} exists already`); process.exit(2); }
const CLIENTS = 64, SECONDS = 2;

const token = (participant, trial) =>
  createHmac("sha256", study.secret).update(`trial\n${study.study}\n${participant}\n${trial}`).digest("hex").slice(0, 32);
const body = (participant, trial) => {
  const order = shuffle.panelOrder(study.study, participant, trial.id, trial.panels.length).map((i) => trial.panels[i].id);
  const answer = {
    study: study.study, version: study.version, participant, trial: trial.id, revision: 1, order,
    ranks: order.map((_, i) => i + 1), active_ms: 9000, total_ms: 9500, changes: 6, zooms: 0, views: 0, layout: "grid",
  };
  return JSON.stringify({ token: token(participant, trial.id), answer });
};
const serve = () => new Promise((good, bad) => {
  const child = spawn(bin, ["study", "serve", site, "--log", log, "--listen", "127.0.0.1:0"], { stdio: ["ignore", "pipe", "ignore"] });
  let said = "";
  child.stdout.on("data", (text) => {
    said += text;
    const port = said.match(/http:\/\/127\.0\.0\.1:(\d+)/)?.[1];
    if (port) good({ child, port: Number(port) });
  });
  child.on("exit", () => bad(new Error("the server ended")));
});
const post = (agent, port, text) => new Promise((good) => {
  const request = http.request({ agent, port, host: "127.0.0.1", path: "/api/answer", method: "POST",
    headers: { "content-type": "application/json", "content-length": Buffer.byteLength(text) } }, (response) => {
    response.resume();
    response.on("end", () => good(response.statusCode));
    response.on("error", () => good(0));
  });
  request.on("error", () => good(0));
  request.end(text);
});

const acknowledged = new Set();
let busy = 0;
for (let round = 0; round < Number(rounds); round++) {
  const { child, port } = await serve();
  child.removeAllListeners("exit");
  const agent = new http.Agent({ keepAlive: true, maxSockets: CLIENTS });
  const begun = performance.now();
  const end = begun + SECONDS * 1000 * (0.4 + 0.6 * ((round * 7) % 10) / 9);
  let dead = false;
  const client = async (c) => {
    for (let i = 0; !dead; i++) {
      const participant = `r${round}-c${c}-${Math.floor(i / study.trials.length)}`, trial = study.trials[i % study.trials.length];
      const status = await post(agent, port, body(participant, trial));
      if (status === 200) acknowledged.add(`${participant} ${trial.id}`);
      else if (status === 0) return;
      else throw new Error(`status ${status}`);
    }
  };
  const all = Promise.all(Array.from({ length: CLIENTS }, (_, c) => client(c)));
  await new Promise((r) => setTimeout(r, end - performance.now()));
  child.kill("SIGKILL");
  busy += performance.now() - begun;
  dead = true;
  await all;
  agent.destroy();
}
// Opened once more, as after any crash; then every line is read.
const { child } = await serve();
child.removeAllListeners("exit");
child.kill("SIGKILL");
const stored = new Map();
for (const line of readFileSync(log, "utf8").split("\n").slice(1)) {
  if (!line) continue;
  const { answer } = JSON.parse(line);
  const key = `${answer.participant} ${answer.trial}`;
  stored.set(key, (stored.get(key) ?? 0) + 1);
}
const lost = [...acknowledged].filter((key) => !stored.has(key));
const doubled = [...stored.values()].filter((n) => n > 1).length;
const rate = acknowledged.size / (busy / 1000);
console.log(`${acknowledged.size} answers acknowledged, ${Math.round(rate)} a second, ${rounds} kills: ${lost.length} lost, ${doubled} doubled`);
process.exit(lost.length || doubled || rate < Number(least) ? 1 : 0);
