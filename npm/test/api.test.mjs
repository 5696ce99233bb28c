// Run by scripts/try-npm.sh in a folder where the packages are installed. BISMAR_REPOSITORY: the folder of this repository.
import assert from "node:assert/strict";
import { execFileSync, spawn, spawnSync } from "node:child_process";
import { closeSync, existsSync, mkdirSync, mkdtempSync, openSync, readFileSync, readdirSync, unlinkSync, writeSync } from "node:fs";
import { createRequire } from "node:module";
import os from "node:os";
import path from "node:path";
import { test } from "node:test";
import { pathToFileURL } from "node:url";
import vm from "node:vm";

import * as bismar from "bismar";

const { BismarError, compare, inspect, look, program, render } = bismar;
const scene = path.join(process.env.BISMAR_REPOSITORY, "scenes", "cornell.glb");
const glb = readFileSync(scene);
const table = JSON.parse(readFileSync(path.join(path.dirname(createRequire(import.meta.url).resolve("bismar")), "options.json")));
const small = { size: [48, 32], spp: 8, threads: 1 };

/** A render that does not end by itself, and soon begins. */
const endless = { size: [256, 256], spp: 1_000_000, balance: "half" };

/** A folder of temporary files of this test alone, in which nothing may be left. */
const temporary = mkdtempSync(path.join(os.tmpdir(), "bismar-test-"));
process.env.TMPDIR = path.join(temporary, "tmp");
mkdirSync(process.env.TMPDIR);

/** Programs that this process has started and that run. */
function children() {
  const of = (pid) => readFileSync(`/proc/${pid}/stat`, "latin1").replace(/.*\) /s, "").split(" ");
  const pids = readdirSync("/proc").filter((name) => /^\d+$/.test(name));
  return pids.filter((pid) => {
    try {
      return of(pid)[1] === String(process.pid) && of(pid)[0] !== "Z";
    } catch {
      return false;
    }
  });
}

function assertNothingIsLeft() {
  assert.deepEqual(readdirSync(process.env.TMPDIR), []);
  assert.deepEqual(children(), []);
}

const refuses = (call, exitCode, text) =>
  assert.rejects(call, (error) => {
    assert.ok(error instanceof BismarError, `${error.stack}`);
    assert.equal(error.exitCode, exitCode, error.message);
    assert.match(error.message, text);
    return true;
  });

/** What the program writes by itself. */
function byHand(flags, input) {
  const folder = mkdtempSync(path.join(temporary, "by-hand-"));
  const args = ["-q", "render", ...flags, "-o", "a.exr", "--preview", "a.png", "--stats", "a.json"];
  execFileSync(program(), args, { cwd: folder, input });
  return ["exr", "png"].map((ending) => new Uint8Array(readFileSync(path.join(folder, `a.${ending}`))));
}

test("pictures have the bits of the program, from a path, a URL and bytes", async () => {
  const [exr, png] = byHand(["--size=48x32", "--spp=8", "--threads=1", "--aov=depth", scene]);
  const options = { ...small, aovs: ["depth"] };
  // Of another realm, as in node:vm and test runners, and shared.
  const [foreign, url] = vm.runInNewContext("[new ArrayBuffer(length), { href }]", { length: glb.length, href: pathToFileURL(scene).href });
  const shared = new Uint8Array(new SharedArrayBuffer(glb.length));
  [new Uint8Array(foreign), shared].forEach((bytes) => bytes.set(glb));
  const own = glb.buffer.slice(glb.byteOffset, glb.byteOffset + glb.length);
  for (const from of [scene, pathToFileURL(scene), pathToFileURL(scene).href, url, glb, own, foreign, shared]) {
    const result = await render(from, options);
    assert.deepEqual(result.png, png);
    assert.equal(result.stats.samples.pixel_mean, 8);
    assert.deepEqual(result.warnings, []);
    const made = await render(from, { ...options, format: "exr" });
    const { rel_mse, bias } = await compare(made.exr, exr);
    assert.deepEqual([rel_mse, bias], [0, [0, 0, 0]]);
  }
  assert.deepEqual(byHand(["--size=48x32", "--spp=8", "--threads=1", "--aov=depth", "-"], glb)[1], png);
  assertNothingIsLeft();
});

test("require gives the same functions", async () => {
  const required = createRequire(import.meta.url)("bismar");
  assert.equal(required.render, render);
  assert.deepEqual(Object.keys(required).sort(), Object.keys(bismar).sort());
});

test("inspect and compare give what the program prints", async () => {
  const printed = JSON.parse(execFileSync(program(), ["inspect", "--json", scene]));
  for (const from of [scene, glb]) {
    const report = await inspect(from);
    assert.deepEqual(report.counts, printed.counts);
    assert.deepEqual(report.cameras, printed.cameras);
  }
  const [a, b] = await Promise.all([8, 16].map((spp) => render(scene, { ...small, spp, format: "exr" })));
  const { within, rel_mse } = await compare(a.exr, b.exr, { max_relmse: 1e-9 });
  assert.ok(!within && rel_mse > 0);
});

test("options have every form of Python's and unknown ones start nothing", async () => {
  await render(scene, { ...small, size: "32x32", crop: [0, 0, 16, 16], adaptive: false, transparent: true, noise: undefined });
  await render(scene, { ...small, orbit: [30, 20], energy_compensation: "off", aovs: [] });
  for (const bad of [{ sppp: 1 }, { output: "x.exr" }, { on_checkpoint: "/bin/true" }, { toString: 1 }, { spp: {} }, { sky: "yes" },
    { spp: true }, { format: "jpg" }, { progress: 1 }, { signal: {} }]) {
    await assert.rejects(render(scene, bad), TypeError, JSON.stringify(bad));
  }
  await assert.rejects(render(""), TypeError);
  await assert.rejects(render(7), TypeError);
  for (const call of [render, (file) => compare(glb, file)]) await assert.rejects(call("a\0b"), /^TypeError: a path has null bytes/);
  await assert.rejects(render(scene, { camera: "a\0b" }), /^TypeError: render: camera has null bytes/);
  await refuses(render(scene, { spp: 0 }), 64, /spp/);
  await refuses(render(scene, { camera: "--help" }), 64, /--help/);
  assertNothingIsLeft();
});

test("options have the names of Python's keywords", () => {
  const python = readFileSync(path.join(process.env.BISMAR_REPOSITORY, "python/bismar/__init__.py"), "utf8");
  const keywords = ["load", "render"].flatMap((name) => {
    const head = python.match(new RegExp(`^ *def ${name}\\((.*?)\\) ->`, "ms"))[1];
    return [...head.matchAll(/^ +(\w+): .*=/gm)].map((found) => found[1]);
  });
  // What the call takes itself, and what `load` needs to know of a later `render`.
  const names = table.render.map(({ name }) => name).concat("progress", "velocity");
  assert.ok(keywords.length > 50);
  assert.deepEqual(keywords.filter((name) => !names.includes(name)), []);
});

test("bad scenes are errors with the program's exit code and text", async () => {
  for (const length of [0, 3, 11, 12, 40, glb.length - 1]) await refuses(render(glb.subarray(0, length)), 65, /standard input/);
  await refuses(render(path.join(temporary, "none.glb")), 66, /none\.glb/);
  await refuses(render(Buffer.from('{"asset":{"version":"2.0"}}')), 65, /magic/);
  const json = Buffer.from(JSON.stringify({ asset: { version: "2.0" }, buffers: [{ uri: "../a.bin", byteLength: 4 }] }).padEnd(80));
  const head = Buffer.from("glTF\x02\0\0\0\0\0\0\0\0\0\0\0JSON", "latin1");
  head.writeUInt32LE(20 + json.length, 8);
  head.writeUInt32LE(json.length, 12);
  await refuses(render(Buffer.concat([head, json])), 65, /has no folder/);
  await refuses(inspect(glb.subarray(0, 100)), 65, /standard input/);
  assertNothingIsLeft();
});

test("two gigabytes of nothing are refused at once, in memory and as a file", async () => {
  const began = Date.now();
  const file = openSync(path.join(temporary, "large.glb"), "w");
  writeSync(file, Buffer.of(0), 0, 1, 2 ** 31);
  closeSync(file);
  await refuses(render(path.join(temporary, "large.glb")), 65, /magic/);
  await refuses(render(Buffer.alloc(2 ** 31)), 65, /magic/);
  const claims = Buffer.alloc(2 ** 31);
  glb.copy(claims, 0, 0, 12);
  claims.writeUInt32LE(2 ** 31, 8);
  await refuses(render(claims), 65, /chunk/);
  await refuses(render(claims, { memory_limit: "1G" }), 76, /limit of memory/);
  assert.ok(Date.now() - began < 60_000);
  assertNothingIsLeft();
});

test("progress is reported and its errors end the render", async () => {
  const seen = [];
  await render(scene, { size: [64, 64], spp: 64, progress: (now) => seen.push(now) });
  assert.ok(seen.length > 0 && seen.every(({ fraction }) => fraction >= 0 && fraction <= 1));
  const stop = () => {
    throw new RangeError("enough");
  };
  await assert.rejects(render(scene, { ...endless, progress: stop }), RangeError);
  assertNothingIsLeft();
});

test("a hundred renders aborted at random moments leave no process and no file", async () => {
  await assert.rejects(render(scene, { signal: AbortSignal.abort("before") }), (reason) => reason === "before");
  for (let i = 0; i < 100; i += 10) {
    const calls = Array.from({ length: 10 }, () => {
      const abort = new AbortController();
      setTimeout(() => abort.abort(), Math.random() ** 2 * 1000);
      return assert.rejects(render(i % 20 ? glb : scene, { ...endless, signal: abort.signal }), { name: "AbortError" });
    });
    await Promise.all(calls);
    assertNothingIsLeft();
  }
});

test("fifty renders at once all end, and have the same bits", async () => {
  const all = await Promise.all(Array.from({ length: 50 }, (_, i) => render(i % 2 ? glb : scene, small)));
  all.forEach(({ png }) => assert.deepEqual(png, all[0].png));
  assertNothingIsLeft();
});

test("errors of the system are the package's, and say what to change", async () => {
  const own = process.env.TMPDIR;
  for (const folder of ["/no/such/folder", scene]) {
    process.env.TMPDIR = folder;
    const why = new RegExp(`^cannot use a temporary folder in ${folder}: no.* directory \\(ENO.*\\)\\. Set TMPDIR to a folder`);
    for (const call of [render, (bytes) => compare(bytes, bytes), inspect, look]) await refuses(call(glb), 73, why);
  }
  process.env.TMPDIR = own;
  const long = "x".repeat(1 << 18);
  const many = Array(1 << 16).fill(`/${"x".repeat(60)}`);
  for (const call of [() => render(scene, { camera: long }), () => render(`/${long}`), () => compare(glb, long), () => look(many)]) {
    await refuses(call(), 64, /^cannot start \/.*: argument list too long \(E2BIG\)\. .*: pass fewer or shorter ones$/);
  }
  assertNothingIsLeft();
});

/** Waits until nothing of a folder of temporary files is there, and no program that was told of it. */
async function untilNothingIsLeft(folder) {
  const programs = () => readdirSync("/proc").filter((pid) => {
    try {
      return /^\d+$/.test(pid) && readFileSync(`/proc/${pid}/cmdline`, "latin1").includes(folder);
    } catch {
      return false;
    }
  });
  while (readdirSync(folder).length > 0 || programs().length > 0) await new Promise((resolve) => setTimeout(resolve, 20));
}

test("however a process or a worker ends, its renders end, and their folders go", async () => {
  const call = `require("bismar").render(${JSON.stringify(scene)}, { size: [256, 256], spp: 1e6, balance: "half", threads: 1,
    progress: () => console.log("begun") }).catch(() => {});`;
  const worker = `const worker = new (require("node:worker_threads").Worker)(${JSON.stringify(call)}, { eval: true, stdout: true });
    worker.stdout.once("data", () => worker.terminate()); worker.once("exit", () => console.log("begun"));
    setInterval(() => {}, 1000);`;
  // While bytes are written, and while the program begins.
  const writes = `const bytes = Buffer.alloc(4e8); console.log("begun"); require("bismar").compare(bytes, bytes).catch(() => {});`;
  const begins = `console.log("begun"); ${call}`;
  for (const [code, end] of [...["SIGTERM", "SIGHUP", "SIGINT", "SIGKILL", "group"].map((end) => [call, end]), [worker, undefined],
    [writes, "SIGKILL"], [writes, "SIGINT"], [begins, "group"],
    [`${call} process.stdin.once("data", () => { throw new Error("x"); });`, "throw"]]) {
    const folder = mkdtempSync(path.join(temporary, "ends-"));
    const child = spawn(process.execPath, ["-e", code], { env: { ...process.env, TMPDIR: folder }, stdio: ["pipe", "pipe", "ignore"], detached: true });
    await new Promise((resolve) => child.stdout.once("data", resolve));
    if (end === "throw") child.stdin.write("now");
    else if (end === "group") process.kill(-child.pid, "SIGINT");
    else if (end !== undefined) child.kill(end);
    await untilNothingIsLeft(folder);
    child.kill("SIGKILL");
  }
});

test("a process that exits takes its renders with it", async () => {
  const code = `import("bismar").then(({ render }) => {
    render(${JSON.stringify(scene)}, { size: [256, 256], spp: 1000000, balance: "half", progress: () => process.exit(3) });
  });`;
  const { status, stderr } = spawnSync(process.execPath, ["-e", code], { encoding: "utf8" });
  assert.equal(status, 3, stderr);
  assertNothingIsLeft();
});

test("npx bismar is the command line, and passes signals on", async () => {
  const bin = createRequire(import.meta.url).resolve("bismar/package.json").replace("package.json", "bin.cjs");
  const version = execFileSync("npx", ["--offline", "bismar", "-V"], { encoding: "utf8" });
  assert.equal(version.trim(), `bismar ${bismar.version}`);
  assert.equal(spawnSync(bin, ["render"]).status, 64);
  const out = path.join(temporary, "long.exr");
  const args = ["render", scene, "--size=256x256", "--spp=1000000", "--balance=half", "-o", out, "--progress=json"];
  // Also to the whole group, as a terminal and `timeout` do; and where only this process is killed.
  for (const end of [(child) => child.kill("SIGTERM"), ({ pid }) => process.kill(-pid, "SIGINT"), (child) => child.kill("SIGKILL")]) {
    const child = spawn(bin, args, { detached: true });
    child.stdout.once("data", () => end(child));
    const code = await new Promise((resolve) => child.on("exit", resolve));
    assert.ok(code === 75 || code === null, `${code}`);
    while (!existsSync(out)) await new Promise((resolve) => setTimeout(resolve, 20));
    unlinkSync(out);
  }
});

test("other platforms get a clear error", async () => {
  const code = `Object.defineProperty(process, "platform", { value: "darwin" });
    Object.defineProperty(process, "arch", { value: "arm64" });
    require("bismar").render("a.glb").catch((error) => console.log(error.exitCode, error.message));`;
  const printed = execFileSync(process.execPath, ["-e", code], { encoding: "utf8" });
  assert.match(printed, /^76 there is no program for darwin-arm64: bismar runs on Linux on x64 with glibc/);
});

test("look makes a contact sheet", async () => {
  const { png, report } = await look([scene, glb]);
  assert.ok(png.length > 100 && typeof report === "object");
});
