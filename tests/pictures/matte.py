"""A file's mattes by Cryptomatte's specification, with the hash of another's program: matte.py FILE.exr, JSON on stdout."""

import json
import sys

import mmh3
import numpy
import OpenImageIO as oiio


def float_hash(name):
    """Of the specification: a hash whose bits are a float that is neither denormal nor infinite."""
    bits = mmh3.hash(name, 0, signed=False)
    return bits ^ 1 << 23 if bits >> 23 & 255 in (0, 255) else bits


file = oiio.ImageInput.open(sys.argv[1])
spec = file.spec()
names = list(spec.channelnames)
header = {a.name: a.value for a in spec.extra_attribs}


def channel(name):
    i = names.index(name)
    kind = str((spec.channelformats or [spec.format] * spec.nchannels)[i])
    return file.read_image(0, 0, i, i + 1, kind).reshape(spec.height, spec.width)


found = {}
for kind, layer in [("object", "CryptoObject"), ("material", "CryptoMaterial")]:
    key = next(n.split("/")[1] for n, v in header.items() if n.startswith("cryptomatte/") and v == layer)
    of = lambda what: header[f"cryptomatte/{key}/{what}"]
    assert key == f"{mmh3.hash(layer, 0, signed=False):08x}"[:7], key
    assert (of("hash"), of("conversion")) == ("MurmurHash3_32", "uint32_to_float32")
    manifest = json.loads(of("manifest"))
    by_hash = {int(value, 16): name for name, value in manifest.items()}
    ranks = [channel(f"{layer}{i // 4:02d}.{'RGBA'[i % 4]}") for i in range(12)]
    hashes, shares = [r.view(numpy.uint32) for r in ranks[0::2]], ranks[1::2]
    told = set(numpy.unique(numpy.concatenate([h[s > 0] for h, s in zip(hashes, shares)])))
    whole = shares[0] == 1
    listed = json.loads(header[f"bismar.{kind}s"])
    number = channel(f"{kind}.V")[whole]
    found[kind] = {
        "names": len(told),
        "unknown": len(told - by_hash.keys()),
        "wrong_hashes": sum(float_hash(name) != int(value, 16) for name, value in manifest.items()),
        "coverage_error": float(numpy.abs(sum(shares) - channel("A")).max()),
        "whole_pixels": int(whole.sum()),
        "other_than_number": sum(by_hash[h] != listed[n - 1] for h, n in zip(hashes[0][whole], number)),
    }
print(json.dumps(found))
