"""Looks, pictures in notebooks, and the server for agents over stdio, by the SDK's own client."""

import json
import subprocess
import sys
import time

import numpy as np
import pytest

import bismar

PNG = b"\x89PNG\r\n\x1a\n"


def test_a_look_is_that_of_the_command_line(scenes, program, tmp_path):
    path = scenes / "cornell.glb"
    sheet = bismar.look(path, size=(32, 24), views=["front", "top"])
    line = [program, "look", str(path), "--size", "32x24", "--views", "front,top", "-q", "-o", "s.png"]
    said = json.loads(subprocess.run(line, cwd=tmp_path, capture_output=True, check=True).stdout)
    assert said.pop("sheet") == "s.png" and sheet.report == said
    assert [view.shape for view in sheet.views] == [(24, 32, 4)] * 2 and sheet.views[0].dtype == np.float32
    shown = [view["shown"] for view in sheet.report["views"]]
    assert np.allclose([view[..., 3].mean() for view in sheet.views], shown)
    sheet.save(tmp_path / "t.png")
    assert (tmp_path / "t.png").read_bytes() == (tmp_path / "s.png").read_bytes()
    assert sheet._repr_png_().startswith(PNG) and sheet.sheet.dtype == np.uint8
    with pytest.raises(bismar.UsageError):
        sheet.save(path)
    with pytest.raises(bismar.InputError):
        bismar.look(tmp_path / "none.glb")
    pair = bismar.look(path, scenes / "veach.glb", size=(16, 16), views="front", max_flip=0.0)
    assert len(pair.views) == 2 and pair.report["within"] is False and pair.report["differences"]


def test_notebooks_show_pictures(cornell):
    picture = cornell.render(size=(16, 12), spp=2)
    assert picture._repr_png_().startswith(PNG)


def server(**more):
    import mcp

    return mcp.StdioServerParameters(command=sys.executable, args=["-m", "bismar.mcp"], **more)


def test_agents_look_render_and_compare(scenes, tmp_path):
    anyio, mcp = pytest.importorskip("anyio"), pytest.importorskip("mcp")
    path, picture = str(scenes / "cornell.glb"), str(tmp_path / "p.png")
    bismar.load(path).render(size=(16, 12), spp=2).save(picture)

    async def talk():
        async with mcp.Client(mcp.stdio_client(server())) as client:
            names = sorted(tool.name for tool in (await client.list_tools()).tools)
            looked = await client.call_tool("look", {"scene": path, "size": 24, "views": ["front"]})
            rendered = await client.call_tool("render", {"scene": path, "orbit": [30, 20], "width": 24, "height": 16, "spp": 4})
            compared = await client.call_tool("compare", {"a": picture, "b": picture})
            wrong = await client.call_tool("look", {"scene": path + "x"})
            again = await client.call_tool("look", {"scene": path, "new": path, "size": 16, "views": ["front"]})
        return names, looked, rendered, compared, wrong, again

    names, looked, rendered, compared, wrong, again = anyio.run(talk)
    assert names == ["compare", "look", "render"]
    assert looked.content[0].mime_type == "image/png"
    assert json.loads(looked.content[1].text)["scene"]["triangles"] > 0
    assert not rendered.is_error and json.loads(rendered.content[1].text)["samples"]
    assert json.loads(compared.content[0].text)["flip"] == 0
    # An error of one call is text for the agent, and the server goes on.
    assert wrong.is_error and "cornell.glbx" in wrong.content[0].text
    assert json.loads(again.content[1].text)["equal"] is True


@pytest.mark.parametrize("killed", [False, True])
def test_a_client_that_is_gone_ends_the_server_in_the_middle_of_a_render(scenes, tmp_path, killed):
    pytest.importorskip("mcp")
    call = {"name": "render", "arguments": {"scene": str(scenes / "veach.glb"), "spp": 1_000_000}}
    messages = [
        {"id": 1, "method": "initialize", "params": {"protocolVersion": "2025-06-18", "capabilities": {},
                                                     "clientInfo": {"name": "test", "version": "1"}}},
        {"method": "notifications/initialized"},
        {"id": 2, "method": "tools/call", "params": call},
    ]
    child = subprocess.Popen([sys.executable, "-m", "bismar.mcp"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                             stderr=subprocess.PIPE, text=True, cwd=tmp_path)
    for message in messages:
        child.stdin.write(json.dumps({"jsonrpc": "2.0", **message}) + "\n")
        child.stdin.flush()
        if message.get("id") == 1:
            assert json.loads(child.stdout.readline())["id"] == 1
    cpu = lambda: sum(map(int, open(f"/proc/{child.pid}/stat").read().rsplit(")", 1)[1].split()[11:13]))
    # Rendering: more than two tenths of a second of both threads' time are spent.
    began, spent = time.monotonic(), cpu()
    while cpu() < spent + 20:
        assert child.poll() is None and time.monotonic() < began + 60
        time.sleep(0.01)
    if killed:
        # Its end of standard output is closed too.
        child.stdout.close()
    child.stdin.close()
    assert child.wait(timeout=10) == 0
    assert "Traceback" not in child.stderr.read() and not any(tmp_path.iterdir())
