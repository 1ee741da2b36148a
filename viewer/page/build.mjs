// Bundles the page into dist/: one script, the HTML and style sheet, and the licenses of what is in it.
import { build } from "esbuild";
import { cp, mkdir, readdir, readFile, rm, writeFile } from "node:fs/promises";

const BUNDLED = ["three", "@msgpack/msgpack"];

/** Files of the style sheet in styles/, in their order: the last ones override the others. */
const STYLES = [
  "layout",
  "panels",
  "gauges",
  "controls",
  "legend",
  "messages",
  "driving",
  "touch",
  "timeline",
  "dialogs",
  "small_screens",
];

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
const unused = (await readdir("styles")).filter((file) => !STYLES.includes(file.replace(/\.css$/, "")));
if (unused.length > 0) throw new Error(`not in STYLES of build.mjs: ${unused.join(", ")}`);
const styles = await Promise.all(STYLES.map((name) => readFile(`styles/${name}.css`, "utf8")));
await writeFile("dist/style.css", styles.join("\n"));
const licenses = await Promise.all(
  BUNDLED.map(async (name) => `${name}\n\n${await readFile(`node_modules/${name}/LICENSE`, "utf8")}`),
);
await writeFile("dist/LICENSES.txt", licenses.join("\n\n----\n\n"));
