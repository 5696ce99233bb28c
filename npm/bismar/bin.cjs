#!/usr/bin/env node
// The command line: the program with the same arguments, its signals and its exit code.
"use strict";

const { spawn } = require("node:child_process");
const os = require("node:os");
const { program } = require("./index.cjs");

let file;
try {
  file = program();
} catch (error) {
  process.stderr.write(`error: ${error.message}\n`);
  process.exit(error.exitCode);
}
// The program ends as by SIGTERM when this process does.
const env = { ...process.env, BISMAR_CALLER: String(process.pid) };
const child = spawn(file, process.argv.slice(2), { stdio: "inherit", env });
for (const name of ["SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGUSR1", "SIGUSR2", "SIGALRM"]) {
  // A terminal, npm and this process may all send it to the program, for which signals within half a second are one.
  process.on(name, () => child.kill(name));
}
child.on("error", (error) => {
  process.stderr.write(`error: ${file}: ${error.message}\n`);
  process.exit(76);
});
child.on("exit", (code, signal) => {
  if (signal === null) process.exit(code);
  process.exitCode = 128 + os.constants.signals[signal];
  process.removeAllListeners(signal);
  process.kill(process.pid, signal);
});
