// Compiled, not run.
import { BismarError, compare, inspect, look, program, render, type RenderOptions } from "bismar";

const options: RenderOptions = { size: [96, 64], spp: 16, adaptive: true, aovs: ["depth"], balance: "half", scene: 0 };
const signal = new AbortController().signal;
const { png, stats, warnings } = await render("a.glb", { ...options, signal, progress: ({ fraction }) => fraction.toFixed() });
const { exr } = await render(new Uint8Array(), { format: "exr" });
const all: [Uint8Array, Uint8Array, string[], unknown] = [png, exr, warnings, stats["samples"]];
const error: number | string = new BismarError("", 64).exitCode || program();
await Promise.all([inspect(new URL("file:///a.glb"), { pose: 1 }), compare(png, exr, { max_flip: 0.1 }), look(["a.glb"])]);

// @ts-expect-error: there is no such option.
await render("a.glb", { sppp: 1 });
// @ts-expect-error: there is no such balance.
await render("a.glb", { balance: "most" });
// @ts-expect-error: a PNG.
(await render("a.glb")).exr;
export { all, error };
