"""Heuristics of one's own."""

import numpy as np
import pytest

import bismar


def kl(moments: bismar.Moments):
    with np.errstate(all="ignore"):
        share = 0.5 + 0.5 * np.clip(moments.zr / moments.zr2, -1, 1)
    return np.nan_to_num(share, nan=0.5)


def test_a_heuristic_that_does_what_a_balance_does_has_its_bits(cornell):
    seen = []

    def watched(moments):
        assert moments.paths.shape == moments.w.shape == (24, 32) and moments.light_share.dtype == np.float32
        assert (moments.w >= 0).all() and (moments.wr2 <= moments.w * (1 + 1e-9)).all()
        seen.append((int(moments.paths.max()), float(moments.light_share.mean())))
        return kl(moments)

    own = cornell.render(size=(32, 24), spp=100, balance=watched)
    theirs = cornell.render(size=(32, 24), spp=100, balance="kl")
    assert own["beauty"].tobytes() == theirs["beauty"].tobytes()
    assert [paths for paths, _ in seen] == [8, 16, 32, 64]
    assert seen[0][1] == 0.5 and seen[1][1] != 0.5


def test_a_number_holds_for_all_pixels_and_the_picture_is_as_right(cornell):
    reference = cornell.render(size=(32, 24), spp=1024, seed=5)
    for share in (0.25, 0.75):
        own = cornell.render(size=(32, 24), spp=128, balance=lambda moments: share)
        z = bismar.compare(own, reference)["statistics"]["bias_z"]
        # Independent renders: |z| beyond 5 once in 580,000 for each of three channels and two pictures.
        assert max(abs(z) for z in z) < 5
    window = cornell.render(size=(32, 24), spp=32, crop=(3, 4, 20, 19), balance=kl)
    assert window["beauty"].shape == (15, 17, 4)


def test_what_is_wrong_with_a_heuristic_is_said(cornell, tmp_path):
    def broken(moments):
        raise RuntimeError("mine")

    with pytest.raises(RuntimeError, match="mine"):
        cornell.render(size=(8, 8), spp=32, balance=broken)
    for wrong in (1.5, float("nan"), -0.1):
        with pytest.raises(bismar.UsageError, match="light shares"):
            cornell.render(size=(8, 8), spp=32, balance=lambda moments: wrong)
    with pytest.raises(ValueError):
        cornell.render(size=(8, 8), spp=32, balance=lambda moments: np.zeros(3))
    with pytest.raises(bismar.UsageError, match="spp"):
        cornell.render(size=(8, 8), noise=0.5, balance=kl)
    with pytest.raises(bismar.UsageError, match="size"):
        cornell.render(spp=8, balance=kl)
    picture = cornell.render(size=(8, 8), spp=32, balance=kl)
    with pytest.raises(bismar.UsageError, match="arrays"):
        picture.save(tmp_path / "a.exr")
    picture.save(tmp_path / "a.png")
