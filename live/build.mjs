// Bundles the page's script, and MuJoCo's WebAssembly beside it, into a folder.
import { mkdir, readFile, writeFile } from "node:fs/promises";
import { constants, gzipSync } from "node:zlib";
import { build } from "esbuild";

const folder = process.argv[2];
const packages = ["@mujoco/mujoco", "three"];
const described = async (name) => JSON.parse(await readFile(`node_modules/${name}/package.json`, "utf8"));

// A package without a file of its licence has that of this project, if it is the same.
async function licence({ name, license }) {
  for (const file of [`node_modules/${name}/LICENSE`, ...(license === "Apache-2.0" ? ["../LICENSE"] : [])]) {
    const text = await readFile(file, "utf8").catch(() => null);
    if (text) return text;
  }
  throw new Error(`${name} has no licence`);
}

await mkdir(folder, { recursive: true });
await build({
  entryPoints: ["src/main.ts"],
  outfile: `${folder}/page.js`,
  bundle: true,
  minify: true,
  format: "esm",
  target: "es2023",
  legalComments: "none",
  charset: "utf8",
  // MuJoCo's bindings would have code made of text.
  inject: ["src/bindings.ts"],
  // MuJoCo's glue asks for it under Node.js alone.
  external: ["module"],
});
const script = await readFile(`${folder}/page.js`, "utf8");
if (/\bnew Function\(|\beval\(/.test(script)) throw new Error("the script makes code of text, which the page's policy forbids");
const wasm = await readFile("node_modules/@mujoco/mujoco/mujoco.wasm");
await writeFile(`${folder}/engine.wasm.gz`, gzipSync(wasm, { level: constants.Z_BEST_COMPRESSION }));
const facts = await Promise.all(packages.map(described));
const licences = await Promise.all(facts.map(async (each) => [`${each.name} ${each.version}, ${each.license}`, await licence(each)]));
await writeFile(`${folder}/build.json`, JSON.stringify({ mujoco: facts[0].version, licences: Object.fromEntries(licences) }));
