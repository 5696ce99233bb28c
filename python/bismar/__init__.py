"""Bismar: an offline glTF path tracer that finds the balance between light and BSDF sampling for each pixel.

    import bismar

    scene = bismar.load("scene.glb")
    picture = scene.render(size=(640, 360), spp=64, aovs=["depth"])
    rgba, depth = picture["beauty"], picture["depth"]
    picture.save("shot.exr")

Pictures have the bits that the command line renders with the same options. Lengths are metres, angles degrees unless said
otherwise, colours linear Rec. 709; axes are glTF's (+y up, right-handed). NumPy's numbers, bools and arrays are taken for Python's,
and paths of bytes. What takes time releases the global lock (GIL).
Messages go to `logging.getLogger("bismar")`.
"""

from __future__ import annotations

import importlib.util
import json
import operator
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Callable, Dict, Iterable, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple
from typing import Union

import numpy as np

from . import _bismar
from ._bismar import version as __version__
from ._errors import ConfigError, Error, FileError, HostError, InputError, InternalError, Interrupted, UsageError
from ._heuristics import Moments, of_arrays

if TYPE_CHECKING:
    import numpy.typing as npt

    Path = Union[str, bytes, "os.PathLike[str]", "os.PathLike[bytes]"]

__all__ = [
    "Camera",
    "ConfigError",
    "Error",
    "FileError",
    "HostError",
    "InputError",
    "InternalError",
    "Interrupted",
    "Look",
    "Moments",
    "Picture",
    "Progress",
    "Scene",
    "UsageError",
    "__version__",
    "compare",
    "develop",
    "labels",
    "load",
    "look",
    "merge",
]


@dataclass(frozen=True)
class Camera:
    """A camera of a scene."""

    index: int
    """Index for `Scene.render(camera=)`."""
    name: str
    """Name for `Scene.render(camera=)`."""
    projection: str
    """"perspective", "orthographic", "panorama" or "fisheye"."""
    vertical: float
    """Vertical field of view in degrees, or half of the height in metres of an orthographic camera."""
    aspect: Optional[float]
    """Width over height, if the file states it."""
    matrix: List[List[float]]
    """Camera to world, row by row (4 x 4): it looks along its local -z axis with +y up. That of the view `framed` depends
    on the picture's aspect; this one is of a square."""
    intrinsics: Optional[Dict[str, Any]] = None
    """Those of a calibrated camera, by the names of transforms.json (docs/cameras.md)."""


class Progress(NamedTuple):
    """Progress of a render."""

    fraction: float
    """Finished fraction in [0, 1], by the stop rule that is nearest."""
    seconds: float
    """Seconds since rendering began."""
    spp: float
    """Mean paths per pixel so far."""
    noise: Optional[float]
    """Estimated relative error after the last finished pass; None before."""


def _plain(value: Any) -> Any:
    """A value as JSON has it, of NumPy and other array packages as well. A text that is not UTF-8 is its bytes."""
    if isinstance(value, (str, bytes, os.PathLike)):
        text = os.fsdecode(value)
        try:
            text.encode()
        except UnicodeEncodeError:
            return {"Unix": list(os.fsencode(text))}
        return text
    if value is None or isinstance(value, (bool, int, float)):
        return value
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if hasattr(value, "__iter__"):
        return [_plain(part) for part in value]
    return value.__index__() if hasattr(value, "__index__") else float(value)


def _options(given: Dict[str, Any], *others: str) -> str:
    """The arguments of a function, but for `others`, as JSON."""
    plain = {}
    for name, value in given.items():
        if name in others:
            continue
        try:
            plain[name] = _plain(value)
            json.dumps(plain[name], allow_nan=False)
        except (TypeError, ValueError):
            raise UsageError(f"{name}: {value!r} cannot be used", 64) from None
    return json.dumps(plain)


def _paths(given: Union[Path, Iterable[Path]]) -> List[str]:
    """Paths, of one as well. Those of bytes are in the encoding of the file system."""
    if isinstance(given, (str, bytes, os.PathLike)):
        given = [given]
    return [os.fsdecode(path) for path in given]


def _count(threads: Any) -> Optional[int]:
    """A number of threads; 0, which the native half refuses, for what is none."""
    if threads is None:
        return None
    try:
        return min(max(operator.index(threads), 0), 2**31)
    except TypeError:
        raise UsageError(f"threads: {threads!r} is not a number of threads", 64) from None


def _find_denoiser() -> None:
    """Tells the native half where the package pyoidn is, if it is installed: its folder has the library."""
    try:
        found = importlib.util.find_spec("pyoidn")
    except (ImportError, ValueError):
        return
    for folder in (found and found.submodule_search_locations) or ():
        _bismar.look_for_denoiser(folder)


def load(
    path: Path,
    *,
    env: Optional[Path] = None,
    env_rotate: Optional[float] = None,
    env_strength: Optional[float] = None,
    sky: bool = False,
    sunsky: Optional[Sequence[float]] = None,
    no_env: bool = False,
    light_unit: Optional[str] = None,
    light_radius: Optional[float] = None,
    sun_angle: Optional[float] = None,
    energy_compensation: Union[str, bool, None] = None,
    scene: Union[str, int, None] = None,
    variant: Union[str, int, None] = None,
    pose: Optional[float] = None,
    frame: Optional[float] = None,
    fps: Optional[float] = None,
    animation: Union[str, int, None] = None,
    shutter: Optional[Tuple[float, float]] = None,
    motion_steps: Optional[int] = None,
    velocity: bool = False,
    strict: bool = False,
    rays: Optional[str] = None,
    memory_limit: Union[str, int, None] = None,
    threads: Optional[int] = None,
) -> Scene:
    """Loads a glTF scene (.gltf or .glb) and builds what rendering needs. The arguments are flags of `bismar render`.

    env: environment map, an equirectangular .hdr or .exr; `env_rotate` turns it about +y (degrees), `env_strength` is a
        factor of its radiance. `sky` is a white environment, `no_env` none.
    sunsky: a clear sky with its sun, by elevation, azimuth (0 in +z, 90 in +x; degrees) and turbidity [3].
    light_unit: "lumen" or "watt", the unit of the file's point, spot and directional lights. `light_radius` makes all
        point and spot lights spheres (metres), `sun_angle` all directional ones discs (degrees); 0 for sharp shadows.
    energy_compensation: False for the letter of glTF 2.0 on rough surfaces.
    scene, variant, animation: by name or index.
    pose: time of the animations in seconds; or `frame`, in frames of `fps` (24).
    shutter: opening and closing time in frames relative to that time, for motion blur.
    velocity: prepares the AOV "velocity"; needs a time.
    strict: refuse features that can only be approximated or ignored.
    rays: "embree" or "obvhs".
    memory_limit: bytes, or a text such as "6G": a scene or picture that needs more is a HostError.
    threads: number of threads [default: BISMAR_THREADS, else SLURM_CPUS_PER_TASK, else all cores]. Scenes without a
        number share their threads.

    Raises InputError for a file that is missing or cannot be used, UsageError for wrong arguments, HostError where memory
    or Embree do not suffice.
    """
    options = _options({**locals(), "aovs": "velocity" if velocity else None}, "path", "threads", "velocity")
    return Scene(_bismar.load(os.fsdecode(path), options, _count(threads)))


class Scene:
    """A scene in memory, which can be rendered many times, also by several threads at once. `load` makes it."""

    def __init__(self, native: _bismar.Scene) -> None:
        self._native = native

    @property
    def cameras(self) -> List[Camera]:
        """The file's cameras, the view `framed` that shows the whole scene, and those that were added."""
        return [
            Camera(index, *of[:5], None if of[5] is None else json.loads(of[5]))
            for index, of in enumerate(self._native.cameras())
        ]

    @property
    def bounds(self) -> Optional[Tuple[Tuple[float, float, float], Tuple[float, float, float]]]:
        """Lower and upper corner of an axis-aligned box around all surfaces (world space, metres); None without any.

        It is the smallest such box unless objects that are placed several times are rotated.
        """
        box = self._native.bounds()
        return None if box is None else (tuple(box[0]), tuple(box[1]))  # type: ignore[return-value]

    def inspect(self) -> Dict[str, Any]:
        """What the file contains, and what is approximated, ignored or not loaded, as `bismar inspect --json` prints it.

        Reads the file again.
        """
        return json.loads(self._native.inspect())  # type: ignore[no-any-return]

    def add_camera(
        self,
        matrix: Any,
        fov: Union[float, str, None] = None,
        name: Optional[str] = None,
        *,
        intrinsics: Optional[Mapping[str, Any]] = None,
    ) -> Camera:
        """Adds a perspective camera, a panorama or a fisheye. It shares all else with the scene, so thousands cost little.

        matrix: camera to world, 4 x 4 or 3 x 4 (nested lists or an array): three orthonormal, right-handed columns and the
            position in metres. The camera looks along its local -z axis with +y up (glTF, OpenGL, NeRF).
        fov: vertical field of view in degrees, above 0 and below 180; or "panorama": all directions, as an equirectangular
            picture with the view axis in its middle.
        intrinsics: in place of `fov`, those of a calibrated camera, by the names of transforms.json (docs/cameras.md): w, h,
            fl_x, fl_y, cx, cy, k1 to k6, p1, p2, camera_model. Other names are ignored.
        name: for `render(camera=)` [default: "added-N" by its index]; no other camera may have it.

        Raises UsageError for a matrix that is no rotation and translation, and for distortion that folds the picture.
        """
        try:
            rows = [[float(x) for x in row] for row in matrix]
        except (TypeError, ValueError):
            rows = []
        if len(rows) == 3:
            rows.append([0.0, 0.0, 0.0, 1.0])
        if [len(row) for row in rows] != [4, 4, 4, 4]:
            raise UsageError("matrix: not 4 x 4 numbers", 64)
        name = f"added-{len(self._native.cameras())}" if name is None else name
        if (fov is None) == (intrinsics is None):
            raise UsageError("add_camera takes either fov or intrinsics", 64)
        try:
            angle = None if fov is None or fov == "panorama" else float(fov)
        except (TypeError, ValueError):
            raise UsageError(f"fov: {fov!r} is neither degrees nor 'panorama'", 64) from None
        try:
            measured = None if intrinsics is None else json.dumps(dict(intrinsics), default=float, allow_nan=False)
        except (TypeError, ValueError):
            raise UsageError("intrinsics: not finite numbers by name", 64) from None
        index = self._native.add_camera(name, rows, angle, measured)
        return self.cameras[index]

    def render(
        self,
        camera: Union[str, int, Camera, None] = None,
        size: Union[Tuple[int, int], str, None] = None,
        *,
        orbit: Optional[Sequence[float]] = None,
        preset: Optional[str] = None,
        spp: Optional[int] = None,
        time: Union[float, str, None] = None,
        noise: Optional[float] = None,
        min_spp: Optional[int] = None,
        adaptive: Union[str, bool, None] = None,
        learned_lights: Union[str, bool, None] = None,
        compensation: Union[str, bool, None] = None,
        balance: Union[str, Callable[[Moments], Any], None] = None,
        pilot: Optional[float] = None,
        integrator: Optional[str] = None,
        max_depth: Optional[int] = None,
        guiding: Union[str, bool, None] = None,
        guiding_memory: Union[str, int, None] = None,
        clamp_direct: Optional[float] = None,
        clamp_indirect: Optional[float] = None,
        filter: Optional[str] = None,
        seed: Optional[int] = None,
        seed_per_frame: bool = False,
        crop: Optional[Tuple[int, int, int, int]] = None,
        aperture: Union[str, float, None] = None,
        focus: Union[str, float, None] = None,
        lens_blades: Optional[int] = None,
        transparent: bool = False,
        ground: Optional[str] = None,
        back_faces: Optional[str] = None,
        glass_shadows: Optional[str] = None,
        path_reuse: Union[str, bool, None] = None,
        light_groups: Optional[str] = None,
        no_clip: bool = False,
        aovs: Union[str, Iterable[str], None] = None,
        denoise: bool = False,
        progress: Optional[Callable[[Progress], Any]] = None,
    ) -> Picture:
        """Renders a picture. The arguments are flags of `bismar render`, and so are the defaults.

        camera: a `Camera`, or its name or index, or "framed" (a view that fits the whole scene), or "panorama" (all
            directions from the first camera, in the orientation of an environment map) [default: the first].
        orbit: instead of a camera, a view around the scene: azimuth (0 sees it from +z, 90 from +x) and elevation in
            degrees, and the distance as a multiple of that at which the sphere around the scene just fits [1].
        preset: "thumbnail", "product" or "final": other defaults of some arguments (`bismar render --help`); none denoises.
        size: width and height in pixels [default: 960 wide, with the camera's aspect ratio].
        spp, time, noise: stops at this number of paths per pixel, after these seconds of this call, or at this estimated
            relative error, whichever is first [default: 64 paths].
        balance: how samples are divided between lights and BSDF: "progressive" (the default), "second-order", "kl",
            "efficiency-aware", "half", "power" or "max". Or a heuristic of one's own, for study: a callable that is given
            the `Moments` so far between passes (of 8, 8, 16, 32, 64, 128, 128, ... paths, the first with shares of 0.5), and
            returns the light shares of the next one, in [0, 1]: an array (H, W), or one number for all pixels. It needs
            `size` and `spp`. It is slow, and its picture cannot be saved as .exr.
        guiding, adaptive, learned_lights, compensation: "off" or False, "on" or True, or "auto" (where a pre-pass estimates
            that it pays) [default: auto with the balance "progressive"]. adaptive: paths per tile by estimated
            variance and cost.
        seed_per_frame: another noise pattern for each `frame` of `load`.
        crop: window x0, y0, x1, y1 in pixels, the last two exclusive.
        aperture: an f-stop such as "f/2.8" or a radius in metres; focus: a distance in metres or "auto".
        transparent: hides the environment. ground: "shadow", a plane below the scene that shows only shadows, in alpha.
        back_faces: "show" draws those of single-sided materials. glass_shadows: "straight" lets shadow rays pass bodies of
            smooth glass. no_clip: ignores the camera's clipping planes.
        path_reuse: as guiding, or "N" or "N:M": pixels share what their paths find (docs/path-reuse.md).
        light_groups: "NAME=PATTERN,...": layers "light_NAME" of the beauty by named lights, and "light_rest"
            (docs/lights.md).
        aovs: names from docs/pictures.md, or "all" or "none" [default: variance, samples, balance].
        denoise: take what `Picture.denoise` needs.
        progress: called about twenty times a second with a `Progress`, by the calling thread. If it returns False, the
            render stops within the time of a tile and returns what there is (`Picture.interrupted`).

        Raises UsageError for wrong arguments, HostError where memory does not suffice, and Interrupted after Ctrl-C, with
        what there is in its attribute `picture`.
        """
        if isinstance(camera, Camera):
            camera = camera.index
        heuristic = None
        if callable(balance):
            heuristic, balance = balance, None
            if not isinstance(size, (tuple, list, np.ndarray)) or len(size) != 2:
                raise UsageError("balance: a heuristic of one's own needs size=(width, height)", 64)
        if denoise:
            _find_denoiser()
        options = _options(locals(), "self", "progress", "heuristic")
        call = None if progress is None else (lambda *now: progress(Progress(*now)))
        shares = None
        if heuristic is not None:
            window = (0, 0, *size) if crop is None else crop  # type: ignore[misc]
            shares = of_arrays(heuristic, (window[3] - window[1], window[2] - window[0]))
        native, stopped_by = self._native.render(options, call, shares)
        picture = None if native is None else Picture(native)
        if isinstance(stopped_by, KeyboardInterrupt):
            interrupted = Interrupted("interrupted; the attribute `picture` has what there is", 75)
            interrupted.picture = picture
            raise interrupted from stopped_by
        if stopped_by is not None:
            raise stopped_by
        assert picture is not None
        return picture


class Picture:
    """A rendered picture in memory; `Scene.render` makes it. It keeps its scene in memory.

    Layers are arrays: `picture["beauty"]`, and `picture[name]` for each AOV that was asked for, see `layers`.
    """

    def __init__(self, native: _bismar.Picture) -> None:
        self._native = native
        self._arrays: Dict[str, Tuple[npt.NDArray[Any], List[str]]] = {}

    def _layer(self, name: str) -> Tuple[npt.NDArray[Any], List[str]]:
        if name not in self._arrays:
            try:
                self._arrays[name] = self._native.layer(name)
            except UsageError as error:
                raise KeyError(str(error)) from None
        return self._arrays[name]

    def __getitem__(self, layer: str) -> npt.NDArray[Any]:
        """A layer as an array (H, W, C), row 0 at the top; the same array each time.

        "beauty" is float32 (H, W, 4): linear red, green, blue, premultiplied by alpha, and alpha. "depth" is float32
        (H, W, 1) in metres, 1e10 where nothing was hit; "normal" and "position" are (H, W, 3), world space, metres;
        "object", "material" and "samples" are uint32 (H, W, 1). docs/pictures.md lists all. Raises KeyError for a layer
        that was not rendered.
        """
        return self._layer(layer)[0]

    def channels(self, layer: str) -> List[str]:
        """Names of a layer's channels, such as R, G, B, A."""
        return list(self._layer(layer)[1])

    @property
    def layers(self) -> List[str]:
        """Names of the layers: "beauty" and the AOVs."""
        return self._native.layers()

    def __iter__(self) -> Iterator[str]:
        return iter(self.layers)

    def __contains__(self, layer: object) -> bool:
        return layer in self.layers

    @property
    def size(self) -> Tuple[int, int]:
        """Width and height in pixels, of the crop window if there is one."""
        width, height = self._native.size()
        return width, height

    @property
    def interrupted(self) -> bool:
        """Whether the render was stopped before it was complete."""
        return self._native.interrupted()

    @property
    def stats(self) -> Dict[str, Any]:
        """Times, counts and settings, as `bismar render --stats` writes them (docs/stats.md)."""
        return json.loads(self._native.stats())  # type: ignore[no-any-return]

    @property
    def camera_to_world(self) -> List[List[float]]:
        """Camera to world, row by row (4 x 4), as it was rendered: also for the view `framed`."""
        return self._native.view()[0]

    def denoise(self, layer: str = "beauty") -> npt.NDArray[np.float32]:
        """The beauty, or a layer of lights as "light_key", denoised by Intel Open Image Denoise, float32 (H, W, 3).

        Raises UsageError for a picture that was rendered without `denoise=True`, HostError without the library, which
        `pip install pyoidn` brings (docs/pictures.md).
        """
        _find_denoiser()
        return self._native.denoised(layer)  # type: ignore[no-any-return]

    def save(
        self,
        path: Path,
        *,
        view: Path = "agx",
        view_space: Optional[str] = None,
        exposure: Union[float, str] = "auto",
        resumable: bool = False,
        half: bool = False,
        colorspace: str = "rec709",
    ) -> None:
        """Writes the picture: .exr with all layers; .png, .jpg or lossless .webp through a view transform.

        view: "agx", "neutral", "aces", "srgb" or a LUT (.cube), and view_space what the LUT takes (docs/looks.md);
            exposure: stops, or "auto" (not for .exr).
        resumable: also store what `bismar render --resume` and `merge` need (.exr). An interrupted picture always has it.
        half: colours as 16-bit floats (.exr). colorspace: their primaries, "rec709", "acescg" or "rec2020" (.exr).

        A file is complete or not there. Raises FileError if it cannot be written.
        """
        self._native.save(os.fsdecode(path), _options(locals(), "self", "path"))

    def _repr_png_(self) -> bytes:
        """The picture in a notebook: a PNG with the view AgX and the automatic exposure."""
        return self._native.png()


class Look:
    """A contact sheet of a scene, or of two, and what it shows; `look` makes it. Notebooks show the sheet."""

    def __init__(self, native: _bismar.Look) -> None:
        self._native = native
        self.report: Dict[str, Any] = json.loads(native.report())
        """What `bismar look` prints (docs/look.md)."""

    @property
    def sheet(self) -> npt.NDArray[np.uint8]:
        """The sheet, uint8 (H, W, 3), display-encoded, row 0 at the top; a new array each time."""
        return self._native.sheet()  # type: ignore[no-any-return]

    @property
    def views(self) -> List[npt.NDArray[np.float32]]:
        """The views, frame by frame, each float32 (H, W, 4): linear red, green, blue, premultiplied, and the share of the
        pixel that shows a surface. Of two scenes those of the old one, then those of the new one; new arrays each time."""
        return self._native.views()

    def save(self, path: Path) -> None:
        """Writes the sheet: .png, lossless .webp or .jpg. Raises UsageError over a scene, FileError if it cannot be written."""
        self._native.save(os.fsdecode(path))

    def _repr_png_(self) -> bytes:
        return self._native.png()


def look(
    path: Union[Path, Sequence[Path]],
    new: Optional[Path] = None,
    *,
    views: Union[str, Iterable[str], None] = None,
    size: Union[Tuple[int, int], str, None] = None,
    spp: Optional[int] = None,
    frames: Optional[str] = None,
    max_flip: Optional[float] = None,
    scene: Union[str, int, None] = None,
    variant: Union[str, int, None] = None,
    pose: Optional[float] = None,
    frame: Optional[float] = None,
    fps: Optional[float] = None,
    animation: Union[str, int, None] = None,
    shutter: Optional[Tuple[float, float]] = None,
    motion_steps: Optional[int] = None,
    memory_limit: Union[str, int, None] = None,
    threads: Optional[int] = None,
) -> Look:
    """Shows what is in a scene, or what differs between two scenes or folders of scenes, old and new. Writes no file.

    path: a scene; or a list of scenes: three or more are shown side by side, two are compared.
    views: "front", "three-quarters", "side", "back", "top", "left", "bottom" [default: four of them, docs/look.md].
    size: width and height of a view in pixels [512, 512]. spp: paths per pixel [8].
    frames: frames of the animation, a row for each, as in "0-48x12".
    max_flip: of two scenes, `report["within"]` is False if a view's mean FLIP error is larger.
    The other arguments are those of `load`.

    Raises InputError for a file that is missing or cannot be used, UsageError for wrong arguments, HostError where memory
    does not suffice, KeyboardInterrupt after Ctrl-C.
    """
    options = _options(locals(), "path", "new", "threads")
    return Look(_bismar.look(_paths(path) + ([] if new is None else _paths(new)), options, _count(threads)))


def compare(a: Union[Picture, Path], b: Union[Picture, Path], *, layer: Optional[str] = None) -> Dict[str, Any]:
    """Errors of a picture A against a reference B, each a `Picture` or a file (EXR, HDR, PNG, JPEG).

    The keys are those of `bismar compare --json`: "rel_mse", "rmse", "mae", "flip", "bias" (R, G, B), "not_finite" (pixels
    of A and of B), and "statistics" with "bias_z" if both have variance. A crop is compared with the same window.
    layer: a layer or channel of files, such as "albedo" or "depth.Z".

    Raises InputError for pictures of different windows.
    """
    natives: List[Union[_bismar.Picture, str]] = [picture._native if isinstance(picture, Picture) else os.fsdecode(picture) for picture in (a, b)]
    return json.loads(_bismar.compare(natives[0], natives[1], layer))  # type: ignore[no-any-return]


def merge(
    parts: Sequence[Path],
    output: Path,
    *,
    preview: Optional[Path] = None,
    view: Optional[Path] = None,
    view_space: Optional[str] = None,
    exposure: Union[float, str, None] = None,
    statistics: bool = True,
) -> None:
    """Merges the parts of a picture, or averages pictures of different seeds, into the EXR `output`.

    Pictures of different seeds must hold their statistics: `Picture.save(path, resumable=True)`.
    preview: also write a PNG. statistics: keep what a render could be continued from.
    """
    options = _options({**locals(), "no_statistics": not statistics}, "parts", "statistics")
    _bismar.merge(_paths(parts), options)


def labels(
    pictures: Sequence[Path],
    output: Optional[Path] = None,
    *,
    by: Optional[str] = None,
    images: Optional[str] = None,
    ids: bool = False,
    depth: Optional[Sequence[str]] = None,
    depth_scale: Optional[float] = None,
    depth_along: Optional[str] = None,
    normals: Optional[Sequence[str]] = None,
    normal_space: Optional[str] = None,
) -> None:
    """Writes what a data set needs beside its pictures (docs/datasets.md).

    pictures: EXR files with the AOVs that are asked for, or folders of such files.
    output: COCO annotations (.json): images, categories, masks (RLE). by: "object" (the default) or "material". images: ending
        of the pictures' names in them, such as "png".
    ids: 16-bit PNG of the ids. depth, normals: lists of "npy" and "png". depth_scale: metres per step of the PNG [0.001].
    depth_along: "ray" (the default: distances to the camera) or "axis" (along the view axis, as depth cameras measure).
    normal_space: "world" (the default) or "camera".

    Raises InputError for a picture without the AOV.
    """
    options = _options(locals(), "pictures")
    _bismar.labels(_paths(pictures), options)


def develop(
    input: Path,
    output: Optional[Path] = None,
    *,
    view: Optional[Path] = None,
    view_space: Optional[str] = None,
    exposure: Union[float, str, None] = None,
    layer: Optional[str] = None,
    mix: Optional[str] = None,
) -> None:
    """Converts an EXR or HDR picture to PNG by a view transform ("agx", "neutral", "aces", "srgb", or a LUT in a .cube file,
    which takes `view_space`: docs/looks.md) and an exposure in stops.

    output: [default: the picture's name with .png, in the same folder]. layer: shown instead of the beauty. mix:
        "NAME=FACTOR,...", the sum of layers of lights times factors (docs/lights.md).
    """
    _bismar.develop(os.fsdecode(input), _options(locals(), "input"))
