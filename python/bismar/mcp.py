"""`bismar-mcp`: a server of the Model Context Protocol on standard input and output, for agents. Its tools write no files.

Needs `pip install 'bismar[mcp]'`.
"""

from __future__ import annotations

import functools
import json
import os
import sys
import threading
import traceback
from typing import Any, Callable, Dict, List, Optional, TypeVar

import bismar

try:
    import anyio.to_thread
    from mcp.server.mcpserver import Image, MCPServer
    from mcp.server.mcpserver.exceptions import ToolError
except ImportError:
    sys.exit("bismar-mcp needs Python 3.10 or newer and the package mcp 2: pip install 'bismar[mcp]'")

server: MCPServer[Any] = MCPServer("bismar", version=bismar.__version__)
T = TypeVar("T")


async def _work(do: Callable[[], T]) -> T:
    """Works on another thread, which is left alone when the client cancels or is gone."""
    try:
        return await anyio.to_thread.run_sync(do, abandon_on_cancel=True)
    except bismar.Error as error:
        raise ToolError(str(error)) from None


@server.tool(structured_output=False)
async def look(
    scene: str,
    new: Optional[str] = None,
    views: Optional[List[str]] = None,
    frames: Optional[str] = None,
    size: int = 512,
) -> List[Any]:
    """Shows a glTF scene (.gltf, .glb): a labelled contact sheet, and JSON: bounds in metres, triangles, materials, textures,
    lights, animations, what is approximated or missing, and of each view the shares of the frame that show something, are
    black or burnt out. With `new`, shows both scenes (or folders) in one framing with their FLIP error map, and says what
    differs.

    views: front, three-quarters, side, back, top, left, bottom. frames: of the animation, such as 0-48x12. size: pixels of a
    view.
    """
    sheet = await _work(lambda: bismar.look(scene, new, views=views, frames=frames, size=(size, size)))
    return [Image(data=sheet._repr_png_(), format="png"), json.dumps(sheet.report)]


@server.tool(structured_output=False)
async def render(
    scene: str,
    camera: Optional[str] = None,
    orbit: Optional[List[float]] = None,
    width: int = 512,
    height: int = 512,
    spp: int = 64,
    env: Optional[str] = None,
) -> List[Any]:
    """Renders a glTF scene as a PNG, and JSON with times and noise.

    camera: name or index of a camera of the file, or framed (the whole scene) [the first one]. orbit: instead, azimuth (0 is
    the front, 90 the right side) and elevation in degrees, and distance (1 just shows all). spp: paths per pixel. env: an
    environment map (.hdr, .exr).
    """
    gone = threading.Event()

    def work() -> Any:
        loaded = bismar.load(scene, env=env)
        progress = lambda _: not gone.is_set()  # noqa: E731
        picture = loaded.render(camera, (width, height), orbit=orbit, spp=spp, aovs="none", progress=progress)
        return picture._repr_png_(), picture.stats

    try:
        png, stats = await _work(work)
    finally:
        gone.set()
    return [Image(data=png, format="png"), json.dumps(stats)]


@server.tool()
async def compare(a: str, b: str, layer: Optional[str] = None) -> Dict[str, Any]:
    """Errors of picture A against reference B (EXR, HDR, PNG, JPEG files): rel_mse, rmse, mae, flip, bias.

    layer: of EXR files, such as albedo or depth.Z.
    """
    return await _work(functools.partial(bismar.compare, a, b, layer=layer))


def _is_broken_pipe(error: BaseException) -> bool:
    return isinstance(error, BrokenPipeError) or any(map(_is_broken_pipe, getattr(error, "exceptions", ())))


def main() -> None:
    """Serves until the client is gone; then a render that still runs is dropped."""
    code = 0
    try:
        server.run("stdio")
    except KeyboardInterrupt:
        code = 130
    except Exception as error:
        # A client that is killed closes standard output too.
        if not _is_broken_pipe(error):
            traceback.print_exc()
            code = 1
    # Threads of a render would keep the interpreter.
    sys.stderr.flush()
    os._exit(code)


if __name__ == "__main__":
    main()
