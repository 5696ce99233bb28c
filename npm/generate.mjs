// Makes options.json and index.d.cts of the package `bismar` from what `bismar options` prints of the command line's flags.
//   node npm/generate.mjs PROGRAM FOLDER
import { execFileSync } from "node:child_process";
import { writeFileSync } from "node:fs";
import path from "node:path";

// What names files besides the inputs, makes several pictures, or goes on from an earlier run is for the command line.
const LEFT_OUT = "output frames turntable cameras preview stats tev replay-pixel progress json csv diff page".split(" ");
const COMMANDS = ["render", "inspect", "compare", "look"];

const [program, folder] = process.argv.slice(2);
const described = JSON.parse(execFileSync(program, ["options"], { encoding: "utf8" }));
const kept = (option) => !LEFT_OUT.includes(option.flag) && option.heading !== "Interruption and parts";
const commands = Object.fromEntries(COMMANDS.map((name) => [name, described[name].filter(kept)]));

function type({ switch: isSwitch, number, choices, value }) {
  if (isSwitch) return "boolean";
  if (choices.length > 0) {
    const also = choices.length === 1 || choices.includes("on") || choices.includes("true");
    const one = choices.map((choice) => JSON.stringify(choice)).join(" | ") + (also ? " | boolean" : "");
    if (value.includes("FILE")) return `${one} | (string & {})`;
    return value === "LIST" ? `${one} | readonly (${one})[]` : one;
  }
  if (number) return "number | string";
  return value.startsWith("FILE") ? "string" : "string | number | readonly (string | number)[]";
}

const capital = (name) => name[0].toUpperCase() + name.slice(1);
const comment = (text) => `  /** ${(text ?? "").replaceAll("*/", "* /").replace(/\s+/g, " ")} */\n`;
const interfaces = Object.entries(commands).map(([name, options]) => {
  const fields = options.map((option) => `${comment(option.help)}  ${option.name}?: ${type(option)} | undefined;\n`);
  return `/** Flags of \`bismar ${name}\`, which the texts speak of. */\nexport interface ${capital(name)}Flags {\n${fields.join("")}}\n`;
});

const types = `// Made by npm/generate.mjs.
/** A path, a file: URL as such or as text, or the bytes of a file. */
export type Input = string | URL | ArrayBufferView | ArrayBuffer | SharedArrayBuffer;

export interface Progress {
  /** Finished fraction in [0, 1]. */
  fraction: number;
  seconds: number;
  /** Mean paths per pixel so far. */
  spp: number;
  /** Estimated relative error; null before it is known. */
  noise: number | null;
}

export interface Abort {
  /** Ends the call: it rejects with the signal's reason. */
  signal?: AbortSignal | undefined;
}

export interface Result {
  /** What \`bismar render --stats\` writes. */
  stats: Record<string, any>;
  warnings: string[];
}

${interfaces.join("\n")}
export interface RenderOptions extends RenderFlags, Abort {
  /** Called about once a second. If it throws, the call is aborted and rejects with that error. */
  progress?: ((progress: Progress) => void) | undefined;
}

/** Renders a scene, a .gltf or .glb by its path or the bytes of a GLB, to a PNG, or an OpenEXR file with \`format: "exr"\`. */
export function render(scene: Input, options?: RenderOptions & { format?: "png" | undefined }): Promise<Result & { png: Uint8Array }>;
export function render(scene: Input, options: RenderOptions & { format: "exr" }): Promise<Result & { exr: Uint8Array }>;

/** What \`bismar inspect --json\` prints. */
export function inspect(scene: Input, options?: InspectFlags & Abort): Promise<Record<string, any>>;

/** What \`bismar compare --json\` prints of a picture and a reference: \`rel_mse\`, \`flip\`, \`bias\` and others. */
export function compare(a: Input, b: Input, options?: CompareFlags & Abort): Promise<Record<string, any>>;

/** A contact sheet of scenes, and what \`bismar look\` prints. */
export function look(
  scenes: Input | readonly Input[],
  options?: LookFlags & Abort,
): Promise<{ png: Uint8Array; report: any; warnings: string[] }>;

/** The path of the program. Throws a BismarError where there is none for this platform. */
export function program(): string;

export const version: string;

/** A call that failed. */
export class BismarError extends Error {
  constructor(message: string, exitCode: number, warnings?: string[]);
  /** The program's: 64 wrong usage, 65 a file that cannot be used, 66 one that is missing, 76 this machine; docs/exit-codes.md. */
  exitCode: number;
  warnings: string[];
}
`;

// Of every option what index.cjs needs.
const needed = JSON.stringify(commands, [...COMMANDS, "name", "flag", "switch", "value", "choices"]);
writeFileSync(path.join(folder, "options.json"), needed);
writeFileSync(path.join(folder, "index.d.cts"), types);
