// Compiled, not run.
import bismar = require("bismar");

export const png: Promise<Uint8Array> = bismar.render("a.glb").then((result) => result.png);
