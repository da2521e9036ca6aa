// The order of panels and trials, fixed to the bit: the same as src/shuffle.rs, which says how it works.
// Loaded by the page, and by node in the tests.
"use strict";

const harmonyShuffle = (() => {
  const K = new Uint32Array(64);
  // Fractional parts of the cube roots of the first 64 primes (FIPS 180-4), computed exactly with BigInt.
  (() => {
    const root = (n) => { // floor of the cube root
      let low = 0n, high = 1n << 40n;
      while (low < high) {
        const middle = (low + high + 1n) >> 1n;
        if (middle * middle * middle <= n) low = middle; else high = middle - 1n;
      }
      return low;
    };
    let found = 0;
    for (let n = 2n; found < 64; n += 1n) {
      let prime = true;
      for (let d = 2n; d * d <= n; d += 1n) if (n % d === 0n) { prime = false; break; }
      if (prime) K[found++] = Number(root(n << 96n) & 0xffffffffn);
    }
  })();

  const rotr = (x, n) => (x >>> n) | (x << (32 - n));

  // The eight words of the SHA-256 of a text (UTF-8). crypto.subtle is not there on every page opened from disk.
  function sha256(text) {
    const bytes = new TextEncoder().encode(text);
    const blocks = new Uint8Array(Math.ceil((bytes.length + 9) / 64) * 64);
    blocks.set(bytes);
    blocks[bytes.length] = 0x80;
    const view = new DataView(blocks.buffer);
    view.setUint32(blocks.length - 8, Math.floor(bytes.length / 0x20000000));
    view.setUint32(blocks.length - 4, (bytes.length << 3) >>> 0);
    const h = new Uint32Array([
      0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a, 0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19,
    ]);
    const w = new Uint32Array(64);
    for (let start = 0; start < blocks.length; start += 64) {
      for (let i = 0; i < 16; i++) w[i] = view.getUint32(start + 4 * i);
      for (let i = 16; i < 64; i++) {
        const a = w[i - 15], b = w[i - 2];
        w[i] = w[i - 16] + (rotr(a, 7) ^ rotr(a, 18) ^ (a >>> 3)) + w[i - 7] + (rotr(b, 17) ^ rotr(b, 19) ^ (b >>> 10));
      }
      let [a, b, c, d, e, f, g, k] = h;
      for (let i = 0; i < 64; i++) {
        const t1 = (k + (rotr(e, 6) ^ rotr(e, 11) ^ rotr(e, 25)) + ((e & f) ^ (~e & g)) + K[i] + w[i]) >>> 0;
        const t2 = ((rotr(a, 2) ^ rotr(a, 13) ^ rotr(a, 22)) + ((a & b) ^ (a & c) ^ (b & c))) >>> 0;
        k = g; g = f; f = e; e = (d + t1) >>> 0; d = c; c = b; b = a; a = (t1 + t2) >>> 0;
      }
      [a, b, c, d, e, f, g, k].forEach((v, i) => { h[i] += v; });
    }
    return h;
  }

  // xoshiro128**, seeded from the hash of a text.
  function generator(text) {
    const s = sha256(text).slice(0, 4);
    if (s.every((v) => v === 0)) s[0] = 1;
    const rotl = (x, n) => ((x << n) | (x >>> (32 - n))) >>> 0;
    const next = () => {
      const result = Math.imul(rotl(Math.imul(s[1], 5) >>> 0, 7), 9) >>> 0;
      const t = s[1] << 9;
      s[2] ^= s[0]; s[3] ^= s[1]; s[1] ^= s[2]; s[0] ^= s[3]; s[2] ^= t;
      s[3] = rotl(s[3], 11);
      return result;
    };
    const below = (n) => {
      const limit = Math.floor(0x100000000 / n) * n;
      for (;;) {
        const x = next();
        if (x < limit) return x % n;
      }
    };
    return { next, below };
  }

  function shuffled(seed, count) {
    const order = Array.from({ length: count }, (_, i) => i);
    const { below } = generator(seed);
    for (let i = count - 1; i > 0; i--) {
      const j = below(i + 1);
      [order[i], order[j]] = [order[j], order[i]];
    }
    return order;
  }

  return {
    sha256Hex: (text) => Array.from(sha256(text), (w) => w.toString(16).padStart(8, "0")).join(""),
    panelOrder: (study, participant, trial, count) =>
      shuffled(`harmony-study 1 panels\n${study}\n${participant}\n${trial}`, count),
    trialOrder: (study, participant, count) => shuffled(`harmony-study 1 trials\n${study}\n${participant}`, count),
  };
})();

if (typeof module !== "undefined") module.exports = harmonyShuffle;
