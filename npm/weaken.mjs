// Marks versions of libc and libstdc++ that Debian 12 does not have as weak in ELF files, so that the loader does not insist on
// them: what the files take from there is in compat.c, or is looked up at run time.
//   node npm/weaken.mjs FILE...
import { readFileSync, writeFileSync } from "node:fs";

const NEWEST = { GLIBC: [2, 36], GLIBCXX: [3, 4, 30], CXXABI: [1, 3, 13] };
const SHT_GNU_VERNEED = 0x6ffffffe;
const VER_FLG_WEAK = 2;

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
    for (let version = need + elf.readUInt32LE(need + 8), next = 1; next !== 0; version += next) {
      next = elf.readUInt32LE(version + 12);
      const name = names + elf.readUInt32LE(version + 8);
      const text = elf.toString("latin1", name, elf.indexOf(0, name));
      if (isNewer(text)) elf.writeUInt16LE(elf.readUInt16LE(version + 4) | VER_FLG_WEAK, version + 4);
    }
  }
  writeFileSync(file, elf);
}
