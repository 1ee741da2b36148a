// Bundles the page into dist/: one script, the HTML and style sheet, and the licenses of what is in it.
import { build } from "esbuild";
import { cp, mkdir, readFile, rm, writeFile } from "node:fs/promises";

const BUNDLED = ["three", "@msgpack/msgpack"];

await rm("dist", { recursive: true, force: true });
await mkdir("dist", { recursive: true });
await build({
  entryPoints: ["src/main.ts"],
  bundle: true,
  format: "esm",
  target: "es2022",
  minify: true,
  sourcemap: true,
  legalComments: "none",
  outfile: "dist/main.js",
  logLevel: "warning",
});
await cp("index.html", "dist/index.html");
await cp("style.css", "dist/style.css");
const licenses = await Promise.all(
  BUNDLED.map(async (name) => `${name}\n\n${await readFile(`node_modules/${name}/LICENSE`, "utf8")}`),
);
await writeFile("dist/LICENSES.txt", licenses.join("\n\n----\n\n"));
