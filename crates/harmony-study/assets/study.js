// The study's page. Panels are known by opaque names only; who made which stands nowhere in it.
(() => {
  const study = JSON.parse(document.getElementById("study").textContent);
  const app = document.getElementById("app");
  const served = /^https?:$/.test(location.protocol);
  const letter = (i) => String.fromCharCode(65 + i);
  const IDLE_MS = 60_000; // without a movement for so long the clock of a trial stands still

  // ---- what is kept --------------------------------------------------------------------------------------------
  // One entry a participant and a version of the site; another version of the site is another study to come back to.
  const storage = (() => {
    const memory = new Map();
    try {
      const probe = "harmony-study/probe";
      localStorage.setItem(probe, "1");
      localStorage.removeItem(probe);
      return {
        safe: true,
        get: (key) => localStorage.getItem(key),
        set(key, text) {
          try { localStorage.setItem(key, text); this.safe = true; } catch { memory.set(key, text); this.safe = false; }
        },
      };
    } catch {
      return { safe: false, get: (key) => memory.get(key) ?? null, set: (key, text) => memory.set(key, text) };
    }
  })();
  const base = `harmony-study/${study.study}/${study.version}`;
  const fresh = (participant, key) => ({ format: 1, participant, key, consented: false, started: false, at: 0, finished: false, trials: {} });
  let state = null;
  const save = () => {
    if (!state) return;
    storage.set(`${base}/${state.participant}`, JSON.stringify(state));
    storage.set(`${base}/last`, state.participant);
  };
  const recall = (participant) => {
    try {
      const kept = JSON.parse(storage.get(`${base}/${participant}`));
      return kept && kept.format === 1 && kept.participant === participant ? kept : null;
    } catch { return null; }
  };
  const isCode = (text) => /^[a-z0-9-]{4,32}$/.test(text || "");

  // ---- the order that the seed gives ---------------------------------------------------------------------------
  const trialsOf = () => harmonyShuffle.trialOrder(study.study, state.participant, study.trials.length).map((i) => study.trials[i]);
  const panelsOf = (trial) =>
    harmonyShuffle.panelOrder(study.study, state.participant, trial.id, trial.panels.length).map((i) => trial.panels[i]);
  const entry = (trial) =>
    (state.trials[trial.id] ??= { ranks: {}, revision: 0, sent: 0, done: false, active: 0, total: 0, changes: 0, zooms: 0, views: 0, column: false });
  const complete = (trial) => trial.panels.every((p) => entry(trial).ranks[p.id]);

  // ---- small tools -----------------------------------------------------------------------------------------------
  const el = (name, attributes = {}, ...children) => {
    const node = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) {
      if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
      else if (value === true) node.setAttribute(key, "");
      else if (value !== false && value != null) node.setAttribute(key, value);
    }
    node.append(...children.flat().filter((c) => c != null && c !== false));
    return node;
  };
  const paragraphs = (text) => text.split("\n").filter(Boolean).map((t) => el("p", {}, t));
  let sayTimer = 0;
  const say = (text, ms = 3500) => {
    const place = document.getElementById("say");
    place.textContent = text;
    clearTimeout(sayTimer);
    sayTimer = setTimeout(() => { place.textContent = ""; }, ms);
  };
  const show = (...nodes) => { app.replaceChildren(...nodes); window.scrollTo(0, 0); };

  // ---- the server ------------------------------------------------------------------------------------------------
  const post = async (path, body) => {
    const response = await fetch(`api/${path}`, {
      method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body), credentials: "omit",
    });
    let value = {};
    try { value = await response.json(); } catch { /* a proxy's page */ }
    if (!response.ok) throw Object.assign(new Error(value.error || `the server answered ${response.status}`), { status: response.status });
    return value;
  };
  let about = null; // what the server says of itself; null = none
  let tokens = null;
  const who = () => ({ study: study.study, participant: state.participant, key: state.key });
  const begin = async () => {
    const got = await post("begin", who());
    tokens = got.tokens;
    for (const trial of study.trials) {
      const there = got.answers[trial.id];
      if (!there) continue;
      const mine = entry(trial);
      const order = panelsOf(trial).map((p) => p.id);
      if (there.revision >= mine.revision && order.every((id, i) => mine.ranks[id] === there.ranks[i])) {
        // Stored, though the acknowledgement may have been lost.
        Object.assign(mine, { revision: there.revision, sent: there.revision, done: true });
      } else if (mine.done && mine.revision > mine.sent) {
        // Answered here and elsewhere: ours is sent as a change of what is there.
        mine.revision = Math.max(mine.revision, there.revision + 1);
      } else if (there.revision > mine.sent) {
        order.forEach((id, i) => { mine.ranks[id] = there.ranks[i]; });
        Object.assign(mine, { revision: there.revision, sent: there.revision, done: true });
      }
    }
    if (got.finished) state.finished = true;
    state.consented ||= Object.keys(got.answers).length > 0;
    save();
  };
  const answerOf = (trial) => {
    const e = entry(trial);
    const order = panelsOf(trial).map((p) => p.id);
    return {
      study: study.study, version: study.version, participant: state.participant, trial: trial.id, revision: e.revision,
      order, ranks: order.map((id) => e.ranks[id]), active_ms: Math.round(e.active), total_ms: Math.round(e.total),
      changes: e.changes, zooms: e.zooms, views: e.views, layout: e.column ? "column" : "grid",
    };
  };
  const unsent = () => study.trials.filter((t) => entry(t).done && entry(t).sent < entry(t).revision);
  // A page without a server beside it (opened from disk, or on a host of plain files) sends nothing.
  let alone = !served;
  const canSend = () => !alone && state?.key;
  const meet = async () => {
    const response = await fetch("api/study", { credentials: "omit" });
    const value = response.ok ? await response.json().catch(() => null) : null;
    if (value?.study === study.study && value.version === study.version) about = value;
    else if (response.status === 404 || response.ok) alone = true;
  };
  let flushing = null, retryMs = 2000, retryTimer = 0, lastProblem = "";
  // Sends whatever is unsent, one after the other; tries again by itself when the network is gone.
  const flush = () => (flushing ??= (async () => {
    try {
      if (!canSend()) return;
      if (!about) await meet();
      if (!canSend()) return;
      if (!tokens) await begin();
      for (let conflicts = 0; ;) {
        const trial = unsent()[0];
        if (!trial || state.finished) break;
        const answer = answerOf(trial);
        try {
          await post("answer", { token: tokens[trial.id], answer });
          entry(trial).sent = answer.revision;
        } catch (error) {
          if (error.status !== 409 || ++conflicts > 3) throw error;
          await begin();
        }
        save();
      }
      lastProblem = "";
      retryMs = 2000;
    } catch (error) {
      lastProblem = error.status ? error.message : "no connection";
      if (error.status === 403) tokens = null;
      clearTimeout(retryTimer);
      retryTimer = setTimeout(flush, retryMs);
      retryMs = Math.min(retryMs * 2, 60_000);
    } finally {
      flushing = null;
      status();
    }
  })());
  addEventListener("online", () => { if (state) { retryMs = 2000; flush(); } });
  const status = () => {
    const place = document.getElementById("status");
    if (!place) return;
    const waiting = unsent().length;
    const kept = storage.safe ? "Saved on this device" : "This browser keeps nothing: save a file before you leave";
    const sent = !canSend() ? "" : waiting === 0 ? " and sent" : `, ${waiting} not sent yet${lastProblem ? ` (${lastProblem})` : ""}`;
    place.textContent = kept + sent;
    place.className = storage.safe && !lastProblem ? "soft wide-only" : "warn";
  };

  // ---- files -----------------------------------------------------------------------------------------------------
  const exported = () => ({
    format: 1, study: study.study, version: study.version, participant: state.participant, key: state.key,
    finished: state.finished, answers: study.trials.filter((t) => entry(t).done && complete(t)).map(answerOf),
  });
  const download = () => {
    const url = URL.createObjectURL(new Blob([JSON.stringify(exported(), null, 1)], { type: "application/json" }));
    const link = el("a", { href: url, download: `${study.study}-${state.participant}.json` });
    document.body.append(link);
    link.click();
    link.remove();
    setTimeout(() => URL.revokeObjectURL(url), 10_000);
  };
  const upload = async (file) => {
    try {
      if (file.size > 4 << 20) throw new Error("it is too large");
      const got = JSON.parse(await file.text());
      if (got.format !== 1 || got.study !== study.study || got.version !== study.version) throw new Error("it belongs to another study or version");
      if (!isCode(got.participant) || !Array.isArray(got.answers)) throw new Error("it is no file of this page");
      if (state && state.participant !== got.participant && Object.keys(state.trials).length) {
        throw new Error(`it is of ${got.participant}, this session is of ${state.participant}`);
      }
      state = recall(got.participant) ?? fresh(got.participant, got.key ?? null);
      let taken = 0;
      for (const answer of got.answers) {
        const trial = study.trials.find((t) => t.id === answer.trial);
        if (!trial) continue;
        const order = panelsOf(trial).map((p) => p.id);
        const ranks = answer.ranks;
        if (!Array.isArray(ranks) || [...ranks].sort().join() !== order.map((_, i) => i + 1).join()) continue;
        const e = entry(trial);
        if (e.done && e.revision >= answer.revision) continue;
        order.forEach((id, i) => { e.ranks[id] = ranks[i]; });
        Object.assign(e, {
          done: true, revision: answer.revision, active: +answer.active_ms || 0, total: +answer.total_ms || 0,
          changes: +answer.changes || 0, zooms: +answer.zooms || 0, views: +answer.views || 0, column: answer.layout === "column",
        });
        taken += 1;
      }
      state.consented = state.consented || taken > 0;
      save();
      say(`${taken} answers taken from the file`);
      welcome();
    } catch (error) { say(`This file cannot be used: ${error.message}`, 8000); }
  };
  const fileButton = (text) => el("label", { class: "button file" }, text,
    el("input", { type: "file", accept: ".json,application/json", "aria-label": text, onchange: (e) => e.target.files[0] && upload(e.target.files[0]) }));

  // ---- consent ---------------------------------------------------------------------------------------------------
  const welcome = () => {
    const known = state && (state.started || Object.keys(state.trials).length > 0);
    const code = el("input", { type: "text", id: "code", autocomplete: "off", autocapitalize: "none", spellcheck: "false", "aria-label": "Code" });
    const key = el("input", { type: "text", id: "key", autocomplete: "off", autocapitalize: "none", spellcheck: "false", "aria-label": "Key" });
    const agree = el("input", { type: "checkbox", id: "agree" });
    if (state?.consented) agree.checked = true;
    const needsInvitation = !state && !alone && !about?.open;
    const go = el("button", { class: "main", id: "begin", onclick: () => enter(code.value.trim(), key.value.trim()) }, known ? "Continue" : "Begin");
    const ready = () => { go.disabled = !agree.checked; };
    agree.addEventListener("change", ready);
    ready();
    show(el("main", { class: "sheet" },
      el("h1", {}, study.title),
      paragraphs(study.consent),
      !alone && !about && el("p", { class: "warn" }, "The study's server cannot be reached. Your answers are kept on this device and sent when it is back; you can also save them as a file."),
      alone && el("p", { class: "soft" }, "This page works without a server. At the end you save your answers as a file and send it back."),
      !storage.safe && el("p", { class: "warn" }, "This browser does not let the page keep anything (a private window?). If you close it, your ranks are lost: save a file before."),
      needsInvitation && el("div", {}, el("p", {}, "You need an invitation. Open the link that you were sent, or type its code and key:"), el("div", { class: "row" }, code, key)),
      state && el("p", { class: "soft" }, `Your code: `, el("b", { id: "my-code" }, state.participant), ". With it you can have your answers deleted."),
      el("label", { class: "check" }, agree, el("span", {}, "I have read this, I am of age, and I take part of my own will.")),
      el("div", { class: "row" }, go, fileButton("Go on from a saved file"))));
  };
  const enter = async (code, key) => {
    try {
      if (!state && !alone && !about) await meet();
      if (!state && !alone && about) {
        if (about.open && !code) {
          const got = await post("enrol", { study: study.study });
          state = fresh(got.participant, got.key);
        } else {
          if (!isCode(code) || !key) { say("Please give code and key as they stand in your invitation."); return; }
          await post("begin", { study: study.study, participant: code, key });
          state = recall(code) ?? fresh(code, key);
        }
        history.replaceState(null, "", `#p=${state.participant}&k=${state.key}`);
      } else if (!state) {
        const random = crypto.getRandomValues(new Uint8Array(9));
        state = fresh("x-" + Array.from(random, (b) => "abcdefghijkmnpqrstuvwxyz23456789"[b % 32]).join(""), null);
      }
      state.consented = true;
      save();
      if (canSend() && about) await begin().catch((error) => { if (error.status === 403) throw error; });
      if (state.finished) thanks(); else if (state.started) trialScreen(state.at); else instructions();
      flush();
    } catch (error) {
      say(error.status ? error.message : "The study's server cannot be reached; please try again.", 8000);
    }
  };

  // ---- instructions ------------------------------------------------------------------------------------------------
  const keys = (count) => [
    [`A - ${letter(count - 1)}`, "choose a panel"], [`1 - ${count}`, "give it this rank"], ["Arrows", "move between panels"],
    ["Space (hold)", "show the photo in place of the chosen panel"], ["Z, + and -, 0", "zoom in and out, all pictures together; drag to move"],
    ["L", "photo and one panel side by side"], ["V", "another view, where there is one"], ["U", "undo"], ["Enter", "next trial"], ["?", "this help"],
  ];
  const help = () => {
    const count = study.trials[0].panels.length;
    const box = el("dialog", { "aria-label": "Help" }, el("p", {}, study.instructions), el("h2", {}, "Keys"),
      el("dl", {}, keys(count).map(([k, what]) => [el("dt", {}, el("kbd", {}, k)), el("dd", {}, what)])),
      el("div", { class: "row" }, el("button", { class: "main", onclick: () => box.close() }, "Close")));
    box.addEventListener("close", () => box.remove());
    document.body.append(box);
    box.showModal();
  };
  const instructions = () => {
    show(el("main", { class: "sheet" },
      el("h1", {}, study.title),
      el("p", { class: "words", id: "instructions" }, study.instructions),
      el("p", { class: "soft" }, "Everything is saved as you go. You can go back and change ranks until you hand in. Pictures can be zoomed: pinch, double click, or the buttons at the bottom; all move together."),
      el("div", { class: "wide-only" }, el("h2", {}, "Keys, if you like them"),
        el("p", {}, keys(study.trials[0].panels.length).slice(0, 4).flatMap(([k, what], i) => [i ? ", " : "", el("kbd", {}, k), ` ${what}`]))),
      el("div", { class: "row" }, el("button", { class: "main", id: "start", onclick: () => { state.started = true; save(); trialScreen(state.at); } }, "Start"))));
    document.getElementById("start").focus();
  };

  // ---- a trial -----------------------------------------------------------------------------------------------------
  let leave = () => {};
  const trialScreen = (at) => {
    leave();
    const trials = trialsOf();
    state.at = Math.min(Math.max(at, 0), trials.length - 1);
    save();
    const trial = trials[state.at];
    const e = entry(trial);
    const panels = panelsOf(trial);
    const count = panels.length;
    let selected = 0, view = 0, history_ = [], before = JSON.stringify(e.ranks);
    const look = { z: 1, x: 0, y: 0 };

    // The clock: time in view, and with the person at it.
    let last = performance.now(), moved = last;
    const tick = () => {
      const now = performance.now();
      const step = Math.min(now - last, 5000);
      if (document.visibilityState === "visible" && now - moved < IDLE_MS) e.active += step;
      e.total += now - last;
      last = now;
    };
    const clock = setInterval(() => { tick(); save(); }, 2000);
    const awake = () => { moved = performance.now(); };

    // Pictures. Next stays locked until those of the first view are there.
    const waiting = new Set();
    const picture = (src, alt, must) => {
      const image = el("img", { alt, draggable: "false" });
      let tries = 0, again = null, timer = 0;
      if (must) waiting.add(image);
      const load = () => { clearTimeout(timer); image.src = served ? `${src}?again=${Date.now()}` : src; };
      image.addEventListener("load", () => { waiting.delete(image); again?.remove(); again = null; refresh(); });
      // Tried again by itself, ever more slowly, and at once by the button.
      image.addEventListener("error", () => {
        tries += 1;
        timer = setTimeout(load, Math.min(800 * tries, 10_000));
        if (tries === 3) {
          again = el("button", { class: "failed", onclick: load }, "Load again");
          image.parentElement?.append(again);
        }
      });
      image.src = src;
      return image;
    };

    const photoView = el("div", { class: "view" }, picture(trial.photo, "the photo", true));
    const boxes = panels.map((panel, i) => {
      const image = picture(panel.views[0], `reconstruction ${letter(i)}`, true);
      const over = picture(trial.photo, "", false);
      over.className = "over";
      const frame = el("div", { class: "view" }, image, over, el("span", { class: "mark" }, "photo"));
      const ranks = Array.from({ length: count }, (_, r) =>
        el("button", { "data-rank": r + 1, "aria-label": `rank ${letter(i)} ${r + 1}`, onclick: () => { select(i, false); rank(i, r + 1); } }, String(r + 1)));
      const peek = el("button", { class: "peek", "aria-label": `hold to see the photo in place of ${letter(i)}` }, "photo");
      const flip = (on) => () => { if (on) { e.views += 1; select(i, false); } frame.classList.toggle("flip", on); };
      peek.addEventListener("pointerdown", flip(true));
      for (const end of ["pointerup", "pointerleave", "pointercancel"]) peek.addEventListener(end, flip(false));
      peek.addEventListener("contextmenu", (event) => event.preventDefault());
      const box = el("section", { class: "panel", role: "group", tabindex: "0", "aria-label": `Reconstruction ${letter(i)}`, "data-letter": letter(i) }, frame,
        el("div", { class: "line" }, el("span", { class: "letter" }, letter(i)), el("div", { class: "ranks" }, ranks), peek));
      box.addEventListener("focus", () => select(i, false));
      frame.addEventListener("click", () => select(i, false));
      return { box, frame, image, ranks, panel };
    });

    const message = el("span", { class: "grow", id: "left" });
    const next = el("button", { class: "main", id: "next", onclick: () => forward() }, state.at + 1 < trials.length ? "Next" : "To the end");
    const undo = el("button", { id: "undo", onclick: () => takeBack() }, "Undo");
    const viewButton = trial.views.length > 1 && el("button", { id: "view", "aria-pressed": "false", onclick: () => nextView() }, "Other view");
    const largeButton = el("button", { id: "large", "aria-pressed": "false", onclick: () => large() }, "Side by side");
    const done = trials.filter((t) => entry(t).done).length;
    const progress = el("div", { class: "bar", role: "progressbar", "aria-valuenow": done, "aria-valuemin": 0, "aria-valuemax": trials.length, "aria-label": "trials answered" }, el("i"));
    progress.style.setProperty("--done", (100 * done) / trials.length);
    const screen = el("main", { class: "trial", id: "trial", "data-trial": trial.id },
      el("div", { class: "top" }, el("b", { id: "where" }, `${state.at + 1} of ${trials.length}`), progress, el("span", { id: "status" }),
        el("button", { onclick: help }, "Help"), el("button", { onclick: download, class: "wide-only" }, "Save file"),
        el("button", { onclick: () => overview(), class: "wide-only" }, "All trials")),
      el("div", { class: "both" },
        el("div", { class: "photo" }, photoView, el("div", { class: "name" }, "Input photo")),
        el("div", { class: `panels${count === 2 || count === 4 ? " two" : ""}` }, boxes.map((b) => b.box))),
      el("div", { class: "foot" },
        el("button", { id: "back", disabled: state.at === 0, onclick: () => trialScreen(state.at - 1) }, "Back"), undo,
        el("button", { class: "square", "aria-label": "zoom out", onclick: () => zoom(1 / 1.5) }, "\u2212"),
        el("button", { class: "square", "aria-label": "zoom in", onclick: () => zoom(1.5) }, "+"),
        viewButton, largeButton, message, next));
    screen.style.setProperty("--ratio", `${trial.size[0]} / ${trial.size[1]}`);
    screen.style.setProperty("--ratio-number", trial.size[0] / trial.size[1]);

    const rank = (i, r) => {
      const id = panels[i].id, had = e.ranks[id];
      if (had === r) return;
      history_.push(JSON.stringify(e.ranks));
      // A used rank moves here; its former holder gets the rank that becomes free, if there is one.
      const holder = panels.find((p) => e.ranks[p.id] === r);
      if (holder) { if (had) e.ranks[holder.id] = had; else delete e.ranks[holder.id]; }
      e.ranks[id] = r;
      e.changes += 1;
      e.column = matchMedia("(max-width: 700px)").matches;
      touched();
    };
    const takeBack = () => {
      const kept = history_.pop();
      if (kept === undefined) return;
      e.ranks = JSON.parse(kept);
      e.changes += 1;
      touched();
    };
    // An answered trial that is changed is answered anew when it is left.
    const touched = () => { tick(); save(); refresh(); };
    const select = (i, focus) => {
      selected = i;
      boxes.forEach((b, k) => b.box.classList.toggle("selected", k === i));
      if (focus) boxes[i].box.focus();
    };
    const refresh = () => {
      const used = new Set(Object.values(e.ranks));
      boxes.forEach(({ box, ranks, panel }) => {
        const mine = e.ranks[panel.id];
        box.classList.toggle("ranked", Boolean(mine));
        ranks.forEach((b, r) => {
          b.setAttribute("aria-pressed", String(mine === r + 1));
          b.classList.toggle("used", used.has(r + 1) && mine !== r + 1);
        });
      });
      const left = count - panels.filter((p) => e.ranks[p.id]).length;
      message.textContent = waiting.size ? `${waiting.size} pictures are loading` : left ? `${left} to rank` : "all ranked";
      next.disabled = waiting.size > 0 || left > 0;
      undo.disabled = history_.length === 0;
      status();
    };
    const forward = () => {
      if (next.disabled) return;
      if (!e.done || JSON.stringify(e.ranks) !== before) {
        e.revision = Math.max(e.revision, e.sent) + 1;
        before = JSON.stringify(e.ranks);
      }
      e.done = true;
      tick();
      save();
      flush();
      if (state.at + 1 < trials.length) trialScreen(state.at + 1); else overview();
    };
    const nextView = () => {
      view = (view + 1) % trial.views.length;
      e.views += 1;
      boxes.forEach((b) => { b.image.src = b.panel.views[view]; });
      if (viewButton) {
        viewButton.textContent = view ? "View of the photo" : "Other view";
        viewButton.setAttribute("aria-pressed", String(view > 0));
      }
    };
    const large = () => {
      const on = screen.classList.toggle("large");
      largeButton.setAttribute("aria-pressed", String(on));
      largeButton.textContent = on ? "All panels" : "Side by side";
      e.views += 1;
    };

    // Zoom and pan, the same for all pictures; x and y are the left and upper edge as shares of the picture.
    const apply = () => {
      look.z = Math.min(Math.max(look.z, 1), 12);
      const most = 1 - 1 / look.z;
      look.x = Math.min(Math.max(look.x, 0), most);
      look.y = Math.min(Math.max(look.y, 0), most);
      screen.style.setProperty("--z", look.z);
      screen.style.setProperty("--x", -100 * look.x * look.z);
      screen.style.setProperty("--y", -100 * look.y * look.z);
      screen.classList.toggle("zoomed", look.z > 1.001);
    };
    const zoom = (factor, at = [0.5, 0.5]) => {
      const from = look.z;
      look.z = Math.min(Math.max(look.z * factor, 1), 12);
      look.x += at[0] / from - at[0] / look.z;
      look.y += at[1] / from - at[1] / look.z;
      e.zooms += 1;
      apply();
    };
    const within = (frame, event) => {
      const r = frame.getBoundingClientRect();
      return [(event.clientX - r.left) / r.width, (event.clientY - r.top) / r.height];
    };
    for (const frame of [photoView, ...boxes.map((b) => b.frame)]) {
      frame.addEventListener("dblclick", (event) => {
        if (look.z > 1.001) { look.z = 1; e.zooms += 1; apply(); } else zoom(2.5, within(frame, event));
      });
      frame.addEventListener("wheel", (event) => {
        if (!event.ctrlKey && look.z <= 1.001) return;
        event.preventDefault();
        zoom(Math.exp(-event.deltaY / 400), within(frame, event));
      }, { passive: false });
      const fingers = new Map();
      let spread = 0;
      frame.addEventListener("pointerdown", (event) => {
        fingers.set(event.pointerId, event);
        spread = 0;
        if (look.z > 1.001) frame.setPointerCapture(event.pointerId);
      });
      frame.addEventListener("pointermove", (event) => {
        const past = fingers.get(event.pointerId);
        if (!past) return;
        fingers.set(event.pointerId, event);
        const r = frame.getBoundingClientRect();
        if (fingers.size === 1 && look.z > 1.001) {
          look.x -= (event.clientX - past.clientX) / r.width / look.z;
          look.y -= (event.clientY - past.clientY) / r.height / look.z;
          apply();
        } else if (fingers.size === 2) {
          const [a, b] = [...fingers.values()];
          const now = Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
          if (spread > 0) zoom(now / spread, within(frame, { clientX: (a.clientX + b.clientX) / 2, clientY: (a.clientY + b.clientY) / 2 }));
          spread = now;
        }
      });
      for (const end of ["pointerup", "pointercancel"]) frame.addEventListener(end, (event) => { fingers.delete(event.pointerId); spread = 0; });
    }

    const onKey = (event) => {
      awake();
      if (document.querySelector("dialog[open]") || event.ctrlKey || event.metaKey || event.altKey) return;
      const inButton = event.target.closest?.("button, input, label");
      const key = event.key.length === 1 ? event.key.toUpperCase() : event.key;
      const columns = count === 2 || count === 4 ? 2 : 3;
      const by = { ArrowLeft: -1, ArrowRight: 1, ArrowUp: -columns, ArrowDown: columns }[key];
      if (key.length === 1 && key >= "A" && key <= letter(count - 1)) select(key.charCodeAt(0) - 65, true);
      else if (key >= "1" && key <= String(count) && key.length === 1) rank(selected, Number(key));
      else if (by) { const to = selected + by; if (to >= 0 && to < count) { select(to, true); } }
      else if (key === " " && !inButton) { if (!event.repeat) { e.views += 1; boxes[selected].frame.classList.add("flip"); } }
      else if (key === "Z") { if (look.z > 1.001) { look.z = 1; e.zooms += 1; apply(); } else zoom(2.5); }
      else if (key === "+" || key === "=") zoom(1.5);
      else if (key === "-") zoom(1 / 1.5);
      else if (key === "0") { look.z = 1; e.zooms += 1; apply(); }
      else if (key === "L") large();
      else if (key === "V" && trial.views.length > 1) nextView();
      else if (key === "U") takeBack();
      else if (key === "?") help();
      else if (key === "Enter" && !inButton) forward();
      else return;
      event.preventDefault();
    };
    const onKeyUp = (event) => { if (event.key === " ") boxes.forEach((b) => b.frame.classList.remove("flip")); };
    const onHide = () => { tick(); save(); };
    document.addEventListener("keydown", onKey);
    document.addEventListener("keyup", onKeyUp);
    document.addEventListener("visibilitychange", onHide);
    addEventListener("pagehide", onHide);
    for (const name of ["pointermove", "pointerdown", "scroll"]) document.addEventListener(name, awake, { passive: true });
    leave = () => {
      clearInterval(clock);
      tick();
      // Changes of an answered trial count even when it is left by another way than Next.
      if (e.done && complete(trial) && JSON.stringify(e.ranks) !== before) { e.revision = Math.max(e.revision, e.sent) + 1; flush(); }
      if (e.done && !complete(trial)) { e.done = false; }
      save();
      document.removeEventListener("keydown", onKey);
      document.removeEventListener("keyup", onKeyUp);
      document.removeEventListener("visibilitychange", onHide);
      removeEventListener("pagehide", onHide);
      for (const name of ["pointermove", "pointerdown", "scroll"]) document.removeEventListener(name, awake);
      leave = () => {};
    };
    show(screen);
    apply();
    select(0, false);
    refresh();
    // The next trial's pictures come while this one is ranked.
    const following = trials[state.at + 1];
    if (following) setTimeout(() => [following.photo, ...following.panels.map((p) => p.views[0])].forEach((src) => { new Image().src = src; }), 300);
  };

  // ---- the end -----------------------------------------------------------------------------------------------------
  const overview = () => {
    leave();
    const trials = trialsOf();
    const open = trials.filter((t) => !entry(t).done).length;
    const message = el("p", { id: "handin-message", class: "soft" });
    const hand = el("button", { class: "main", id: "handin", disabled: open > 0, onclick: async () => {
      hand.disabled = true;
      message.textContent = "Handing in...";
      if (canSend()) {
        await flush();
        if (unsent().length) {
          message.className = "warn";
          message.textContent = `The server cannot be reached (${lastProblem}). Your ranks are kept here; try again later, or save them as a file and send it.`;
          hand.disabled = false;
          return;
        }
        try { await post("finish", who()); } catch (error) {
          message.className = "warn";
          message.textContent = `${error.message}. Please try again.`;
          hand.disabled = false;
          return;
        }
      }
      state.finished = true;
      save();
      thanks();
    } }, "Hand in");
    show(el("main", { class: "sheet" },
      el("h1", {}, open ? `${open} of ${trials.length} trials are not answered yet` : "All trials are answered"),
      el("p", {}, "You can look at each again and change it. After handing in, answers are final."),
      el("table", { class: "overview" }, el("tbody", {}, trials.map((t, i) => el("tr", {},
        el("td", {}, `Trial ${i + 1}`), el("td", { class: entry(t).done ? "good" : "warn" }, entry(t).done ? "answered" : "open"),
        el("td", {}, el("button", { onclick: () => trialScreen(i) }, entry(t).done ? "Change" : "Answer")))))),
      message, el("p", { id: "status" }),
      el("div", { class: "row" }, hand, el("button", { onclick: download }, "Save as a file"))));
    status();
  };
  const thanks = () => {
    leave();
    const sent = canSend();
    show(el("main", { class: "sheet", id: "thanks" },
      el("h1", {}, "Thank you"),
      sent ? el("p", { class: "good" }, "Your answers have arrived. You can close this page.")
        : el("p", {}, "Please save your answers as a file and send it to the person who gave you this page."),
      el("p", {}, "Your code is ", el("b", {}, state.participant), ". Keep it if you may want to have your answers deleted."),
      el("div", { class: "row" }, el("button", { class: sent ? "" : "main", id: "save-file", onclick: download }, "Save my answers as a file"))));
  };

  // ---- start -------------------------------------------------------------------------------------------------------
  (async () => {
    const hash = new URLSearchParams(location.hash.slice(1));
    const [p, k] = [hash.get("p"), hash.get("k")];
    if (isCode(p)) {
      state = recall(p) ?? fresh(p, k);
      if (k) state.key = k;
    } else {
      const last = storage.get(`${base}/last`);
      if (isCode(last)) state = recall(last);
    }
    if (served) await meet().catch(() => {});
    if (state?.finished) thanks(); else welcome();
  })();
})();
