// Each call runs the program of the platform's package once. Results come back through a folder that only this user can read
// and that is removed when the call ends; a GLB in memory goes through a pipe.
"use strict";

const { spawn } = require("node:child_process");
const { randomBytes } = require("node:crypto");
const { existsSync, mkdirSync, readFileSync, rmSync, writeFileSync } = require("node:fs");
const os = require("node:os");
const path = require("node:path");
const { Readable, pipeline } = require("node:stream");
const { fileURLToPath } = require("node:url");
const { getSystemErrorMap } = require("node:util");
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

/** Exit codes of what the system refuses, but for 73. */
const CODES = { E2BIG: 64, ENOSPC: 74, EDQUOT: 74, EIO: 74, EMFILE: 76, ENFILE: 76, EAGAIN: 76, ENOMEM: 76, EACCES: 77, EPERM: 77 };

/** Does `work`; errors of the system are a BismarError that says `what` failed, the system's reason, and what to `change`. */
function ours(work, what, change, code) {
  try {
    return work();
  } catch (error) {
    throw refused(error, what, change, code);
  }
}

function refused(error, what, change, code = 73) {
  if (typeof error?.syscall !== "string") return error;
  const reason = getSystemErrorMap().get(error.errno)?.[1] ?? "refused";
  return new BismarError(`${what}: ${reason} (${error.code}). ${change}`, CODES[error.code] ?? code);
}

const temporary = (work) =>
  ours(work, `cannot use a temporary folder in ${os.tmpdir()}`, "Set TMPDIR to a folder that exists, has room, and can be written");

/** Why the program does not begin. */
function notBegun(error, file) {
  const long = error.code === "E2BIG";
  const change = long
    ? "Options, paths and environment variables are too long: pass fewer or shorter ones"
    : ["EMFILE", "ENFILE", "EAGAIN", "ENOMEM"].includes(error.code)
      ? "Make fewer calls at once, or raise this process's limits (ulimit -n, -u, -v)"
      : "Install the package @bismar/linux-x64-gnu again, where programs may be executed";
  return refused(error, `cannot start ${file}`, change, 76);
}

/** A text for the command line. */
function whole(text, name) {
  if (text.includes("\0")) throw new TypeError(`${name} has null bytes`);
  return text;
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
    return [whole(`--${flag}=${text}`, `${command}: ${name}`)];
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
  return ours(() => path.resolve(whole(text, "a path")), text, "The working directory is gone: give an absolute path");
}

/** Processes and folders of calls that have not ended. Where this process ends without `exit`, the program removes both. */
const open = new Set();
const waiting = [];
let running = 0;

function end(call) {
  call.child?.kill("SIGKILL");
  // The program may write until it has ended.
  if (call.made) temporary(() => rmSync(call.folder, { recursive: true, force: true, maxRetries: 3 }));
}

function endAll() {
  for (const call of open) {
    try {
      end(call);
    } catch {
      // No reason to keep the others.
    }
  }
}

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
 * Runs the program with what `prepare` returns of a private folder: `args`, `input` (bytes for its standard input) or `files`
 * (paths in the folder and bytes), and `result`, which makes the call's result of its output.
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
    call.folder = temporary(() => path.join(path.resolve(os.tmpdir()), `bismar-${randomBytes(12).toString("hex")}`));
    const { result, ...what } = prepare(call.folder);
    const output = await ended(call, file, what, signal, progress);
    return temporary(() => result(output));
  } finally {
    open.delete(call);
    if (open.size === 0) process.removeListener("exit", endAll);
    next();
    end(call);
  }
}

/** Waits for the end of the program, and returns what it has printed. */
function ended(call, file, { args, input = new Uint8Array(0), files = [] }, signal, progress) {
  return new Promise((resolve, reject) => {
    // The program begins before there is a folder, and removes it when this process ends. Signals of a terminal reach this process
    // alone: they could end the program before it listens.
    const env = { ...process.env, BISMAR_CALL_FOLDER: call.folder };
    const options = { stdio: ["pipe", "pipe", "pipe"], env, detached: true };
    let child;
    try {
      child = spawn(file, ["--log=json", ...args], options);
    } catch (error) {
      throw notBegun(error, file);
    }
    call.child = child;
    child.on("error", (error) => reject(notBegun(error, file)));
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
    try {
      temporary(() => {
        mkdirSync(call.folder, { mode: 0o700 });
        call.made = true;
        files.forEach(([name, bytes]) => writeFileSync(name, bytes, { mode: 0o600 }));
      });
      // It waits for the first byte.
      const chunks = function* () {
        yield Buffer.of(0);
        for (let at = 0; at < input.length; at += CHUNK) yield input.subarray(at, at + CHUNK);
      };
      // A program that refuses its input closes it; its exit code says why.
      pipeline(Readable.from(chunks(), { objectMode: false }), child.stdin, () => {});
    } catch (error) {
      abort(error);
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
        const place = [73, 74, 77].includes(code) && why.includes(call.folder)
          ? ". TMPDIR names where this folder is: it must exist and have room" : "";
        reject(new BismarError(why + place, code ?? 76, warnings));
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

/** The path of a file, or of one of `files` in the folder, which is to hold the bytes. */
function placed(folder, files, name, value) {
  if (!isBytes(value)) return pathOf(value);
  const bytes = bytesOf(value);
  const kinds = { 0x762f3101: "exr", 0x89504e47: "png", 0x676c5446: "glb" };
  const first = Buffer.from(bytes.subarray(0, 4)).toString("hex");
  const kind = kinds[Number(`0x${first}`)] ?? (first.startsWith("ffd8ff") ? "jpg" : "hdr");
  const file = path.join(folder, `${name}.${kind}`);
  files.push([file, bytes]);
  return file;
}

async function compare(a, b, { signal, ...options } = {}) {
  const given = flags("compare", options);
  return run(signal, undefined, (folder) => {
    const files = [];
    const args = ["compare", "--json", ...given, "--", placed(folder, files, "a", a), placed(folder, files, "b", b)];
    return { args, files, result: ({ text }) => JSON.parse(text) };
  });
}

async function look(scenes, { signal, ...options } = {}) {
  const given = flags("look", options);
  return run(signal, undefined, (folder) => {
    const sheet = path.join(folder, "sheet.png");
    const files = [];
    const paths = [scenes].flat().map((scene, i) => placed(folder, files, `scene-${i + 1}`, scene));
    const result = ({ text, warnings }) => {
      return { png: new Uint8Array(readFileSync(sheet)), report: JSON.parse(text), warnings };
    };
    return { args: ["look", "-o", sheet, ...given, "--", ...paths], files, result };
  });
}

module.exports = { BismarError, compare, inspect, look, program, render, version };
