#!/usr/bin/env node
// The command line: the program with the same arguments, its signals and its exit code.
"use strict";

const { spawn } = require("node:child_process");
const { program } = require("./index.cjs");

let file;
try {
  file = program();
} catch (error) {
  process.stderr.write(`error: ${error.message}\n`);
  process.exit(error.exitCode);
}
const child = spawn(file, process.argv.slice(2), { stdio: "inherit" });
for (const name of ["SIGINT", "SIGTERM", "SIGHUP", "SIGUSR1"]) {
  // A terminal sends Ctrl-C to both already, and a second signal would end the program before it has saved.
  process.on(name, () => (name === "SIGINT" && process.stdin.isTTY) || child.kill(name));
}
child.on("error", (error) => {
  process.stderr.write(`error: ${file}: ${error.message}\n`);
  process.exit(76);
});
child.on("exit", (code, signal) => {
  if (signal === null) process.exit(code);
  process.removeAllListeners(signal);
  process.kill(process.pid, signal);
});
