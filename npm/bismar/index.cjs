// Each call runs the program of the platform's package once. Results come back through a folder that only this user can read
// and that is removed when the call ends; a GLB in memory goes through a pipe.
"use strict";

const { spawn } = require("node:child_process");
const { existsSync, mkdtempSync, readFileSync, rmSync, writeFileSync } = require("node:fs");
const os = require("node:os");
const path = require("node:path");
const { Readable, pipeline } = require("node:stream");
const { fileURLToPath } = require("node:url");
const { isAnyArrayBuffer } = require("node:util/types");

const { version } = require("./package.json");
const COMMANDS = require("./options.json");

/** Milliseconds from SIGTERM to SIGKILL. */
const GRACE = 2000;
/** Bytes of a message that is kept of a program that ends without one of its own. */
const MOST_TEXT = 4000;
const CHUNK = 1 << 20;

class BismarError extends Error {
  constructor(message, exitCode, warnings = []) {
    super(message);
    this.name = "BismarError";
    this.exitCode = exitCode;
    this.warnings = warnings;
  }
}

/** Does `work`; errors of the system are a BismarError. */
function ours(work, what) {
  try {
    return work();
  } catch (error) {
    if (typeof error?.syscall !== "string") throw error;
    const codes = { E2BIG: 64, ENOSPC: 74, EDQUOT: 74, EIO: 74, EMFILE: 76, ENFILE: 76, EAGAIN: 76, ENOMEM: 76, EACCES: 77, EPERM: 77 };
    throw new BismarError(`${what}: ${error.message}`, codes[error.code] ?? 73);
  }
}

/** The path of the program. */
function program() {
  // What loads the program.
  const glibc = process.platform !== "linux" || process.arch !== "x64" || existsSync("/lib64/ld-linux-x86-64.so.2");
  const platform = `${process.platform}-${process.arch}${glibc ? "" : " without glibc"}`;
  if (platform !== "linux-x64") {
    throw new BismarError(`there is no program for ${platform}: bismar runs on Linux on x64 with glibc`, 76);
  }
  try {
    return path.join(path.dirname(require.resolve("@bismar/linux-x64-gnu/package.json")), "bin", "bismar");
  } catch {
    const why = "the package @bismar/linux-x64-gnu is not installed: install bismar with its optional dependencies";
    throw new BismarError(why, 76);
  }
}

/** Options as flags of the command line; names that it does not have are a TypeError. */
function flags(command, options) {
  const all = COMMANDS[command];
  return Object.entries(options).flatMap(([name, value]) => {
    const known = all.find((option) => option.name === name);
    if (known === undefined) {
      throw new TypeError(`${command}: there is no option '${name}'; there are ${all.map((o) => o.name).join(", ")}`);
    }
    if (value === undefined || value === null) return [];
    const { flag, choices } = known;
    if (known.switch) {
      if (typeof value !== "boolean") throw new TypeError(`${command}: ${name} is true or false`);
      return value ? [`--${flag}`] : [];
    }
    if (typeof value === "boolean") {
      const words = choices.includes("on") ? ["off", "on"] : choices.includes("true") ? ["false", "true"] : [null, choices[0]];
      if (choices.length === 0 || (words[0] === null && choices.length > 1)) {
        throw new TypeError(`${command}: ${name} is not true or false`);
      }
      const word = words[Number(value)];
      return word === null ? [] : [`--${flag}=${word}`];
    }
    const isPlain = (one) => typeof one === "string" || typeof one === "number";
    const list = Array.isArray(value) ? value : [value];
    if (!list.every(isPlain)) throw new TypeError(`${command}: ${name} is neither a number nor a text, nor a list of them`);
    // An empty list of AOVs.
    const text = list.length === 0 ? "none" : list.join(known.value === "WxH" ? "x" : ",");
    return [`--${flag}=${text}`];
  });
}

/** Also of other realms, as those of node:vm and of test runners. */
function isBytes(value) {
  return ArrayBuffer.isView(value) || isAnyArrayBuffer(value);
}

function bytesOf(value) {
  return ArrayBuffer.isView(value) ? new Uint8Array(value.buffer, value.byteOffset, value.byteLength) : new Uint8Array(value);
}

/** An absolute path, which is no flag. */
function pathOf(value) {
  const text = typeof value === "object" ? value?.href : value;
  if (typeof text !== "string" || text === "") throw new TypeError("expected a path, a file: URL, or bytes");
  if (text !== value || /^file:/i.test(text)) return fileURLToPath(text);
  return ours(() => path.resolve(text), text);
}

/** Processes and folders of calls that have not ended. Where this process ends without `exit`, the program removes both. */
const open = new Set();
const waiting = [];
let running = 0;

function end(call) {
  call.child?.kill("SIGKILL");
  if (call.folder !== undefined) rmSync(call.folder, { recursive: true, force: true });
}

const endAll = () => open.forEach(end);

/** As many programs at once as there are processors; each uses all of them, and memory. */
async function turn(signal) {
  if (running < Math.max(1, os.cpus().length)) {
    running += 1;
    return;
  }
  await new Promise((resolve, reject) => {
    const cancel = () => {
      waiting.splice(waiting.indexOf(start), 1);
      reject(signal.reason);
    };
    const start = () => {
      signal?.removeEventListener("abort", cancel);
      resolve();
    };
    signal?.addEventListener("abort", cancel, { once: true });
    waiting.push(start);
  });
}

function next() {
  const start = waiting.shift();
  if (start === undefined) running -= 1;
  else start();
}

/**
 * Runs the program with what `prepare` returns of a private folder: `args`, `input` (bytes for its standard input), and
 * `result`, which makes the call's result of its output.
 */
async function run(signal, progress, prepare) {
  if (signal !== undefined && typeof signal?.throwIfAborted !== "function") throw new TypeError("signal is not an AbortSignal");
  if (progress !== undefined && typeof progress !== "function") throw new TypeError("progress is not a function");
  const file = program();
  signal?.throwIfAborted();
  await turn(signal);
  const call = {};
  try {
    if (open.size === 0) process.on("exit", endAll);
    open.add(call);
    signal?.throwIfAborted();
    const temporary = `a temporary folder in ${os.tmpdir()}, which TMPDIR names`;
    const { args, input, result } = ours(() => {
      call.folder = mkdtempSync(path.join(path.resolve(os.tmpdir()), "bismar-"));
      return prepare(call.folder);
    }, temporary);
    const output = await ended(call, file, args, input, signal, progress);
    return ours(() => result(output), temporary);
  } finally {
    end(call);
    open.delete(call);
    if (open.size === 0) process.removeListener("exit", endAll);
    next();
  }
}

/** Waits for the end of the program, and returns what it has printed. */
function ended(call, file, args, input, signal, progress) {
  return new Promise((resolve, reject) => {
    const stdio = [input === undefined ? "ignore" : "pipe", "pipe", "pipe"];
    const env = { ...process.env, BISMAR_CALL_FOLDER: call.folder };
    const child = ours(() => spawn(file, ["--log=json", ...args], { stdio, env }), file);
    call.child = child;
    child.on("error", (error) => reject(new BismarError(`${file}: ${error.message}`, 76)));
    // Without file descriptors left, there are no pipes.
    if (child.stdout === undefined || child.stdout === null) return;
    const warnings = [];
    let [output, message, text] = ["", "", ""];
    let failure;
    let timer;
    const abort = (reason) => {
      failure ??= { reason };
      child.kill("SIGTERM");
      timer ??= setTimeout(() => child.kill("SIGKILL"), GRACE);
    };
    const onAbort = () => abort(signal.reason);
    signal?.addEventListener("abort", onAbort, { once: true });
    if (input !== undefined) {
      const chunks = function* () {
        for (let at = 0; at < input.length; at += CHUNK) yield input.subarray(at, at + CHUNK);
      };
      // A program that refuses its input closes it; its exit code says why.
      pipeline(Readable.from(chunks(), { objectMode: false }), child.stdin, () => {});
    }
    lines(child.stdout, (line) => {
      if (progress === undefined) {
        output += `${line}\n`;
        return;
      }
      const { fraction, seconds, spp, noise } = parsed(line) ?? {};
      if (fraction === undefined || failure !== undefined) return;
      try {
        progress({ fraction, seconds, spp, noise });
      } catch (error) {
        abort(error);
      }
    });
    lines(child.stderr, (line) => {
      const event = parsed(line);
      if (event?.level === "WARN") warnings.push(event.message);
      else if (event?.level === "ERROR") message = event.message;
      else if (event === undefined) text = `${text}${line}\n`.slice(-MOST_TEXT);
    });
    child.on("close", (code, killed) => {
      clearTimeout(timer);
      signal?.removeEventListener("abort", onAbort);
      call.child = undefined;
      if (failure !== undefined) reject(failure.reason);
      else if (code === 0 || code === 1) resolve({ text: output, warnings });
      else {
        const why = message || text.trim().replace(/^error: /, "") || (killed ? `ended by ${killed}` : "no message");
        reject(new BismarError(why, code ?? 76, warnings));
      }
    });
  });
}

function parsed(line) {
  try {
    return JSON.parse(line);
  } catch {
    return undefined;
  }
}

/** Calls `each` for every line. */
function lines(stream, each) {
  let rest = "";
  stream.setEncoding("utf8");
  stream.on("data", (chunk) => {
    const all = (rest + chunk).split("\n");
    rest = all.pop();
    all.forEach(each);
  });
  stream.on("end", () => rest !== "" && each(rest));
}

/** The scene as an argument, and what goes to standard input. */
function source(scene) {
  return isBytes(scene) ? { arg: "-", input: bytesOf(scene) } : { arg: pathOf(scene), input: undefined };
}

async function render(scene, { signal, progress, format = "png", ...options } = {}) {
  if (format !== "png" && format !== "exr") throw new TypeError(`render: format is "png" or "exr"`);
  const [given, { arg, input }] = [flags("render", options), source(scene)];
  return run(signal, progress, (folder) => {
    const [picture, stats] = [`picture.${format}`, "stats.json"].map((name) => path.join(folder, name));
    const outputs = format === "exr" ? ["-o", picture] : ["-o", path.join(folder, "picture.exr"), "--preview", picture];
    const args = ["render", "--progress=json", `--stats=${stats}`, ...outputs, ...given, "--", arg];
    const result = ({ warnings }) => ({
      [format]: new Uint8Array(readFileSync(picture)),
      stats: JSON.parse(readFileSync(stats, "utf8")),
      warnings,
    });
    return { args, input, result };
  });
}

async function inspect(scene, { signal, ...options } = {}) {
  const [given, { arg, input }] = [flags("inspect", options), source(scene)];
  const args = ["inspect", "--json", ...given, "--", arg];
  return run(signal, undefined, () => ({ args, input, result: ({ text }) => JSON.parse(text) }));
}

/** The path of a file, or of a new one in the folder that holds the bytes. */
function placed(folder, name, value) {
  if (!isBytes(value)) return pathOf(value);
  const bytes = bytesOf(value);
  const kinds = { 0x762f3101: "exr", 0x89504e47: "png", 0x676c5446: "glb" };
  const first = Buffer.from(bytes.subarray(0, 4)).toString("hex");
  const kind = kinds[Number(`0x${first}`)] ?? (first.startsWith("ffd8ff") ? "jpg" : "hdr");
  const file = path.join(folder, `${name}.${kind}`);
  writeFileSync(file, bytes, { mode: 0o600 });
  return file;
}

async function compare(a, b, { signal, ...options } = {}) {
  const given = flags("compare", options);
  return run(signal, undefined, (folder) => {
    const args = ["compare", "--json", ...given, "--", placed(folder, "a", a), placed(folder, "b", b)];
    return { args, result: ({ text }) => JSON.parse(text) };
  });
}

async function look(scenes, { signal, ...options } = {}) {
  const given = flags("look", options);
  return run(signal, undefined, (folder) => {
    const sheet = path.join(folder, "sheet.png");
    const files = [scenes].flat().map((scene, i) => placed(folder, `scene-${i + 1}`, scene));
    const result = ({ text, warnings }) => {
      return { png: new Uint8Array(readFileSync(sheet)), report: JSON.parse(text), warnings };
    };
    return { args: ["look", "-o", sheet, ...given, "--", ...files], result };
  });
}

module.exports = { BismarError, compare, inspect, look, program, render, version };
