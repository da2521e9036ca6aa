// Judges GLB files with the Khronos glTF validator.
//   node tools/validate_glb.mjs FILE.glb... [--infos]
// Prints one line a file; ends with 1 when any file has an error or a warning.

import { readFileSync } from "node:fs";
import validator from "gltf-validator";

const args = process.argv.slice(2);
const files = args.filter((a) => !a.startsWith("--"));
if (files.length === 0) {
  console.error("usage: validate_glb.mjs FILE.glb... [--infos]");
  process.exit(2);
}
let bad = 0;
for (const file of files) {
  const report = await validator.validateBytes(new Uint8Array(readFileSync(file)), {
    uri: file,
    maxIssues: 0,
    // An index of this size is a triangle of no area: harmless, and common in generated meshes.
    severityOverrides: {},
  });
  const { numErrors, numWarnings, numInfos, messages } = report.issues;
  const { drawCallCount, totalTriangleCount, materialCount } = report.info;
  const ok = numErrors === 0 && numWarnings === 0;
  bad += ok ? 0 : 1;
  console.log(
    `${ok ? "ok  " : "FAIL"} ${file}: ${numErrors} errors, ${numWarnings} warnings, ${numInfos} infos; ` +
      `${totalTriangleCount} triangles, ${drawCallCount} draw calls, ${materialCount} materials, ` +
      `uses ${(report.info.extensionsUsed ?? []).join(" ") || "no extension"}`,
  );
  const limit = args.includes("--infos") ? 2 : 1;
  for (const m of messages.filter((m) => m.severity <= limit).slice(0, 40)) {
    console.log(`     ${["error", "warning", "info", "hint"][m.severity]} ${m.code} at ${m.pointer}: ${m.message}`);
  }
}
process.exit(bad ? 1 : 0);
