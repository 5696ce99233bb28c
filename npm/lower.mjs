// Replaces versions of libc and libstdc++ that Debian 12 does not have, in what ELF files need, by old ones of the same library:
// the loader insists on them. The functions themselves are in compat.c, or weak.
//   node npm/lower.mjs FILE...
import { readFileSync, writeFileSync } from "node:fs";

const NEWEST = { GLIBC: [2, 36], GLIBCXX: [3, 4, 30], CXXABI: [1, 3, 13] };
const SHT_GNU_VERNEED = 0x6ffffffe;

function isNewer(name) {
  const [library, numbers] = name.split("_");
  const have = NEWEST[library];
  if (have === undefined) return false;
  const wanted = numbers.split(".").map(Number);
  const at = wanted.findIndex((n, i) => n !== (have[i] ?? 0));
  return at >= 0 && wanted[at] > (have[at] ?? 0);
}

for (const file of process.argv.slice(2)) {
  const elf = readFileSync(file);
  const [table, size, count] = [Number(elf.readBigUInt64LE(0x28)), elf.readUInt16LE(0x3a), elf.readUInt16LE(0x3c)];
  const section = (i) => {
    const at = table + i * size;
    return { type: elf.readUInt32LE(at + 4), offset: Number(elf.readBigUInt64LE(at + 24)), link: elf.readUInt32LE(at + 40) };
  };
  const needed = Array.from({ length: count }, (_, i) => section(i)).find(({ type }) => type === SHT_GNU_VERNEED);
  const names = section(needed.link).offset;
  for (let need = needed.offset, step = 1; step !== 0; need += step) {
    step = elf.readUInt32LE(need + 12);
    const versions = [];
    for (let at = need + elf.readUInt32LE(need + 8), next = 1; next !== 0; at += next) {
      next = elf.readUInt32LE(at + 12);
      const name = names + elf.readUInt32LE(at + 8);
      versions.push({ at, text: elf.toString("latin1", name, elf.indexOf(0, name)) });
    }
    for (const { at, text } of versions.filter((version) => isNewer(version.text))) {
      const prefix = `${text.split("_")[0]}_`;
      const old = versions.find((version) => version.text.startsWith(prefix) && !isNewer(version.text));
      if (old === undefined) throw new Error(`${file}: needs ${text} and nothing older of it`);
      // Hash and name.
      elf.copy(elf, at, old.at, old.at + 4);
      elf.copy(elf, at + 8, old.at + 8, old.at + 12);
    }
  }
  writeFileSync(file, elf);
}
