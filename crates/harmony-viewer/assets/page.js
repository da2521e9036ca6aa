"use strict";
(() => {
  const all = (selector) => [...document.querySelectorAll(selector)];
  const byId = (id) => document.getElementById(id);

  // Photo against render: the slider's value is where the render begins.
  const wipe = byId("wipe");
  if (wipe) {
    const slider = wipe.querySelector("input");
    const move = () => wipe.style.setProperty("--cut", `${slider.value}%`);
    slider.addEventListener("input", move);
    move();
    all("[data-over]").forEach((button) => button.addEventListener("click", () => {
      wipe.querySelector("img.over").src = byId(button.dataset.over).src;
      wipe.querySelector(".tag.right").textContent = button.textContent;
      all("[data-over]").forEach((b) => b.setAttribute("aria-pressed", String(b === button)));
    }));
  }

  // Pictures, large.
  const dialog = byId("large");
  document.addEventListener("click", (e) => {
    if (e.target.matches("figure img, .pictures img")) {
      dialog.querySelector("img").src = e.target.src;
      dialog.querySelector("img").alt = e.target.alt;
      dialog.showModal();
    } else if (dialog.open) dialog.close();
  });

  // Objects by level and word.
  const search = byId("search");
  const level = byId("level");
  const filter = () => {
    const word = search.value.trim().toLowerCase();
    all(".object").forEach((o) => {
      o.hidden = (level.value && o.dataset.level !== level.value) || (word && !o.textContent.toLowerCase().includes(word));
    });
  };
  if (search) {
    search.addEventListener("input", filter);
    level.addEventListener("change", filter);
  }

  // The scene in 3D, started on request: it takes memory and time.
  const glb = byId("glb");
  if (glb) {
    const box = byId("view3d");
    let starting = null;
    const pick = (id, scroll) => {
      all(".object").forEach((o) => o.classList.toggle("picked", o.dataset.id === id));
      const card = id && all(".object").find((o) => o.dataset.id === id);
      byId("picked").textContent = card ? `${id}: ${card.dataset.label}` : "";
      if (card && scroll) card.scrollIntoView({ block: "center", behavior: "smooth" });
    };
    const start = () => {
      starting ??= (async () => {
        box.textContent = "Loading …";
        await new Promise((done) => setTimeout(done, 30));
        const text = atob(glb.textContent.trim());
        const bytes = Uint8Array.from(text, (c) => c.charCodeAt(0)).buffer;
        const view = await HarmonyViewer.open(box, bytes, { onSelect: (id) => pick(id, false) });
        byId("view3d-bar").hidden = false;
        byId("view3d-start").hidden = true;
        window.harmonyView = view;
        return view;
      })().catch((error) => {
        box.textContent = `The 3D view could not start: ${error}`;
        window.harmonyViewFailed = String(error);
        throw error;
      });
      return starting;
    };
    byId("view3d-start").addEventListener("click", () => start().catch(() => {}));
    all("[data-view]").forEach((b) => b.addEventListener("click", async () => (await start()).views[b.dataset.view]()));
    byId("view3d-light").addEventListener("change", async (e) => (await start()).light(e.target.value));
    byId("view3d-room").addEventListener("change", async (e) => (await start()).show("room", e.target.checked));
    all("[data-show]").forEach((b) => {
      b.hidden = false;
      b.addEventListener("click", async () => {
        box.scrollIntoView({ block: "center" });
        const view = await start();
        view.select(b.dataset.show);
        pick(b.dataset.show, false);
      });
    });
  }
})();
